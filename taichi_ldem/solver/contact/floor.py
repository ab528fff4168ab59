"""Declaration of the floor under the plate."""

from typing import TYPE_CHECKING, Any

from taichi_ldem.scene import Floor as Table
from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact.declaration import Body, Observable

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.floor import Floor as Kernels


class Floor(Body):
    """A rigid plane under the plate."""

    name = "floor"
    absent = "floor contact (no [floor])"
    observables = (Observable("floor_force_n", "force of the floor on the plate", "N", "upwards"),)
    force = "floor_force_n"

    def table(self, scene: Scene) -> Table | None:
        """The table [floor]."""
        return scene.floor

    def kernels(self) -> "type[Kernels]":
        """The kernels' class."""
        from taichi_ldem.solver.contact.kernels.floor import Floor as Kernels

        return Kernels

    def warnings(self, scene: Scene, history: list[dict[str, Any]]) -> list[str]:
        """A line where nothing has ever touched the floor."""
        if scene.floor is None or any(row["floor_force_n"] for row in history):
            return []
        return [
            f"nothing touched the floor: floor.gap = {scene.floor.gap:g} was not crossed in "
            f"solver.duration = {scene.solver.duration:g}; see plate.velocity and plate.gravity"
        ]


FLOOR = Floor()
