"""Holes: how many modules they cut out, and which bars are left at their edges."""

from typing import Any

import numpy as np
import pytest
from support.blocks import block_scene

from taichi_ldem.errors import SceneError
from taichi_ldem.model import outlines
from taichi_ldem.scene import Scene
from taichi_ldem.solver.build import build_lattice

EDGE = 0.5e-3


def _plate(*holes: dict[str, Any], **plate: Any) -> Scene:
    return block_scene(80, 60, 2, hole=list(holes), plate=plate)


@pytest.mark.parametrize(
    "hole",
    [
        {"shape": "circle", "diameter": 15e-3},
        {"shape": "rectangle", "size": [14e-3, 6e-3], "angle": 30},
        {"shape": "slot", "size": [16e-3, 5e-3], "angle": -20},
    ],
    ids=lambda hole: hole["shape"],
)
def test_a_hole_cuts_out_its_area(hole: dict[str, Any]) -> None:
    scene = _plate(hole | {"centre": [3.1e-3, -2.2e-3]})
    mask = outlines.body(scene)
    cut = (~mask[0]).sum() * EDGE**2
    assert cut == pytest.approx(outlines.hole_area(scene.hole[0]), rel=0.02)
    np.testing.assert_array_equal(mask[0], mask[1])  # through the thickness
    j, i = np.nonzero(~mask[0])
    middle = np.array([(i + 0.5 - 40).mean(), (j + 0.5 - 30).mean()]) * EDGE
    np.testing.assert_allclose(middle, [3.1e-3, -2.2e-3], atol=0.1 * EDGE)
    around = outlines.hole_outline(scene.plate, scene.hole[0])
    x, y = around.T
    area = 0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
    assert area == pytest.approx(outlines.hole_area(scene.hole[0]), rel=2e-3)


def test_holes_are_turned_counter_clockwise() -> None:
    mask = outlines.body(_plate({"shape": "slot", "size": [16e-3, 4e-3], "angle": 45}))[0]
    j, i = np.nonzero(~mask)
    assert np.corrcoef(i, j)[0, 1] > 0.8


def test_a_disc_with_a_round_hole_is_a_ring() -> None:
    scene = _plate({"shape": "circle", "diameter": 10e-3}, shape="disc", diameter=28e-3)
    mask = outlines.body(scene)[0]
    exact = np.pi / 4 * (28**2 - 10**2) * 1e-6
    assert mask.sum() * EDGE**2 == pytest.approx(exact, rel=0.01)
    np.testing.assert_array_equal(mask, mask[::-1, ::-1])


def test_bars_on_a_hole_s_edge_weigh_as_on_any_face() -> None:
    """The shares of the bars along one axis add up to the volume, with a hole as without."""
    hole = {"shape": "rectangle", "size": [10e-3, 8e-3]}
    for holes in ((), (hole,)):
        lattice = build_lattice(_plate(*holes))
        shares = lattice.bar_shares()[..., 0].sum()  # a bar along x stands for one module
        assert shares * EDGE**3 == pytest.approx(lattice.volume, rel=1e-12)
    assert (~lattice.mask).sum() == 20 * 16 * 2


@pytest.mark.parametrize(
    ("hole", "message"),
    [
        (
            {"shape": "circle", "diameter": 0.2},
            r"leaves nothing of the plate, which is .* in metres",
        ),
        (
            {"shape": "rectangle", "size": [5e-4, 5e-4], "angle": 45, "centre": [0.01, 0.0]},
            r"hole\[0\]: cuts out no module",
        ),
    ],
)
def test_holes_that_are_none_are_refused(hole: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        outlines.body(_plate(hole))
