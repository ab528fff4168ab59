"""The supports of a beam: two fixed cylinders."""

from typing import TYPE_CHECKING

import taichi as ti

from taichi_ldem.solver.contact.kernels.body import Layout
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.contact.kernels.surface import (
    SurfaceBody,
    list_capacity,
    refuse_unseen,
)
from taichi_ldem.solver.dynamics import Dynamics

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

# the entries of ``numbers``
HALF_SPAN, RADIUS = range(2)


@ti.data_oriented
class Supports(SurfaceBody):
    """Two fixed cylinders along y under the plate, whose lower face they touch at the start.

    Without friction they are like rollers: there is no tangential work and no thrust along the
    beam. Each stands on a flat shaft, like the striker's cylinder upside down.
    """

    def __init__(self, dynamics: Dynamics, scene: "Scene", time_step: float):
        super().__init__(dynamics, self.layout_of(dynamics, scene))

    @classmethod
    def layout_of(cls, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The layout of the scene's supports.

        Raises:
            SceneError: one of them fits between the nodes.
        """
        table = scene.supports
        assert table is not None
        axes = [(side * 0.5 * table.span, 0.0) for side in (-1, 1)]
        refuse_unseen(dynamics.lattice, "supports", table.diameter, axes, along_y=True)
        capacity = 2 * list_capacity(dynamics.lattice, table.diameter, along_y=True)
        numbers = (0.5 * table.span, 0.5 * table.diameter)
        return Layout(numbers, capacity, friction=table.friction)

    @ti.func
    def surface(self, position, displacement):
        """Signed distance of a point to the support on its side, and the outward normal."""
        side = ti.select(position.x < 0, ti.cast(-1.0, ti.f64), ti.cast(1.0, ti.f64))
        height = ti.max(position.z + self.numbers[RADIUS], 0.0)
        across = ti.cast(0.0, ti.f64)
        offset = vec3d(position.x - side * self.numbers[HALF_SPAN], across, height)
        length = ti.max(offset.norm(), 1e-12 * self.numbers[RADIUS])
        return length - self.numbers[RADIUS], offset / length

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Put penetrating nodes on the surface of the supports, which do not move."""
        self.push_out(now, spacing, time_step, damping)
        self.book_chunks()
