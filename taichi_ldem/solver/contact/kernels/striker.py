"""The striker on a guide: a rigid nose on a shaft, which moves along -z only."""

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
    from taichi_ldem.scene import Striker as Table

# the entries of ``numbers``; a nose may have one of its own after them
MASS, RADIUS, GRAVITY, AXIS_X, AXIS_Y, TIP, NOSE = range(7)
# the entries of ``state``; displacement and velocity are positive towards the plate
DISPLACEMENT, VELOCITY, VELOCITY_BEFORE, TRIAL = range(4)
# entries of ``state`` after those of every motion, for one that is prescribed
WORK, LATEST_WORK = range(2)


@ti.data_oriented
class Striker(SurfaceBody):
    """Rigid nose on a shaft of its own width; moves along -z.

    The step is implicit in the striker's velocity: with all touching nodes on its surface their
    impulses are linear in its change of velocity, one scalar equation. A light striker is
    therefore as stable as a heavy one. With friction the equation is linearised about the free
    flight: nodes stick or slide as they would there.

    A striker whose motion is prescribed does not change its velocity. What moves it does the work
    that the plate takes from it, which is counted from outside.

    Attributes:
        table: the scene's table. number: of the striker in the scene, from 0.
        prescribed: whether its velocity stays as it is given.
        state: f64: displacement (m), velocity at n + 1/2 and n - 1/2 (m/s), trial change of
            velocity (m/s), positive towards the plate; then, where ``prescribed``, the work of
            what moves it, and that of the latest step (J).
    """

    needs_sums = True

    entries = 4
    """Entries of ``state`` that every motion has."""

    def __init__(self, dynamics: Dynamics, scene: "Scene", number: int = 0):
        self.number, self.table = number, scene.strikers[number]
        self.prescribed = self.table.is_prescribed
        # a striker that comes after another may meet nodes that the other has pushed
        self.meets_others = number > 0
        nose = nose_of(self.table.shape)
        self.nose_surface, self.nose_number = ti.func(nose.surface), nose.number is not None
        super().__init__(dynamics, scene)
        self.state = field_apart(ti.f64, self.entries + 2 * self.prescribed)

    def layout_of(self, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The layout of the scene's striker.

        Raises:
            SceneError: it fits between the nodes.
        """
        table, lattice = scene.strikers[self.number], dynamics.lattice
        nose, radius = nose_of(table.shape), 0.5 * table.diameter
        tip = lattice.modules[2] * dynamics.spacing + table.gap
        own = nose.numbers(table.nose_number, radius)
        numbers = (table.mass or 0.0, radius, table.gravity, *table.position, tip, *own)
        key = "striker" if len(scene.strikers) == 1 else f"striker[{self.number}]"
        ring = 0.5 * (table.ring_diameter or 0.0)
        refuse_unseen(
            lattice, key, table.diameter, [table.position], along_y=nose.along_y, ring=ring
        )
        capacity = list_capacity(lattice, table.width, along_y=nose.along_y)
        return Layout(numbers, capacity, motion_of(table), friction=table.friction)

    def start(self, scene: "Scene", time_step: float, displacement: float = 0.0) -> None:
        """Set the initial velocity, at a displacement (m) from the initial position."""
        self.table = scene.strikers[self.number]
        velocity = -self.table.vector[2] - 0.5 * time_step * self.table.gravity
        start = np.zeros(self.state.shape[0])
        start[: self.entries] = displacement, velocity, velocity, 0.0
        self.state.from_numpy(start)

    # -- the step
    # -------------------------------------------------------------------------------------

    @ti.func
    def surface(self, position, displacement):
        """Signed distance of a point to the nose and its shaft, and the outward normal."""
        height = self.numbers[TIP] + self.numbers[RADIUS] - displacement
        centre = vec3d(self.numbers[AXIS_X], self.numbers[AXIS_Y], height)
        return self.nose_at(position - centre)

    @ti.func
    def nose_at(self, place):
        """The same, of a place that is measured as those of ``Nose``."""
        distance, normal = ti.cast(0.0, ti.f64), place
        if ti.static(self.nose_number):
            distance, normal = self.nose_surface(place, self.numbers[RADIUS], self.numbers[NOSE])
        else:
            distance, normal = self.nose_surface(place, self.numbers[RADIUS])
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
    def flight(self, time_step):
        """The striker's displacement at the end of the step without contact, m."""
        dt = ti.cast(time_step, ti.f64)
        return self.displacement_before() + dt * self.free_velocity(time_step)

    @ti.func
    def displacement_after(self, time_step):
        """The striker's displacement at the end of the step, m."""
        return self.state[DISPLACEMENT] + ti.cast(time_step, ti.f64) * (
            self.free_velocity(time_step) + self.state[TRIAL]
        )

    @ti.func
    def rubbed(self, number, now, depth, normal, flight):
        """How the striker moves a node in free flight, with friction.

        Returns:
            the part of the node's sliding that is stopped, and the way that it slides, m.
        """
        s, k, j, i = self.site_of(number)
        new = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
        slid = self.sliding(number, now, new + depth * normal, normal, flight)
        return self.braking(slid, depth), slid

    @ti.func
    def answer(self, number, now, depth, normal, flight, mass, dt):
        """A node's part of the equation for the striker's change of velocity.

        With every touching node on the surface, M dV = sum(m (depth - n_z dt dV) n_z) / dt.
        """
        parts = ti.Vector([mass * depth * normal.z / dt, mass * normal.z**2, 0.0, 0.0], ti.f64)
        if ti.static(self.rubs):
            stopped, slid = self.rubbed(number, now, depth, normal, flight)
            moved = depth * normal.z - stopped * slid.z
            share = ti.cast(1.0, ti.f64)  # a node that sticks goes all the way with the striker
            if stopped < 1:
                share = ti.max(normal.z * moved / depth, 0.0)
            parts = ti.Vector([mass * moved / dt, mass * share, 0.0, 0.0], ti.f64)
        return parts

    @ti.func
    def try_change(self, total):
        """Set the trial change of velocity from the sums of ``answer``."""
        self.state[TRIAL] = total[0] / (self.numbers[MASS] + total[1])

    @ti.func
    def move(self, total, time_step):
        """Change the striker's motion by the plate's impulses of this step, and book them."""
        before = self.state[VELOCITY]
        after = before
        if ti.static(self.prescribed):
            self.add_work(-total[0] * before)
        else:
            after = self.free_velocity(time_step) + total[0] / self.numbers[MASS]
        self.state[VELOCITY_BEFORE] = before
        self.state[VELOCITY] = after
        self.state[DISPLACEMENT] = self.state[DISPLACEMENT] + ti.cast(time_step, ti.f64) * after
        # the impulse on the plate along +z acts on the striker along -z, its own direction
        self.book(
            total[0],
            total[1],
            total[1] + 0.5 * total[0] * before,
            total[2] + 0.5 * total[0] * after,
        )

    @ti.func
    def add_work(self, work):
        """Add a step's work of what keeps the velocity as it is given."""
        first = ti.static(self.entries)
        self.state[first + LATEST_WORK] = work
        self.state[first + WORK] = self.state[first + WORK] + work

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Put penetrating nodes on the surface and slow the striker by their impulses."""
        dt = ti.cast(time_step, ti.f64)
        if ti.static(not self.prescribed):
            ti.loop_config(serialize=self.dynamics.on_cpu)
            for chunk in range(self.turns()):
                parts = ti.Vector.zero(ti.f64, self.width)
                flight = self.flight(time_step)
                for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                    depth, normal = self.pushed(number, now, spacing, time_step, flight)
                    if depth > 0:
                        s, k, j, i = self.site_of(number)
                        mass = self.inertia(s, k, j, i, time_step, damping)
                        parts += self.answer(number, now, depth, normal, flight, mass, dt)
                self.chunk_sums[chunk] = parts
            ti.loop_config(serialize=True)  # a task of its own, after the chunks'
            for _ in range(1):
                self.try_change(self.total())
        self.push_out(now, spacing, time_step, damping)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.move(self.total(), time_step)

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
        """Kinetic energy of the striker, its loss in contact, and the work from outside on it."""
        if self.prescribed:
            return Energies(contact=reading.lost, external=self.work_of_drive())
        mass, gravity = self.table.mass, self.table.gravity
        assert mass is not None  # the scene refuses a free striker without it
        return Energies(
            kinetic=self.kinetic(mass, reading),
            contact=reading.lost,
            external=mass * gravity * reading.displacement,
        )

    def kinetic(self, mass: float, reading: Reading) -> float:
        """Kinetic energy of the striker at a sample, J."""
        return 0.5 * mass * reading.velocity_before * reading.velocity_after

    def work_of_drive(self) -> float:
        """Work at a sample of what keeps the velocity as it is given, J."""
        state = self.state.to_numpy()
        return float(state[self.entries + WORK] - 0.5 * state[self.entries + LATEST_WORK])


def motion_of(table: "Table") -> str:
    """What of a striker's table is compiled into its kernels, in words."""
    words = (table.shape, "" if table.guided else "not guided", table.is_prescribed * "prescribed")
    return ", ".join(word for word in words if word)
