"""Declaration of the clamp, and its drawing."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from taichi_ldem.scene import Clamp, Scene
from taichi_ldem.solver.contact.declaration import Body, Observable
from taichi_ldem.solver.contact.drawing import Drawing, Floats

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.rings import Rings as Kernels


class Rings(Body):
    """Rings on both faces of the plate, or permanently fixed nodes."""

    name = "rings"
    absent = "clamp contact (no [clamp], or free)"
    observables = (
        Observable("ring_force_n", "force of the clamp on the plate", "N", "against the striker"),
    )
    holds = True

    def table(self, scene: Scene) -> Clamp | None:
        """The table [clamp], where it holds the plate."""
        return scene.clamp if scene.held else None

    def kernels(self) -> "type[Kernels]":
        """The kernels' class."""
        from taichi_ldem.solver.contact.kernels.rings import Rings as Kernels

        return Kernels

    def drawing(self, scene: Scene, history: Mapping[str, Floats], time: float) -> Drawing | None:
        """The circles of the clamp; none around a beam on supports."""
        clamp = self.table(scene)
        if clamp is None or scene.is_beam:
            return None
        both = (clamp.inner_diameter, clamp.outer_diameter if clamp.kind != "rim" else None)
        radii = tuple(diameter / 2 for diameter in both if diameter is not None)
        return Drawing("dashed: the clamp", radii=radii, thickness=scene.plate.actual_size[2])


RINGS = Rings()
