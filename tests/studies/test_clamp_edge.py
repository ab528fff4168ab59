"""Where a clamp begins: the nodes that the study holds, and the order of errors that it prints."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.blocks import SPACING, block_scene

from studies import clamp_edge
from taichi_ldem.model.lattice import Lattice, prism

INNER, OUTER = 2.6e-3, 4.4e-3


@pytest.mark.parametrize("kind", ["rim", "rings"])
@pytest.mark.parametrize("edge", [0.0, 0.5])
def test_the_study_holds_the_nodes_between_the_circles(
    taichi: None, kind: str, edge: float
) -> None:
    """A rim has no outer circle and holds the whole thickness, rings the faces only."""
    clamp = {"kind": kind, "inner_diameter": 2 * INNER}
    scene = block_scene(
        20, 20, 2, clamp=clamp | ({"outer_diameter": 2 * OUTER} if kind == "rings" else {})
    )
    lattice = Lattice(prism(20, 20, 2), SPACING)
    fixed = clamp_edge.held(scene, SimpleNamespace(lattice=lattice), edge)
    places = lattice.positions().reshape(-1, 3)
    held = np.zeros(len(places), dtype=bool)
    held[fixed] = True
    radius, exists = np.hypot(places[:, 0], places[:, 1]), lattice.exists().ravel()
    wanted = exists & (radius >= INNER - edge * SPACING)
    if kind == "rings":
        wanted &= radius <= OUTER + edge * SPACING
        wanted &= np.isclose(places[:, 2], 0.0) | np.isclose(places[:, 2], 2 * SPACING)
    np.testing.assert_array_equal(held, wanted)
    assert 0 < held.sum() < exists.sum()


def test_the_table_has_the_errors_and_the_order_in_which_they_fall() -> None:
    errors = {
        edge: {n: size / n**order for n in (3, 4, 6)}
        for edge, size, order in ((0.0, 0.06, 1), (0.5, 0.18, 2))
    }
    lines = clamp_edge.table(errors, [3, 4, 6, 8]).splitlines()
    assert (
        lines[0] == "| circles wider by | 3 modules | 4 modules | 6 modules | 8 modules | order |"
    )
    assert lines[2] == "| 0 L | +2.00 % | +1.50 % | +1.00 % |  | 1.0 |"
    assert lines[3] == "| 0.5 L | +2.00 % | +1.12 % | +0.50 % |  | 2.0 |"


def test_the_mean_over_stairs_compares_each_circle_with_its_own_radius() -> None:
    """Frequencies a hundredth above f ~ R^-2 of each circle: an error of 1 % without scatter."""
    spacing_over_radius = 0.1
    errors = {
        edge: 1.01 * (1 - (edge - 0.5) * spacing_over_radius) ** -2 - 1 for edge in (0.1, 0.5, 0.9)
    }
    mean, scatter = clamp_edge.over_stairs(errors, spacing_over_radius, -2.0)
    assert mean == pytest.approx(0.01, rel=1e-12)
    assert scatter == pytest.approx(0.0, abs=1e-14)
