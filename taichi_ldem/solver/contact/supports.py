"""Declaration of the supports of a beam."""

from typing import TYPE_CHECKING

from taichi_ldem.scene import Scene
from taichi_ldem.scene import Supports as Table
from taichi_ldem.solver.contact.declaration import Body, Observable

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.supports import Supports as Kernels


class Supports(Body):
    """Two fixed cylinders under a beam."""

    name = "supports"
    absent = "support contact (no [supports])"
    observables = (
        Observable("support_force_n", "force of the supports", "N", "against the striker"),
    )

    def table(self, scene: Scene) -> Table | None:
        """The table [supports]."""
        return scene.supports

    def kernels(self) -> "type[Kernels]":
        """The kernels' class."""
        from taichi_ldem.solver.contact.kernels.supports import Supports as Kernels

        return Kernels


SUPPORTS = Supports()
