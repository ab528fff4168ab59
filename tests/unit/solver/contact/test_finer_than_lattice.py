"""Rigid bodies finer than the lattice: refused where they meet no node, or by accident only."""

import pytest
from support.blocks import SPACING, block_scene
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.model.lattice import Lattice, disc, prism
from taichi_ldem.scene import Clamp
from taichi_ldem.solver.contact.kernels.rings import refuse_narrow
from taichi_ldem.solver.contact.kernels.surface import refuse_unseen
from taichi_ldem.solver.contact.striker import STRIKER

PLATE = Lattice(prism(12, 12, 3), SPACING)
BETWEEN, ON = (0.5 * SPACING, 0.0), (0.0, 0.0)  # nodes seen along z lie half a module off, or there


def test_a_striker_that_fits_between_the_nodes_is_refused() -> None:
    with pytest.raises(SceneError) as refused:
        refuse_unseen(PLATE, "striker", 0.8 * SPACING, [BETWEEN], along_y=False)
    assert one_line(refused) == (
        "striker.diameter = 0.0004: there is no node of the plate in its way at x = 0.00025, "
        "y = 0; give at least 0.0005, better several modules of 0.0005"
    )
    refuse_unseen(PLATE, "striker", 0.8 * SPACING, [ON], along_y=False)
    refuse_unseen(PLATE, "striker", SPACING, [BETWEEN], along_y=False)


def test_a_support_that_fits_between_the_nodes_is_refused() -> None:
    # planes of nodes are half a module apart
    one_side = [ON, (3.25 * SPACING, 0.0)]
    with pytest.raises(SceneError, match=r"^supports\.diameter = 0\.0002: .* at x = 0\.001625"):
        refuse_unseen(PLATE, "supports", 0.4 * SPACING, one_side, along_y=True)
    refuse_unseen(PLATE, "supports", 0.5 * SPACING, one_side, along_y=True)


def test_a_striker_beside_the_modules_of_a_disc_is_refused() -> None:
    round_plate = Lattice(disc(12, 12, 3, 10.0), SPACING)
    refuse_unseen(round_plate, "striker", SPACING, [(4.9 * SPACING, 0.0)], along_y=False)
    beside = (6.2 * SPACING, 0.0)  # over the prism that the disc is cut from
    with pytest.raises(SceneError, match="no node of the plate in its way"):
        refuse_unseen(round_plate, "striker", 1.9 * SPACING, [beside], along_y=False)


@pytest.mark.parametrize("kind", ["rings", "bonded"])
def test_a_ring_narrower_than_a_module_is_refused(kind: str) -> None:
    narrow = Clamp(kind=kind, inner_diameter=4e-3, outer_diameter=4.01e-3)
    with pytest.raises(SceneError) as refused:
        refuse_narrow(narrow, SPACING)
    assert one_line(refused) == (
        "clamp.outer_diameter = 0.00401: must be at least 0.005, a ring of one module: a narrower "
        "one holds only the nodes that happen to lie in it"
    )
    refuse_narrow(Clamp(kind=kind, inner_diameter=4e-3, outer_diameter=5e-3), SPACING)
    refuse_narrow(Clamp(kind="rim", inner_diameter=4e-3, outer_diameter=4.01e-3), SPACING)


STRUCK = {"diameter": 0.4e-3, "mass": 1e-3, "velocity": 10.0, "gap": 1e-4}


@pytest.mark.parametrize(
    ("way", "force", "expected"),
    [
        (5e-5, 0.0, "it has come 5e-05 m of striker.gap = 0.0001 in solver.duration = 0.001"),
        (
            2.5e-3,
            0.0,
            "it has passed the top face by 0.0024 m beside all nodes; see striker.position and "
            "striker.diameter, 0.8 modules",
        ),
        (2.5e-3, 1.0, None),
    ],
    ids=["on its way", "passed", "touched"],
)
def test_without_contact_the_reason_is_said(way: float, force: float, expected: str | None) -> None:
    scene = block_scene(12, 12, 3, striker=STRUCK)
    rows = [
        {"striker_displacement_m": 0.0, "striker_force_n": 0.0},
        {"striker_displacement_m": way, "striker_force_n": force},
    ]
    lines = [] if expected is None else [f"the striker never touched the plate: {expected}"]
    assert STRIKER.warnings(scene, rows) == lines
