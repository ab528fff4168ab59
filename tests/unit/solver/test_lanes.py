"""The layout of rows: nothing lost, neighbours beside each other, halos that repeat."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.reference import Body

from taichi_ldem.solver.lanes import HALO, Lanes
from taichi_ldem.solver.processor import vector_bytes

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
