"""Which nodes rings hold; rings that are narrower than a module are refused."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.blocks import SPACING
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import Clamp
from taichi_ldem.solver.contact.kernels.rings import fixed_nodes, refuse_narrow


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


@pytest.mark.parametrize("through", [False, True])
def test_seeds_of_a_perturbed_lattice_share_the_room_for_held_nodes(through: bool) -> None:
    """So they share kernels, too, which take minutes to compile."""
    mask, circles = np.ones((2, 16, 16), dtype=bool), (5.2 * SPACING, 7.6 * SPACING, 2 * SPACING)
    held, room = set(), set()
    for seed in range(8):
        dynamics: Any = SimpleNamespace(lattice=Lattice(mask, SPACING, True, 0.2, seed))
        nodes = fixed_nodes(dynamics, circles, through=through)
        most = fixed_nodes(dynamics, circles, through=through, any_seed=True)
        assert set(nodes) <= set(most)
        held.add(len(nodes))
        room.add(len(most))
    assert len(held) > 1
    assert len(room) == 1


def test_a_regular_lattice_has_room_for_its_own_nodes_only() -> None:
    mask, circles = np.ones((2, 16, 16), dtype=bool), (5.2 * SPACING, 7.6 * SPACING, 2 * SPACING)
    dynamics: Any = SimpleNamespace(lattice=Lattice(mask, SPACING))
    nodes = fixed_nodes(dynamics, circles, through=False)
    np.testing.assert_array_equal(
        nodes, fixed_nodes(dynamics, circles, through=False, any_seed=True)
    )
