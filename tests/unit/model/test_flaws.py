"""Flaws of any orientation: bars that cross them, against their definition and each other."""

import numpy as np
import pytest
from support.reference import Body

from taichi_ldem.model import flaws
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scene.specimen import Notch

BLOCK = (5, 4, 4)


def _cut(lattice: Lattice, flaw: flaws.Flaw, body: Body) -> np.ndarray:
    """(bars,) whether each bar of a body is cut."""
    bits = lattice.bars_through(flaw)[..., None] >> np.arange(14) & 1
    return np.asarray(body.bar_values(bits, lattice.bar_midpoints) == 1)


def test_a_parallelogram_along_the_axes_cuts_what_the_rectangle_does() -> None:
    lattice = Lattice(prism(*BLOCK), 0.5)
    rng = np.random.default_rng(5)
    for _ in range(30):
        axis = int(rng.integers(3))
        low, position = rng.uniform(-1.5, 0.5, 2), float(rng.integers(-3, 4)) / 4
        high = low + rng.uniform(0.2, 2.0, 2)
        corners = np.insert([low, (high[0], low[1]), (low[0], high[1])], axis, position, axis=1)
        np.testing.assert_array_equal(
            lattice.bars_through(flaws.parallelogram(corners)),
            lattice.bars_crossing(axis, position, tuple(low), tuple(high)),
        )


def test_a_notch_at_45_degrees_is_one_along_the_axes_of_a_turned_specimen() -> None:
    lattice, turn = Lattice(prism(8, 8, 3), 1.0), np.pi / 4
    for position, (a, b) in ((0.23, (-1.3, 2.1)), (-1.4, (-9.0, 0.4)), (0.0, (0.3, 2.0))):
        corners = np.array([[position, a, -1.0], [position, b, -1.0], [position, a, 9.0]])
        slanted = flaws.parallelogram(flaws.turned(corners, -turn))
        turned = lattice.bars_crossing(0, position, (a, -1.0), (b, 9.0), turn)
        assert turned.any()
        np.testing.assert_array_equal(lattice.bars_through(slanted), turned)


@pytest.mark.parametrize("flaw", ["parallelogram", "penny"])
def test_a_slanted_flaw_cuts_the_bars_that_go_through_it(flaw: str) -> None:
    """Counted from the nodes' places, bar by bar, with another formula."""
    lattice, body = Lattice(prism(*BLOCK), 1.0), Body(prism(*BLOCK), 1.0)
    first, second = body.positions[body.ends].transpose(1, 0, 2)
    points = np.array([[-1.3, -1.1, 0.6], [1.6, -0.9, 1.9], [-1.2, 1.3, 2.7]])
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    centre = points[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (normal @ (centre - first).T) / (normal @ (second - first).T)
    hit = first + along[:, None] * (second - first)
    if flaw == "penny":
        cut = _cut(lattice, flaws.penny(centre, 3.0, -7.0 * normal), body)
        inside = np.linalg.norm(hit - centre, axis=1) <= 1.5
    else:
        cut = _cut(lattice, flaws.parallelogram(points), body)
        sides = np.stack([points[1] - centre, points[2] - centre], axis=1)
        shares = np.linalg.lstsq(sides, (hit - centre).T, rcond=None)[0]
        inside = ((shares >= 0) & (shares <= 1)).all(axis=0)
    np.testing.assert_array_equal(cut, inside & (along >= 0) & (along < 1))
    assert 10 < cut.sum() < len(cut) / 2


def test_mirrored_slanted_flaws_through_nodes_cut_mirrored_bars() -> None:
    lattice, body = Lattice(prism(6, 4, 4), 1.0), Body(prism(6, 4, 4), 1.0)
    points = np.array([[1.0, -2.0, 0.0], [1.0, -2.0, 4.0], [3.0, 0.0, 0.0]])  # x - y = 3
    middles = body.positions[body.ends].mean(axis=1)
    found = [
        middles[_cut(lattice, flaws.parallelogram(points * mirror), body)] * mirror
        for mirror in ([1, 1, 1], [-1, 1, 1], [-1, -1, 1])
    ]
    assert len(found[0]) > 20
    for other in found[1:]:
        assert {tuple(place) for place in found[0]} == {tuple(place) for place in other}


def test_the_rim_of_a_notch_is_its_edge_in_order() -> None:
    corners = [(0.0, 1.0, 0.0), (0.0, 3.0, 0.0), (0.0, 3.0, 2.0), (0.0, 1.0, 2.0)]
    points = (corners[0], corners[1], corners[3])
    ends = {"from": (1.0, 0.0), "to": (3.0, 2.0)}
    for form in ({"normal": "x", "position": 0.0, **ends}, {"points": points}):
        found = flaws.rim(Notch.model_validate(form)).tolist()
        assert sorted(found) == sorted(map(list, corners))
        sides = np.linalg.norm(np.diff([*found, found[0]], axis=0), axis=1)
        np.testing.assert_allclose(sides, 2.0)  # no diagonal
    disc = Notch(centre=(1.0, 2.0, 3.0), diameter=4.0, direction=(1.0, -2.0, 2.0))
    around = flaws.rim(disc) - (1.0, 2.0, 3.0)
    np.testing.assert_allclose(np.linalg.norm(around, axis=1), 2.0)
    np.testing.assert_allclose(around @ (1.0, -2.0, 2.0), 0.0, atol=1e-12)
