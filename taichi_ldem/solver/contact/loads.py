"""Declaration of the loads on the plate."""

from typing import TYPE_CHECKING

from taichi_ldem.scene import Load as Table
from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact.declaration import Body, Observable

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.loads import Loads as Kernels


class Loads(Body):
    """Forces on nodes of the plate, and their prescribed motions."""

    name = "loads"
    absent = "loads (no [[load]])"
    dissipates = False
    follows = True

    def observables_in(self, scene: Scene) -> tuple[Observable, ...]:
        """Resultant and mean displacement of each load."""
        found = []
        for load in scene.loads:
            force, way = load.columns
            along = "along its direction"
            found.append(Observable(force, f"force of {load.name}", "N", along))
            found.append(Observable(way, f"mean displacement of {load.name}", "m", along))
        return tuple(found)

    def table(self, scene: Scene) -> tuple[Table, ...] | None:
        """The tables [[load]]."""
        return scene.loads or None

    def without_friction(self, scene: Scene) -> str:
        """Loads have no surface."""
        return ""

    def works(self, scene: Scene) -> bool:
        """Their work comes from outside."""
        return bool(scene.loads)

    def kernels(self) -> "type[Kernels]":
        """The kernels' class."""
        from taichi_ldem.solver.contact.kernels.loads import Loads as Kernels

        return Kernels


LOADS = Loads()
"""Forces on nodes of the plate, and their prescribed motions."""
