"""Declaration of the grips of a tension test."""

from typing import TYPE_CHECKING

from taichi_ldem.scene import Grips as Table
from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact.declaration import Body, Observable

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.grips import Grips as Kernels


class Grips(Body):
    """Two grips that pull a specimen apart, and the extensometer between them."""

    name = "grips"
    absent = "grips and gauge (no [grips])"
    observables = (
        Observable("grip_displacement_m", "separation of the grips", "m", "apart"),
        Observable("grip_force_n", "mean pull of the grips", "N", "tension"),
        Observable("gauge_strain", "strain along the gauge length", "", "elongation"),
        Observable("gauge_lateral_strain", "strain across the gauge length", "", "elongation"),
    )
    dissipates = False
    force = "grip_force_n"

    def table(self, scene: Scene) -> Table | None:
        """The table [grips]."""
        return scene.grips

    def works(self, scene: Scene) -> bool:
        """The grips' pull is work from outside."""
        return scene.grips is not None

    def kernels(self) -> "type[Kernels]":
        """The kernels' class."""
        from taichi_ldem.solver.contact.kernels.grips import Grips as Kernels

        return Kernels


GRIPS = Grips()
