"""Bodies that are given by their surface: the base of the striker, the supports and the floor."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import taichi as ti

from taichi_ldem.errors import SceneError
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.solver.contact.kernels.body import CHUNK, SLACK, RigidBody
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.dynamics import Dynamics

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene


def list_capacity(lattice: Lattice, diameter: float, *, along_y: bool) -> int:
    """Largest number of listed nodes of a body of a diameter (m).

    It is the number in a column of twice the diameter plus four thicknesses, for a cylinder along y
    over the whole width, and at most the number of all nodes.
    """
    nx, ny, nz = lattice.modules
    across = 2 * diameter / lattice.spacing + 4 * nz
    plan = min(across, nx + 1) * (ny + 1) if along_y else max(across**2, 10_000)
    return int(min(plan, (nx + 1) * (ny + 1)) * (2 * nz + 1))


def refuse_unseen(
    lattice: Lattice,
    name: str,
    diameter: float,
    axes: Sequence[Sequence[float]],
    *,
    along_y: bool,
    ring: float = 0.0,
) -> None:
    """Refuse a body that fits between the nodes: it would go through the plate unseen.

    Seen along z, the nodes of a regular lattice leave holes of one module's diameter. So only
    bodies below two modules are looked at, which also holds for perturbed nodes and outlines.

    Args:
        name: of the body's table.
        diameter: m.
        axes: (x, y) of each axis along z that is part of the body, m.
        along_y: whether the body is longer than the plate is wide, so that y does not count.
        ring: radius of the circle around each axis along which the body extends, m.

    Raises:
        SceneError: no node lies within half the diameter of an axis.
    """
    if diameter >= 2 * lattice.spacing:
        return
    place = lattice.positions()[lattice.exists()]
    for axis in axes:
        away = place[:, :2] - axis
        distance = np.abs(away[:, 0]) if along_y else np.abs(np.hypot(*away.T) - ring)
        if distance.min() > diameter / 2:
            raise SceneError(
                f"{name}.diameter = {diameter:g}: there is no node of the plate in its way at "
                f"x = {axis[0]:.6g}, y = {axis[1]:.6g}; give at least {2 * distance.min():.4g}, "
                f"better several modules of {lattice.spacing:.4g}"
            )


@ti.data_oriented
class SurfaceBody(RigidBody):
    """A body that is given by the signed distance of a point to its surface.

    A node that would get inside is moved to the nearest point of the surface. Debris that is hit by
    other debris may get inside before it is listed. Moving it out in one step would give it energy
    (half a module in a step is a kilometre a second), so it is only kept from getting deeper, and
    leaves freely.

    An elastic landing turns the node back before it gets inside: seen from the body, its velocity
    along the normal half a step after t_n is the opposite of that half a step before. The works of
    its impulse on node and body, taken with the means of these velocities, then cancel exactly, for
    any number of nodes and any mass of the body. A node that rests on the body has no velocity
    before, so it stays; one that pulls away from it is free.
    """

    touches_few: ClassVar[bool] = True
    """Whether so few nodes are near that on the CPU one thread is faster than all."""

    def __init__(self, dynamics: Dynamics, scene: "Scene"):
        self.elastic = scene.lands_elastically
        super().__init__(dynamics, self.layout_of(dynamics, scene))

    @ti.func
    def surface(self, position, displacement):
        """Signed distance of a point to the surface (m, negative inside) and the outward normal.

        Args:
            displacement: of the body, m.
        """
        return position.norm(), position

    @ti.func
    def displacement_after(self, time_step):
        """The body's displacement at the end of the step, m; 0 for one that does not move."""
        return ti.cast(0.0, ti.f64)

    @ti.func
    def flight(self, time_step):
        """The body's displacement at the end of the step without contact, m."""
        return self.displacement_after(time_step)

    @ti.func
    def near(self, position, margin):
        """Whether a point is within a margin of the surface."""
        distance, _ = self.surface(position, self.displacement_before())
        return distance < margin

    @ti.func
    def overlap(self, number, now, spacing, displacement):
        """Increase of a listed node's depth in the body, m, and the surface's normal there."""
        s, k, j, i = self.site_of(number)
        rest = self.rest_position(s, k, j, i, spacing)
        new = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
        distance, normal = self.surface(rest + new, displacement)
        depth = -distance
        if depth > SLACK * spacing:
            old = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
            distance_before, _ = self.surface(rest + old, self.displacement_before())
            before = -distance_before
            if before > SLACK * spacing:
                depth -= before
        return depth, normal

    @ti.func
    def turned_back(self, number, now, spacing, time_step, displacement):
        """Way along the normal by which an elastic landing changes a step, m, and the normal.

        Whether a node lands follows from the free flights, so that every part of the step has the
        same landings.
        """
        s, k, j, i = self.site_of(number)
        new = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
        place = self.rest_position(s, k, j, i, spacing) + new
        distance, normal = self.surface(place, self.flight(time_step))
        way = ti.cast(0.0, ti.f64)
        if distance < 0:
            old = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
            both = self.seen_from(new - old, displacement) + self.last_way(number, time_step)
            way = -both.dot(normal)
        return way, normal

    @ti.func
    def last_way(self, number, time_step):
        """Way of a node in the step before, as it is seen from the body, m."""
        velocity = ti.cast(self.before[number], ti.f64)
        velocity.z += self.velocities()[1]  # a body moves towards -z
        return ti.cast(time_step, ti.f64) * velocity

    @ti.func
    def pushed(self, number, now, spacing, time_step, displacement):
        """Way by which the body pushes a listed node along its normal, m, and the normal."""
        way, normal = ti.cast(0.0, ti.f64), vec3d(0.0, 0.0, 1.0)
        if ti.static(self.elastic):
            way, normal = self.turned_back(number, now, spacing, time_step, displacement)
        else:
            way, normal = self.overlap(number, now, spacing, displacement)
        return way, normal

    @ti.func
    def sliding(self, number, now, target, normal, displacement):
        """Way that a node slides along the surface in this step without friction, m.

        Args:
            target: displacement of the node on the surface at the end of the step, m.
            displacement: of the body then, m.
        """
        s, k, j, i = self.site_of(number)
        slid = target - ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
        slid = self.seen_from(slid, displacement)
        return slid - slid.dot(normal) * normal

    @ti.func
    def seen_from(self, way, displacement):
        """A way of this step as it is seen from the body, which moves to a displacement."""
        way.z += displacement - self.displacement_before()  # a body moves towards -z
        return way

    @ti.func
    def push_out(self, now, spacing, time_step, damping):
        """Put every node that is inside the body on its surface and store the works by chunks."""
        ti.loop_config(serialize=self.dynamics.on_cpu and self.touches_few)
        for chunk in range(self.turns()):
            works = self.no_works()
            displacement = self.displacement_after(time_step)
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                s, k, j, i = self.site_of(number)
                depth, normal = self.pushed(number, now, spacing, time_step, displacement)
                if depth > 0:
                    new = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
                    target = new + depth * normal
                    if ti.static(self.rubs):
                        slid = self.sliding(number, now, target, normal, displacement)
                        target -= self.braking(slid, depth) * slid
                    works += self.put(number, now, time_step, damping, target)
                self.before[number] = self.dynamics.node_velocity(s, k, j, i)
            if chunk < self.chunks():
                self.store_chunk(chunk, works)
