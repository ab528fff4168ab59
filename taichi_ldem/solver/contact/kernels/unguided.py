"""The striker without a guide: it also moves along x and y, and does not turn."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.solver.contact.kernels.body import Reading
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.contact.kernels.striker import (
    AXIS_X,
    AXIS_Y,
    GRAVITY,
    MASS,
    RADIUS,
    TIP,
    Striker,
)

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

# the first of three entries of ``state`` each, along x, y and z
DISPLACEMENT, VELOCITY, VELOCITY_BEFORE, TRIAL, DISPLACEMENT_BEFORE, IMPULSE = range(0, 18, 3)


@ti.data_oriented
class UnguidedStriker(Striker):
    """Rigid nose on a shaft, with three translational degrees of freedom.

    The change of velocity of the implicit step is a vector, from three equations: with every
    touching node on the surface, (M + sum(m n n)) dV = -sum(m depth n) / dt. A node that slides
    with friction is moved along n - mu t instead, t being the direction of its sliding, and one
    that sticks goes all the way with the striker.

    The shaft keeps its direction. Without friction that is exact for a sphere, as all forces point
    to its centre.

    Attributes:
        state: f64, along x, y and z each: displacement (m), velocity at n + 1/2 and n - 1/2, trial
            change of velocity (m/s), displacement at the start of the step (m), impulse on the
            plate since the start (N s); then as for ``Striker``.
    """

    sideways = True
    width = 12  # three right sides, and the nine factors of the equations
    entries = 18

    def start(self, scene: "Scene", time_step: float, displacement: float = 0.0) -> None:
        """Set the initial velocity, at a displacement (m) along -z from the initial position."""
        self.table = scene.strikers[self.number]
        down = np.array([0.0, 0.0, -1.0])
        velocity = np.array(self.table.vector) - 0.5 * time_step * self.table.gravity * down
        start = np.zeros(self.state.shape[0])
        for entry, value in (
            (DISPLACEMENT, displacement * down),
            (DISPLACEMENT_BEFORE, displacement * down),
            (VELOCITY, velocity),
            (VELOCITY_BEFORE, velocity),
        ):
            start[entry : entry + 3] = value
        self.state.from_numpy(start)

    # -- the step
    # -------------------------------------------------------------------------------------

    @ti.func
    def read(self, entry: ti.template()):
        """A vector of the state."""
        return vec3d(self.state[entry], self.state[entry + 1], self.state[entry + 2])

    @ti.func
    def write(self, entry: ti.template(), vector):
        """Set a vector of the state."""
        for axis in ti.static(range(3)):
            self.state[entry + axis] = vector[axis]

    @ti.func
    def surface(self, position, displacement):
        """Signed distance of a point to the nose and its shaft, and the outward normal."""
        height = self.numbers[TIP] + self.numbers[RADIUS]
        centre = vec3d(self.numbers[AXIS_X], self.numbers[AXIS_Y], height) + displacement
        return self.nose_at(position - centre)

    @ti.func
    def seen_from(self, way, displacement):
        """A way of this step as it is seen from the striker."""
        return way - (displacement - self.displacement_before())

    @ti.func
    def last_way(self, number, time_step):
        """Way of a node in the step before, as it is seen from the striker, m."""
        velocity = ti.cast(self.before[number], ti.f64) - self.read(VELOCITY)
        return ti.cast(time_step, ti.f64) * velocity

    @ti.func
    def speed(self):
        """The striker's speed, m/s."""
        return ti.cast(self.read(VELOCITY).norm(), float)

    @ti.func
    def displacement_before(self):
        """The striker's displacement at the start of the step, m."""
        return self.read(DISPLACEMENT)

    @ti.func
    def travelled(self):
        """Way of the striker along -z at the start of the step, m."""
        return -self.state[DISPLACEMENT + 2]

    @ti.func
    def velocities(self):
        """The striker's velocities along -z in the last two half steps, m/s."""
        return -self.state[VELOCITY_BEFORE + 2], -self.state[VELOCITY + 2]

    @ti.func
    def free_velocity(self, time_step):
        """The striker's velocity half a step from now without contact, m/s."""
        fall = ti.cast(time_step, ti.f64) * self.numbers[GRAVITY]
        return self.read(VELOCITY) - vec3d(0.0, 0.0, fall)

    @ti.func
    def displacement_after(self, time_step):
        """The striker's displacement at the end of the step, m."""
        velocity = self.free_velocity(time_step) + self.read(TRIAL)
        return self.read(DISPLACEMENT) + ti.cast(time_step, ti.f64) * velocity

    @ti.func
    def answer(self, number, now, depth, normal, flight, mass, dt):
        """A node's part of the equations for the striker's change of velocity."""
        moved, along = depth * normal, normal
        sticks = False  # a node that sticks goes all the way with the striker
        if ti.static(self.rubs):
            stopped, slid = self.rubbed(number, now, depth, normal, flight)
            moved -= stopped * slid
            along = moved / depth
            sticks = stopped >= 1
        parts = ti.Vector.zero(ti.f64, 12)
        for row in ti.static(range(3)):
            parts[row] = -mass * moved[row] / dt
            for column in ti.static(range(3)):
                factor = along[row] * normal[column]
                if ti.static(self.rubs):
                    whole = ti.cast(float(row == column), ti.f64)
                    factor = ti.select(sticks, whole, factor)
                parts[3 + 3 * row + column] = mass * factor
        return parts

    @ti.func
    def try_change(self, total):
        """Set the trial change of velocity from the sums of ``answer``."""
        factors = ti.Matrix.zero(ti.f64, 3, 3)
        for row in ti.static(range(3)):
            for column in ti.static(range(3)):
                factors[row, column] = total[3 + 3 * row + column]
            factors[row, row] += self.numbers[MASS]
        self.write(TRIAL, factors.inverse() @ vec3d(total[0], total[1], total[2]))

    @ti.func
    def works_of(self, impulse, before, velocity):
        """The impulse along z, both works, and the impulse along x and y."""
        early, late = 0.5 * impulse.dot(before), 0.5 * impulse.dot(velocity)
        return ti.Vector([impulse.z, early, late, impulse.x, impulse.y], ti.f64)

    @ti.func
    def no_works(self):
        """The sums of ``works_of`` without a node."""
        return ti.Vector.zero(ti.f64, 5)

    @ti.func
    def store_chunk(self, chunk, works):
        """Store a chunk's impulse and both works of this step."""
        parts = ti.Vector.zero(ti.f64, 12)
        for n in ti.static(range(5)):
            parts[n] = works[n]
        self.chunk_sums[chunk] = parts

    @ti.func
    def move(self, total, time_step):
        """Change the striker's motion by the plate's impulses of this step, and book them."""
        dt = ti.cast(time_step, ti.f64)
        impulse = vec3d(total[3], total[4], total[0])
        before, place = self.read(VELOCITY), self.read(DISPLACEMENT)
        after = before
        if ti.static(self.prescribed):
            self.add_work(impulse.dot(before))
        else:
            after = self.free_velocity(time_step) - impulse / self.numbers[MASS]
        self.write(DISPLACEMENT_BEFORE, place)
        self.write(DISPLACEMENT, place + dt * after)
        self.write(VELOCITY_BEFORE, before)
        self.write(VELOCITY, after)
        self.write(IMPULSE, self.read(IMPULSE) + impulse)
        self.book(
            impulse.z,
            total[1],
            total[1] - 0.5 * impulse.dot(before),
            total[2] - 0.5 * impulse.dot(after),
        )

    # -- samples
    # -------------------------------------------------------------------------------------

    def vector(self, entry: int) -> npt.NDArray[np.float64]:
        """(3,) a vector of the state, along x, y and z."""
        return np.asarray(self.state.to_numpy()[entry : entry + 3])

    def motion(self) -> tuple[float, float, float]:
        """Displacement (m), velocities at n - 1/2 and n + 1/2 (m/s), along -z."""
        state = -self.state.to_numpy()
        return tuple(float(state[e + 2]) for e in (DISPLACEMENT, VELOCITY_BEFORE, VELOCITY))  # type: ignore[return-value]

    def observe(self, reading: Reading, force: float, time: float, now: int) -> tuple[Any, ...]:
        """As for ``Striker``; then displacement and velocity along x, and along y."""
        place = self.vector(DISPLACEMENT_BEFORE)
        velocity = 0.5 * (self.vector(VELOCITY_BEFORE) + self.vector(VELOCITY))
        own = super().observe(reading, force, time, now)
        return (*own, *(float(v) for axis in (0, 1) for v in (place[axis], velocity[axis])))

    def impulses_sideways(self) -> list[float]:
        """Impulses on the striker along x and y since the start, N s."""
        return [-float(impulse) for impulse in self.vector(IMPULSE)[:2]]

    def kinetic(self, mass: float, reading: Reading) -> float:
        """Kinetic energy of the striker at a sample, J."""
        return float(0.5 * mass * self.vector(VELOCITY_BEFORE) @ self.vector(VELOCITY))
