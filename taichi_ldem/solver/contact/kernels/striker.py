"""The falling striker: a rigid nose on a shaft, which moves along -z only."""

from typing import TYPE_CHECKING, Any

import numpy as np
import taichi as ti

from taichi_ldem.solver.contact.kernels.body import (
    CHUNK,
    Energies,
    Layout,
    Reading,
)
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.contact.kernels.surface import (
    SurfaceBody,
    list_capacity,
    refuse_unseen,
)
from taichi_ldem.solver.contact.noses import nose_of
from taichi_ldem.solver.dynamics import Dynamics, field_apart

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

# the entries of ``numbers``
MASS, RADIUS, GRAVITY, AXIS_X, AXIS_Y, TIP = range(6)
# the entries of ``state``; displacement and velocity are positive towards the plate
DISPLACEMENT, VELOCITY, VELOCITY_BEFORE, TRIAL = range(4)


@ti.data_oriented
class Striker(SurfaceBody):
    """Rigid nose on a shaft of its own diameter; moves along -z.

    The step is implicit in the striker's velocity: with all touching nodes on its surface their
    impulses are linear in its change of velocity, one scalar equation. A light striker is
    therefore as stable as a heavy one. With friction the equation is linearised about the free
    flight: nodes stick or slide as they would there.

    Attributes:
        table: the scene's table.
        state: (4,) f64: displacement (m), velocity at n + 1/2 and n - 1/2 (m/s), trial change of
            velocity (m/s), positive towards the plate.
    """

    needs_sums = True

    def __init__(self, dynamics: Dynamics, scene: "Scene", time_step: float):
        assert scene.striker is not None
        self.nose_surface = ti.func(nose_of(scene.striker.shape).surface)
        super().__init__(dynamics, self.layout_of(dynamics, scene))
        self.state = field_apart(ti.f64, 4)
        self.start(scene, time_step)

    @classmethod
    def layout_of(cls, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The layout of the scene's striker.

        Raises:
            SceneError: it fits between the nodes.
        """
        table, lattice = scene.striker, dynamics.lattice
        assert table is not None
        tip = lattice.modules[2] * dynamics.spacing + table.gap
        numbers = (table.mass, 0.5 * table.diameter, table.gravity, *table.position, tip)
        along_y = nose_of(table.shape).along_y
        refuse_unseen(lattice, "striker", table.diameter, [table.position], along_y=along_y)
        capacity = list_capacity(lattice, table.diameter, along_y=along_y)
        return Layout(numbers, capacity, table.shape, friction=table.friction)

    def start(self, scene: "Scene", time_step: float, displacement: float = 0.0) -> None:
        """Set the initial velocity, at a displacement (m) from the initial position."""
        assert scene.striker is not None
        self.table = scene.striker
        velocity = self.table.velocity - 0.5 * time_step * self.table.gravity
        self.state.from_numpy(np.array([displacement, velocity, velocity, 0.0]))

    # -- the step
    # -------------------------------------------------------------------------------------

    @ti.func
    def surface(self, position, displacement):
        """Signed distance of a point to the nose and its shaft, and the outward normal."""
        height = self.numbers[TIP] + self.numbers[RADIUS] - displacement
        centre = vec3d(self.numbers[AXIS_X], self.numbers[AXIS_Y], height)
        distance, normal = self.nose_surface(position - centre, self.numbers[RADIUS])
        return distance, normal

    @ti.func
    def speed(self):
        """The striker's speed, m/s."""
        return ti.cast(ti.abs(self.state[VELOCITY]), float)

    @ti.func
    def displacement_before(self):
        """The striker's displacement at the start of the step, m."""
        return self.state[DISPLACEMENT]

    @ti.func
    def velocities(self):
        """The striker's velocities in the last two half steps, m/s."""
        return self.state[VELOCITY_BEFORE], self.state[VELOCITY]

    @ti.func
    def free_velocity(self, time_step):
        """The striker's velocity half a step from now without contact, m/s."""
        return self.state[VELOCITY] + ti.cast(time_step, ti.f64) * self.numbers[GRAVITY]

    @ti.func
    def displacement_after(self, time_step):
        """The striker's displacement at the end of the step, m."""
        return self.state[DISPLACEMENT] + ti.cast(time_step, ti.f64) * (
            self.free_velocity(time_step) + self.state[TRIAL]
        )

    @ti.func
    def rubbed(self, number, now, depth, normal, flight):
        """Way along z that the striker moves a node in free flight, m, with friction.

        Returns:
            the way, and by how much it falls where the striker moves less far, over that.
        """
        s, k, j, i = self.site_of(number)
        new = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
        slid = self.sliding(number, now, new + depth * normal, normal, flight)
        stopped = self.braking(slid, depth)
        moved = depth * normal.z - stopped * slid.z
        share = ti.cast(1.0, ti.f64)  # a node that sticks goes all the way with the striker
        if stopped < 1:
            share = ti.max(normal.z * moved / depth, 0.0)
        return moved, share

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Put penetrating nodes on the surface and slow the striker by their impulses."""
        dt = ti.cast(time_step, ti.f64)
        ti.loop_config(serialize=self.dynamics.on_cpu)
        for chunk in range(self.turns()):
            # with every touching node on the surface: M dV = sum(m (depth - n_z dt dV) n_z) / dt
            driven, inertia = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
            flight = self.state[DISPLACEMENT] + dt * self.free_velocity(time_step)
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                depth, normal = self.overlap(number, now, spacing, flight)
                if depth > 0:
                    s, k, j, i = self.site_of(number)
                    mass = self.inertia(s, k, j, i, time_step, damping)
                    if ti.static(self.rubs):
                        moved, share = self.rubbed(number, now, depth, normal, flight)
                        driven += mass * moved / dt
                        inertia += mass * share
                    else:
                        driven += mass * depth * normal.z / dt
                        inertia += mass * normal.z**2
            self.chunk_sums[chunk] = ti.Vector([driven, inertia, 0.0, 0.0], ti.f64)
        ti.loop_config(serialize=True)  # a task of its own, after the chunks'
        for _ in range(1):
            total = self.total()
            self.state[TRIAL] = total[0] / (self.numbers[MASS] + total[1])
        self.push_out(now, spacing, time_step, damping)
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = self.total()
            before = self.state[VELOCITY]
            after = self.free_velocity(time_step) + total[0] / self.numbers[MASS]
            self.state[VELOCITY_BEFORE] = before
            self.state[VELOCITY] = after
            self.state[DISPLACEMENT] = self.state[DISPLACEMENT] + dt * after
            # the impulse on the plate along +z acts on the striker along -z, its own direction
            self.book(
                total[0],
                total[1],
                total[1] + 0.5 * total[0] * before,
                total[2] + 0.5 * total[0] * after,
            )

    # -- samples
    # -------------------------------------------------------------------------------------

    def motion(self) -> tuple[float, float, float]:
        """Displacement (m), velocities at n - 1/2 and n + 1/2 (m/s), towards the plate."""
        state = self.state.to_numpy()
        return float(state[DISPLACEMENT]), float(state[VELOCITY_BEFORE]), float(state[VELOCITY])

    def observe(self, reading: Reading, force: float, time: float, now: int) -> tuple[Any, ...]:
        """Displacement, velocity, force on the striker, kinetic energy."""
        velocity = 0.5 * (reading.velocity_before + reading.velocity_after)
        return reading.displacement, velocity, -force, self.energies(reading).kinetic

    def energies(self, reading: Reading) -> Energies:
        """Kinetic energy of the striker, its loss in contact, and the work of gravity on it."""
        mass, gravity = self.table.mass, self.table.gravity
        return Energies(
            kinetic=0.5 * mass * reading.velocity_before * reading.velocity_after,
            contact=reading.lost,
            external=mass * gravity * reading.displacement,
        )
