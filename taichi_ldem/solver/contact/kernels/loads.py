"""Loads: forces on nodes, and prescribed motions of nodes, over a course in time."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.solver.contact.kernels.body import (
    CHUNK,
    Energies,
    Layout,
    Reading,
    RigidBody,
)
from taichi_ldem.solver.contact.kernels.courses import Courses, points_of
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.contact.load_nodes import LoadNodes
from taichi_ldem.solver.dynamics import Dynamics, field_apart

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

# the numbers of a load
VALUE, X, Y, Z, KIND, HELD = range(6)
WIDTH = 6
FORCE, VELOCITY, DISPLACEMENT = range(3)
KINDS = {"traction": FORCE, "force": FORCE, "velocity": VELOCITY, "displacement": DISPLACEMENT}


@dataclass(frozen=True)
class LoadLayout(Layout):
    """The layout of loads, with their nodes."""

    found: LoadNodes | None = None


@ti.data_oriented
class Loads(RigidBody):
    """All loads of a scene. They act before any body, and their works are known after all bodies.

    A node is visited once, with all loads on it: first forces, whose impulses are added to its free
    flight, then prescribed motions, which replace its motion along their directions. A body that
    touches the node has the last word. The energy that the sums count as lost is minus the loads'
    work.

    Attributes:
        courses: of the loads in time.
        first, which, shares: as those of ``LoadNodes``.
        drive: (loads,) 3-vectors in f64: force over share at the start of the step, N or Pa; way
            at its end, m; mean speed in it, m/s.
        home: displacement of each node at t = 0, m.
        impulses: on each node in the latest step, N s.
        tally: (chunks, loads) f64: impulse along the load's direction since the start, N s.
        state: (1,) f64: steps taken.
        seen: steps taken and impulses of all loads at the last sample.
    """

    listed_anew = False

    def __init__(self, dynamics: Dynamics, scene: "Scene"):
        super().__init__(dynamics, self.layout_of(dynamics, scene))
        entries = self.found.which.size
        self.loads = len(scene.loads)
        self.courses = Courses(self.loads, points_of(scene.loads))
        self.first = field_apart(ti.i32, self.capacity + 1)
        self.which = field_apart(ti.i32, entries)
        self.shares = field_apart(ti.f64, entries)
        self.drive = field_apart(ti.f64, self.loads, 3)
        self.home = field_apart(ti.f64, self.capacity, 3)
        self.impulses = field_apart(ti.f64, self.capacity, 3)
        self.tally = field_apart(ti.f64, (self.chunk_sums.shape[0], self.loads))
        self.state = field_apart(ti.f64, 1)

    @classmethod
    def layout_of(cls, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The layout of the scene's loads.

        Raises:
            SceneError: a region without a node or a surface, or a node with two motions.
        """
        found = LoadNodes.of(dynamics.lattice, dynamics.masses(), scene.loads)
        numbers = [
            number
            for load in scene.loads
            for number in (load.value, *load.unit, KINDS[load.kind], load.lateral == "held")
        ]
        kind = f"{len(scene.loads)} loads"
        return LoadLayout(numbers, len(found.nodes), kind, found.nodes, found=found)

    @property
    def found(self) -> LoadNodes:
        """The nodes of the loads."""
        layout = self.layout
        assert isinstance(layout, LoadLayout)
        assert layout.found is not None
        return layout.found

    def start(self, scene: "Scene", time_step: float) -> None:
        """Begin at t = 0.

        Raises:
            ValueError: the scene's loads need larger fields.
        """
        found = self.found
        for size, field in (
            (found.which.size, self.which),
            (points_of(scene.loads), self.courses.times),
        ):
            if size > field.shape[0]:
                raise ValueError(f"loads: need {size} places, and were built for {field.shape[0]}")
        self.columns = tuple(column for load in scene.loads for column in load.columns)
        self.courses.set(scene.loads)
        self.units = np.array([load.unit for load in scene.loads])
        self.time_step = time_step
        for field, values in (
            (self.first, found.first),
            (self.which, found.which),
            (self.shares, found.shares),
        ):
            field.from_numpy(np.resize(values, field.shape))
        self.seen = np.zeros(1 + self.loads)
        for field in (self.state, self.home, self.tally):
            field.fill(0)

    def kernel_names(self) -> list[str]:
        """Names of the kernels that a run of the loads compiles."""
        return ["loads", "displacements of loads"]

    def fields(self) -> dict[str, ti.Field]:
        """All fields of the loads by name."""
        own = vars(self.courses).items()
        return super().fields() | {
            f"{self.name}.course_{name}": field for name, field in own if name != "loads"
        }

    def saved_state(self) -> dict[str, npt.NDArray]:
        """Copies of the state before the next step."""
        own = super().saved_state()
        home = self.home.to_numpy()[: len(own["nodes"])]
        return own | {"home": home, "tally": self.tally.to_numpy(), "seen": self.seen.copy()}

    def restore_state(self, saved: Mapping[str, npt.NDArray]) -> None:
        """Continue from ``saved_state``.

        Raises:
            ValueError: the nodes are not those of these loads.
        """
        if not np.array_equal(saved["nodes"], self.found.nodes):
            raise ValueError("the nodes of the loads are others")
        super().restore_state(saved)
        self.home.from_numpy(saved["home"])
        self.tally.from_numpy(saved["tally"])
        self.seen = saved["seen"].copy()

    def energies(self, reading: Reading) -> Energies:
        """The work of the loads: the loss that the sums count is minus this work."""
        return Energies(external=-reading.lost)

    def observe(self, reading: Reading, force: float, time: float, now: int) -> tuple[Any, ...]:
        """Force of each load since the last sample, and the mean displacement of its nodes."""
        steps, impulses = float(self.state.to_numpy()[0]), self.tally.to_numpy().sum(axis=0)
        forces = np.zeros(self.loads)
        if steps > self.seen[0]:
            time_step = time / (steps - 1) if steps > 1 else self.time_step
            forces = (impulses - self.seen[1:]) / ((steps - self.seen[0]) * time_step)
            self.seen = np.concatenate([[steps], impulses])
        moved = np.zeros((self.capacity, 3))
        self._gather(now, moved)
        found = self.found
        along = (moved[found.node_of] * self.units[found.which]).sum(axis=1)
        means = np.bincount(found.which, found.weights * along, self.loads)
        return tuple(v for pair in zip(forces.tolist(), means.tolist(), strict=True) for v in pair)

    @ti.kernel
    def _gather(self, now: int, values: ti.types.ndarray()):
        for number in range(self.count[0]):
            s, k, j, i = self.site_of(number)
            displacement = self.dynamics.node_displacement(now, s, k, j, i)
            for axis in ti.static(range(3)):
                values[number, axis] = ti.cast(displacement[axis], ti.f64)

    # -- the step
    # -------------------------------------------------------------------------------------

    @ti.func
    def number(self, n, which: ti.template()):
        """A number of load n."""
        return self.numbers[n * WIDTH + which]

    @ti.func
    def drive_at(self, n, time, time_step):
        """The ``drive`` of load n in a step that begins at a time (s)."""
        value, moves = self.number(n, VALUE), int(self.number(n, KIND)) == VELOCITY
        factor, way, before = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        for end in range(2):  # a loop, so that the course is compiled once
            now, integral = self.courses.at(n, time + end * time_step)
            before, way = way, ti.select(moves, integral, now)
            if end == 0:
                factor = now
        return value * vec3d(factor, way, (way - before) / time_step)

    @ti.func
    def act_first(self, now, time_step, damping):
        """Give all nodes of loads the impulses of this step."""
        ti.loop_config(serialize=True)
        for n in range(self.loads):
            dt = ti.cast(time_step, ti.f64)
            self.drive[n] = self.drive_at(n, self.state[0] * dt, dt)
        for chunk in range(self.turns()):
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                self.act(number, chunk, now, time_step, damping)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.state[0] = self.state[0] + 1

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Book the works of the impulses, with the velocities that all bodies have left."""
        for chunk in range(self.turns()):
            works = vec3d(0.0, 0.0, 0.0)
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                s, k, j, i = self.site_of(number)
                impulse, velocity = self.impulses[number], self.dynamics.node_velocity(s, k, j, i)
                works.y += 0.5 * impulse.dot(ti.cast(self.before[number], ti.f64))
                works.z += 0.5 * impulse.dot(ti.cast(velocity, ti.f64))
                self.before[number] = velocity
            if chunk < self.chunks():
                self.store_chunk(chunk, works)
        self.book_chunks()

    @ti.func
    def act(self, number, chunk, now, time_step, damping):
        """Change the motion of a node as the loads on it demand."""
        s, k, j, i = self.site_of(number)
        dt = ti.cast(time_step, ti.f64)
        if self.state[0] == 0:
            self.home[number] = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
        free = ti.cast(self.dynamics.node_velocity(s, k, j, i), ti.f64)
        velocity = free
        place = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
        inertia, home = self.inertia(s, k, j, i, time_step, damping), self.home[number]
        for entry in range(self.first[number], self.first[number + 1]):
            n = self.which[entry]
            driven = self.drive[n]
            unit = vec3d(self.number(n, X), self.number(n, Y), self.number(n, Z))
            change = unit * (driven.x * self.shares[entry] * dt / inertia)
            way = dt * change
            if int(self.number(n, KIND)) != FORCE:
                change = driven.z * unit - velocity
                way = home + driven.y * unit - place
                if self.number(n, HELD) == 0:
                    change, way = change.dot(unit) * unit, way.dot(unit) * unit
            velocity += change
            place += way
            self.tally[chunk, n] = self.tally[chunk, n] + inertia * change.dot(unit)
        self.impulses[number] = inertia * (velocity - free)
        self.change(number, now, time_step, damping, place, velocity)
