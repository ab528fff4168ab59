"""Rings that are narrower than a module are refused."""

import pytest
from support.blocks import SPACING
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Clamp
from taichi_ldem.solver.contact.kernels.rings import refuse_narrow


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
