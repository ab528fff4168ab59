"""Striker and supports that are finer than the lattice are refused where they meet no node."""

import pytest
from support.blocks import SPACING
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.model.lattice import Lattice, disc, prism
from taichi_ldem.solver.contact.kernels.surface import refuse_unseen

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
