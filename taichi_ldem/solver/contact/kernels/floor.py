"""The floor: a rigid plane under the plate."""

from typing import TYPE_CHECKING

import numpy as np
import taichi as ti

from taichi_ldem.solver.contact.kernels.body import Layout
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.contact.kernels.surface import SurfaceBody
from taichi_ldem.solver.dynamics import Dynamics

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

# the entry of ``numbers``
HEIGHT = 0


@ti.data_oriented
class Floor(SurfaceBody):
    """A fixed plane; its list has room for all nodes, as all pieces of a plate may come to it."""

    touches_few = False
    meets_others = True

    def layout_of(self, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The layout of the scene's floor."""
        table = scene.floor
        assert table is not None
        nodes = int(np.count_nonzero(dynamics.lattice.exists()))
        return Layout((-table.gap,), nodes, friction=table.friction)

    @ti.func
    def surface(self, position, displacement):
        """Height of a point above the floor, and the normal, which points up."""
        return position.z - self.numbers[HEIGHT], vec3d(0.0, 0.0, 1.0)

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Put penetrating nodes on the floor, which does not move."""
        self.push_out(now, spacing, time_step, damping)
        self.book_chunks()
