"""Declaration of the supports under the plate, and their drawing."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.scene import Scene
from taichi_ldem.scene import Supports as Table
from taichi_ldem.solver.contact.declaration import Body, Observable
from taichi_ldem.solver.contact.drawing import Drawing, Floats, turned

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.supports import Supports as Kernels


class Supports(Body):
    """Fixed cylinders, a ring or balls under the plate."""

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

    def drawing(self, scene: Scene, history: Mapping[str, Floats], time: float) -> Drawing | None:
        """A ring or balls; none under a beam, which is seen from the side."""
        table = self.table(scene)
        if table is None or scene.is_beam:
            return None
        return Drawing("blue: the supports", supports_faces(table), below=True)


def supports_faces(table: Table) -> Floats:
    """(F, 4, 3) of a ring or balls whose tops touch the plate's lower face, m."""
    radius, circle = table.diameter / 2, table.across / 2
    angle = np.linspace(-np.pi / 2, np.pi / 2, 17)
    if table.count is None:
        angle = np.linspace(-np.pi, np.pi, 33)
        return turned(circle + radius * np.cos(angle), radius * (np.sin(angle) - 1.0))
    ball = turned(radius * np.cos(angle), radius * (np.sin(angle) - 1.0), 24)
    places = 2 * np.pi * np.arange(table.count) / table.count
    return np.concatenate([ball + circle * np.array([np.cos(a), np.sin(a), 0.0]) for a in places])


SUPPORTS = Supports()
