"""The layout of rows: nothing lost, neighbours beside each other, halos that repeat."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.reference import Body

from taichi_ldem.solver.lanes import HALO, Lanes
from taichi_ldem.solver.processor import NARROW, WIDE, _vector_bytes, vector_bytes

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


@pytest.mark.parametrize("width", [1, 2, 4, 8])
@pytest.mark.parametrize("sites", [11, 18, 25, 177])
def test_what_is_spread_is_gathered(sites: int, width: int) -> None:
    lanes = Lanes(sites, width)
    values = np.random.default_rng(sites).random((3, 2, sites))
    values[..., [0, -1]] = 0
    stored = lanes.spread(values)
    assert stored.shape == (3, 2, lanes.columns, width)
    np.testing.assert_array_equal(lanes.gather(stored), values)


@pytest.mark.parametrize("width", [1, 2, 4, 8])
def test_neighbours_along_x_are_neighbouring_columns(width: int) -> None:
    lanes = Lanes(50, width)
    index = lanes.index()
    owned = slice(HALO, HALO + lanes.length)
    for step in (-1, 1):
        beside = index[owned.start + step : owned.stop + step]
        inner = (index[owned] > 0) & (index[owned] < 49)
        np.testing.assert_array_equal(beside[inner], np.clip(index[owned] + step, 0, 49)[inner])


def test_short_rows_have_fewer_lanes() -> None:
    assert Lanes.fitting(177, 8).width == vector_bytes() // 8
    assert Lanes.fitting(177, 4).width == vector_bytes() // 4
    for sites in range(4, 40):
        lanes = Lanes.fitting(sites, 4)
        assert lanes.width == 1 or lanes.length >= 2 * HALO


def test_halos_repeat_their_neighbours_while_the_block_moves(
    elastic: "Simulation", body: Body
) -> None:
    """Every place of a row of displacements holds its site's, also where a lane repeats another."""
    dynamics = elastic.dynamics
    assert dynamics.lanes.width > 1
    rng = np.random.default_rng(5)
    elastic.start_from(
        body.spread(rng.normal(0, 1e-6, (len(body.places), 3))),
        body.spread(rng.normal(0, 0.1, (len(body.places), 3))),
    )
    elastic.advance(7)
    moved = elastic.displacement()
    assert np.abs(moved).max() > 0
    for s in range(2):
        for axis in range(3):
            stored = dynamics.displacement[s][axis].to_numpy()[elastic.now]
            np.testing.assert_array_equal(stored, dynamics.lanes.spread(moved[s, ..., axis]))


@pytest.mark.parametrize(
    ("vendor", "family", "model", "flags", "expected"),
    [
        ("AuthenticAMD", 25, 17, "sse2 avx avx2", WIDE),  # Zen 4
        ("AuthenticAMD", 26, 2, "sse2 avx avx2", NARROW),  # Zen 5: later than LLVM 15
        ("GenuineIntel", 6, 0x8F, "avx2 avx512f", WIDE),  # Sapphire Rapids
        ("GenuineIntel", 6, 0xAD, "avx2 avx512f", WIDE),  # Granite Rapids: taken for Ice Lake
        ("GenuineIntel", 19, 1, "avx2 avx512f", NARROW),  # Diamond Rapids: no family of LLVM 15's
        ("GenuineIntel", 6, 0x3F, "sse2 avx", NARROW),  # a hypervisor hides AVX2
    ],
)
def test_columns_are_as_wide_as_the_compiler_s_registers(
    vendor: str, family: int, model: int, flags: str, expected: int
) -> None:
    described = {"vendor_id": vendor, "cpu family": str(family), "model": str(model)}
    assert _vector_bytes(described | {"flags": flags}) == expected
    assert _vector_bytes({}) == NARROW
