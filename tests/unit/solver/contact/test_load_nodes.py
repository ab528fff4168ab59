"""The nodes of loads and their shares; no Taichi."""

from typing import Any

import numpy as np
import pytest
from support.blocks import SPACING, block_scene
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.model.cell import MODULE
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.solver.contact.load_nodes import LoadNodes

LATTICE = Lattice(prism(4, 3, 2), SPACING)
MASSES = np.moveaxis(MODULE.node_shares[LATTICE.code], -1, 0)
PULL = {"face": "+x", "direction": "x"}
FAR = [[1.0, 1.0, 1.0], [2.0, 2.0, 2.0]]


def nodes_of(*loads: dict[str, Any]) -> LoadNodes:
    return LoadNodes.of(LATTICE, MASSES, block_scene(4, 3, 2, load=list(loads)).loads)


def test_a_node_is_listed_once_with_its_forces_before_its_motions() -> None:
    held = {"face": "-y", "velocity": 0.0, "direction": "y"}
    found = nodes_of(held, PULL | {"traction": 1.0}, PULL | {"force": 1.0})
    assert (np.diff(found.nodes) > 0).all()
    assert found.first[-1] == len(found.which) == 15 + 12 + 12
    shared = np.flatnonzero(np.diff(found.first) == 3)
    assert len(shared) == 3  # the edge between the two faces
    for node in shared:
        assert found.which[found.first[node] : found.first[node + 1]].tolist() == [1, 2, 0]
    areas = found.shares[found.which == 1]
    assert found.areas == (0.0, pytest.approx(6 * SPACING**2), 0.0)
    assert areas.sum() == pytest.approx(6 * SPACING**2)
    for n in range(3):
        assert found.weights[found.which == n].sum() == pytest.approx(1.0)
    # corner nodes of the face are half as heavy as those on its edges
    masses = found.shares[found.which == 2]
    assert masses.max() == pytest.approx(4 * masses.min())


@pytest.mark.parametrize(
    ("loads", "message"),
    [
        ([{"box": FAR, "force": 1.0, "direction": "x"}], "load[0].box = [[1.0, 1.0, 1.0], [2.0"),
        ([PULL | {"traction": 1.0, "outer_diameter": 1e-9}], "outer_diameter = 1e-09: holds no"),
        (
            [{"box": [[0, -3e-4, 0], [0, -2e-4, 1e-3]], "traction": 1.0, "direction": "x"}],
            "holds no surface of the plate",
        ),
        (
            [PULL | {"velocity": 1.0}, PULL | {"velocity": 0.0, "direction": [1, 1, 0]}],
            "load[1].velocity: load[0] prescribes the motion of some of its nodes already",
        ),
        (
            [PULL | {"velocity": 1.0, "lateral": "held"}, PULL | {"velocity": 0.0, "face": "+y"}],
            "load[1].velocity: load[0] prescribes the motion of some of its nodes already",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_region_without_nodes_and_two_motions_are_refused_in_one_line(
    loads: list[dict[str, Any]], message: str
) -> None:
    with pytest.raises(SceneError) as error:
        nodes_of(*loads)
    assert message in one_line(error)


def test_motions_at_right_angles_of_free_nodes_go_together() -> None:
    sides = [PULL | {"velocity": 0.0}, PULL | {"face": "-y", "velocity": 0.0, "direction": "y"}]
    assert len(nodes_of(*sides).nodes) == 12 + 15 - 3
