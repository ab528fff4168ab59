"""The supports under the plate: two fixed cylinders, a ring or balls."""

import math
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

# the entries of ``numbers``: half the distance of opposite supports, and half of their thickness
HALF_SPAN, RADIUS, COUNT = range(3)


@ti.data_oriented
class Supports(SurfaceBody):
    """Fixed bodies under the plate, whose lower face they touch at the start.

    Without friction they are like rollers: there is no tangential work and no thrust along the
    plate. Each stands on a shaft of its own width, like a striker upside down.

    Attributes:
        kind: two cylinders, a ring or balls.
    """

    def __init__(self, dynamics: Dynamics, scene: "Scene"):
        assert scene.supports is not None
        self.kind = scene.supports.kind
        super().__init__(dynamics, scene)

    def layout_of(self, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The layout of the scene's supports.

        Raises:
            SceneError: one of them fits between the nodes.
        """
        table, lattice = scene.supports, dynamics.lattice
        assert table is not None
        half, along_y = 0.5 * table.across, table.kind == "cylinders"
        numbers: tuple[float, ...] = (half, 0.5 * table.diameter)
        axes, ring = [(-half, 0.0), (half, 0.0)], 0.0
        capacity = 2 * list_capacity(lattice, table.diameter, along_y=True)
        if not along_y:
            capacity = list_capacity(lattice, 2 * half + table.diameter, along_y=False)
            axes, ring = [(0.0, 0.0)], half
        if table.count is not None:
            turn = 2 * math.pi / table.count
            axes = [
                (half * math.cos(turn * n), half * math.sin(turn * n)) for n in range(table.count)
            ]
            ring, numbers = 0.0, (*numbers, float(table.count))
        refuse_unseen(lattice, "supports", table.diameter, axes, along_y=along_y, ring=ring)
        return Layout(numbers, capacity, table.kind, friction=table.friction)

    @ti.func
    def surface(self, position, displacement):
        """Signed distance of a point to the nearest support, and the outward normal."""
        height = ti.max(position.z + self.numbers[RADIUS], 0.0)
        across = ti.cast(0.0, ti.f64)
        offset = vec3d(position.x, position.y, height)
        if ti.static(self.kind == "cylinders"):
            side = ti.select(position.x < 0, ti.cast(-1.0, ti.f64), ti.cast(1.0, ti.f64))
            offset = vec3d(position.x - side * self.numbers[HALF_SPAN], across, height)
        elif ti.static(self.kind == "ring"):
            away = ti.max(ti.sqrt(position.x**2 + position.y**2), 1e-12 * self.numbers[RADIUS])
            share = (away - self.numbers[HALF_SPAN]) / away
            offset = vec3d(share * position.x, share * position.y, height)
        else:
            turn = 2 * math.pi / self.numbers[COUNT]
            angle = turn * ti.round(ti.atan2(position.y, position.x) / turn)
            offset.x -= self.numbers[HALF_SPAN] * ti.cos(angle)
            offset.y -= self.numbers[HALF_SPAN] * ti.sin(angle)
        length = ti.max(offset.norm(), 1e-12 * self.numbers[RADIUS])
        return length - self.numbers[RADIUS], offset / length

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Put penetrating nodes on the surface of the supports, which do not move."""
        self.push_out(now, spacing, time_step, damping)
        self.book_chunks()
