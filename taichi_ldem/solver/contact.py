"""Rigid bodies against the lattice: the falling striker, clamping rings, supports and grips.

The contact is kinematic (hard, no penalty stiffness): a node that its free flight would carry into
a rigid body is put on the body's surface at the end of the same step, and the impulse that this
takes acts back on the body. A node therefore never penetrates by more than rounding, no stiffness
has to be chosen, and the critical time step is not lowered (a constraint cannot raise the highest
frequency). Momentum along z is conserved; a node that strikes a body sticks to it inelastically,
and the energy lost that way is accumulated, so the ledger closes.

Only nodes near a body are visited. They are listed anew every few steps, in ascending order, from
positions and speeds, on the device: nothing waits for the host. Impulses and works are summed over
chunks of the list, then over the chunks, one after the other in f64. Nothing depends on the number
of threads. On a GPU, where one thread is slow, a body at rest keeps its chunks' sums over the steps
and adds them up only for a sample.

Discrete energy: with kinetic energy 1/2 v(n-1/2) M v(n+1/2), a force F at t_n does the work
dt F (v(n-1/2) + v(n+1/2)) / 2, one half before t_n and one half after. Both halves are kept apart,
so that the ledger is exact at the sampled time itself.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.errors import SceneError, TooManyNodes
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import Clamp, Plate
from taichi_ldem.scene import Grips as GripsScene
from taichi_ldem.scene import Striker as StrikerScene
from taichi_ldem.scene import Supports as SupportsScene
from taichi_ldem.solver.dynamics import CENTRE, CORNER, Dynamics, field_apart
from taichi_ldem.solver.lanes import HALO

CHUNK = 8
"""Nodes summed at a time: few, because Taichi gives a CPU thread at least 512 turns of a loop."""

SLACK = 1e-3
"""Share of a module by which rounding may put a node inside a body or behind a ring."""

WORD = 16
"""Columns of a row whose nodes one number marks as near or not."""

BATCH, GROUP = 8, 64
"""Numbers that one thread of a GPU reads at once, and chunks whose sums one thread adds up."""

# what both bodies accumulate
IMPULSE, PLATE_BEFORE, LOSS_BEFORE, LOSS_AFTER = range(4)
# numbers that describe a body: kept in a field, so that another value compiles nothing anew
MASS, RADIUS, GRAVITY, AXIS_X, AXIS_Y, TIP = range(6)
HALF_SPAN = 0  # of the supports, whose radius has the striker's place
INNER, OUTER, HEIGHT = range(3)
SPEED, RAMP, COSINE, SINE = range(4)
# the striker's own state; displacement and velocity are positive towards the plate
DISPLACEMENT, VELOCITY, VELOCITY_BEFORE, TRIAL = range(4)

vec3d = ti.types.vector(3, ti.f64)


@ti.data_oriented
class RigidBody:
    """A rigid body's list of nearby nodes and its sums.

    Attributes:
        nodes: node numbers, ascending, flat over (2, *S).
        before: velocity of each listed node at the end of the last step, m/s.
        count: (2,) nodes listed, and the most that were ever near, listed or not.
        marks: a bit for each column of a piece of a row (s, k, j, lane): its node is near.
        ends: for each row (s, k, j) the number after its last node in the list.
        numbers: what describes the body, f64, SI units.
        chunk_sums: (chunks,) 4-vectors in f64.
        group_sums: (groups,) 4-vectors in f64, on a GPU.
        sums: (4,) f64 since the start: impulse on the plate along z (N s); half-step work on the
            plate in the latest step (J); energy lost before and after the latest sample time (J).
    """

    moving = True
    """Whether the list has to be made anew while the plate moves."""

    answers = False
    """Whether the body's own motion needs the chunks' sums in every step."""

    state: Any = None
    """What moves about the body itself, if anything does."""

    def __init__(self, dynamics: Dynamics, numbers: Sequence[float], capacity: int):
        self.dynamics = dynamics
        self.numbers = field_apart(ti.f64, len(numbers))
        self.numbers.from_numpy(np.array(numbers, dtype=np.float64))
        self.capacity = capacity
        self.nodes = field_apart(ti.i32, capacity)
        self.before = ti.Vector.field(3, float, shape=capacity)
        self.count = field_apart(ti.i32, 2)
        self.chunk_sums = field_apart(ti.f64, capacity // CHUNK + 1, 4)
        self.sums = field_apart(ti.f64, 4)
        self.batch = 1 if dynamics.on_cpu else BATCH
        self.keeps = not (dynamics.on_cpu or self.answers)
        if self.keeps:
            self.group_sums = field_apart(ti.f64, self.chunk_sums.shape[0] // GROUP + 1, 4)
        if self.moving:
            nz, ny, _ = dynamics.sites
            self.words = -(-dynamics.lanes.length // WORD)
            self.marks = field_apart(ti.i32, 2 * nz * ny * dynamics.lanes.width * self.words)
            self.ends = field_apart(ti.i32, 2 * nz * ny)

    def set_nodes(self, nodes: npt.NDArray[np.int32]) -> None:
        """Replace the list and note the nodes' velocities."""
        padded = np.zeros(self.capacity, dtype=np.int32)
        padded[: len(nodes)] = np.sort(nodes)
        self.nodes.from_numpy(padded)
        self.count[0] = len(nodes)
        self.note_velocities()

    def saved_state(self) -> dict[str, npt.NDArray]:
        """Copies of what the next step starts from: list, velocities, sums, the body's motion."""
        own = {} if self.state is None else {"state": self.state.to_numpy()}
        if self.keeps:
            own["chunks"] = self.chunk_sums.to_numpy()
        nodes = self.listed()
        before = self.before.to_numpy()[: len(nodes)]
        return own | {"sums": self.sums.to_numpy(), "nodes": nodes, "before": before}

    def restore_state(self, saved: Mapping[str, npt.NDArray]) -> None:
        """Continue from ``saved_state``.

        Raises:
            ValueError: a list that is none of this body's.
        """
        nodes, before = saved["nodes"], saved["before"]
        inside = not len(nodes) or (nodes.min() >= 0 and nodes.max() < self._node_numbers())
        if len(nodes) > self.capacity or len(before) != len(nodes) or not inside:
            raise ValueError("a rigid body's list of nodes is of another lattice")
        self.set_nodes(nodes)
        padded = np.zeros((self.capacity, 3), dtype=before.dtype)
        padded[: len(before)] = before
        self.before.from_numpy(padded)
        self.sums.from_numpy(saved["sums"])
        if self.state is not None:
            self.state.from_numpy(saved["state"])
        if self.keeps:
            self.chunk_sums.from_numpy(saved["chunks"])

    def _node_numbers(self) -> int:
        return 2 * int(np.prod(self.dynamics.sites))

    def listed(self) -> npt.NDArray[np.int32]:
        """Numbers of the listed nodes, ascending.

        Raises:
            TooManyNodes: there were more than the list holds.
        """
        count = self.count.to_numpy()
        self.refuse_more(int(count[1]))
        return self.nodes.to_numpy()[: count[0]]

    def refuse_more(self, near: int) -> None:
        """Raise TooManyNodes where more nodes have come near than the list holds."""
        if near > self.capacity:
            raise TooManyNodes(
                f"{near} nodes came near a rigid body whose list holds {self.capacity}: fast "
                "debris all around it; end the run earlier (solver.duration) or strike more slowly"
            )

    @ti.func
    def near(self, position, margin):
        """Whether a point (m, f64) is within a margin of the body; each body's own."""
        return False

    @ti.func
    def place(self, number):
        """Sublattice and site of a listed node."""
        node = self.nodes[number]
        nz, ny, nx = ti.static(self.dynamics.sites)
        return node // (nz * ny * nx), node // (ny * nx) % nz, node // nx % ny, node % nx

    @ti.func
    def chunks(self):
        """Number of chunks of the list."""
        return (self.count[0] + CHUNK - 1) // CHUNK

    @ti.func
    def turns(self):
        """Turns of a loop over the chunks: on a GPU all that fit, known without asking it."""
        turns = self.chunks()
        if ti.static(not self.dynamics.on_cpu):
            turns = self.chunk_sums.shape[0]
        return turns

    @ti.func
    def chunk_end(self, chunk):
        """Number after the last node of a chunk."""
        return ti.min((chunk + 1) * CHUNK, self.count[0])

    @ti.func
    def rest(self, s, k, j, i, spacing):
        """Position of a node at rest, m, in f64."""
        nx, ny, _ = ti.static(self.dynamics.lattice.modules)
        half = ti.cast(0.5 * s, ti.f64)
        edge = ti.cast(spacing, ti.f64)
        place = vec3d(
            (i - 1 + half - 0.5 * nx) * edge,
            (j - 1 + half - 0.5 * ny) * edge,
            (k - 1 + half) * edge,
        )
        if ti.static(self.dynamics.features.perturbed):
            place += self.dynamics.node_offset(s, k, j, i, spacing)
        return place

    @ti.func
    def component(self, impulse):
        """Component of an impulse that the body's sums count: along z, unless it says another."""
        return impulse.z

    @ti.func
    def inertia(self, s, k, j, i, time_step, damping):
        """Impulse that changes a node's velocity at the end of a step, by that change, kg.

        Its mass, and half of a step's damping, which acts on the mean of both velocities.
        """
        mass = ti.cast(self.dynamics.node_mass(s, k, j, i), ti.f64)
        if ti.static(self.dynamics.features.damping):
            mass *= 1 + 0.5 * ti.cast(damping, ti.f64) * ti.cast(time_step, ti.f64)
        return mass

    @ti.func
    def put(self, number, s, k, j, i, now, time_step, damping, displacement):
        """Move a node to a displacement (f64), return impulse (``component``) and both works."""
        old = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
        free = ti.cast(self.dynamics.node_velocity(s, k, j, i), ti.f64)
        velocity = (displacement - old) / ti.cast(time_step, ti.f64)
        impulse = self.inertia(s, k, j, i, time_step, damping) * (velocity - free)
        self.dynamics.put_node(
            1 - now, s, k, j, i, ti.cast(displacement, float), ti.cast(velocity, float)
        )
        before = ti.cast(self.before[number], ti.f64)
        if ti.static(self.dynamics.features.damping):
            # what it loses by damping was booked for its free flight, with its velocity then
            mean = 0.25 * ti.cast(2 * before + free + velocity, float)
            drag = damping * self.dynamics.node_mass(s, k, j, i) * mean
            way = ti.cast(time_step * (velocity - free), float)
            self.dynamics.add_damped(s, k, j, i, drag.dot(way))
        works = 0.5 * impulse.dot(before), 0.5 * impulse.dot(velocity)
        return vec3d(self.component(impulse), works[0], works[1])

    @ti.func
    def total(self):
        """Sum of the chunks' sums, in their order."""
        total, chunks = ti.Vector.zero(ti.f64, 4), self.chunks()
        for batch in range((chunks + self.batch - 1) // self.batch):
            first = batch * self.batch
            parts = [
                self.chunk_sums[ti.min(first + n, chunks - 1)] for n in ti.static(range(self.batch))
            ]
            for n in ti.static(range(self.batch)):
                if first + n < chunks:
                    total += parts[n]
        return total

    @ti.func
    def settle(self, chunk, works):
        """Put down a chunk's impulse and both works of this step."""
        if ti.static(self.keeps):
            kept = self.chunk_sums[chunk]
            self.chunk_sums[chunk] = ti.Vector(
                [kept[0] + works[0], works[1], kept[2] + works[1], kept[3] + works[2]], ti.f64
            )
        else:
            self.chunk_sums[chunk] = ti.Vector([works[0], works[1], works[2], 0.0], ti.f64)

    @ti.func
    def book_settled(self):
        """Book what the chunks have put down, for a body that nothing moves."""
        if ti.static(not self.keeps):
            ti.loop_config(serialize=True)
            for _ in range(1):
                total = self.total()
                self.book(total[0], total[1], total[1], total[2])

    @ti.func
    def add_up(self):
        """Book what chunks have kept since the last time."""
        if ti.static(self.keeps):
            for group in range(self.group_sums.shape[0]):
                total = ti.Vector.zero(ti.f64, 4)
                for chunk in range(group * GROUP, ti.min((group + 1) * GROUP, self.turns())):
                    kept = self.chunk_sums[chunk]
                    total += kept
                    self.chunk_sums[chunk] = ti.Vector([0.0, kept[1], 0.0, 0.0], ti.f64)
                self.group_sums[group] = total
            ti.loop_config(serialize=True)
            for _ in range(1):
                total = ti.Vector.zero(ti.f64, 4)
                for group in range(self.group_sums.shape[0]):
                    total += self.group_sums[group]
                self.book(total[0], total[1], total[2], total[3])

    @ti.func
    def approach(self):
        """Speed at which the body itself moves, m/s."""
        return ti.cast(0.0, float)

    def list_nodes(self, now: int, reach: float) -> None:
        """List the nodes that may touch the body within ``reach`` (s) from now.

        A node's margin is 0.45 of a module plus twice the way that it and the body go in that time
        (bounded by the sum of its velocity's components): a node may be accelerated meanwhile, at
        most to about the wave speed times eps_p, the speed at which a breaking bar lets go. Where
        more nodes are near than the list holds, ``count`` tells: see ``refuse_more``.
        """
        self._list(now, self.dynamics.lattice.spacing, reach)

    @ti.kernel
    def _list(self, now: int, spacing: float, reach: float):
        nz, ny = ti.static(self.dynamics.sites[:2])
        for k, j, word in ti.ndrange((1, nz - 1), (1, ny - 1), self.words):
            self.mark(now, k, j, word, spacing, reach)
        for row in range(self.ends.shape[0]):
            near = 0
            for word in range(row * self.row_words(), (row + 1) * self.row_words()):
                bits = self.marks[word]
                while bits != 0:
                    near += 1
                    bits &= bits - 1
            self.ends[row] = near
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.number_rows()
        for row in range(self.ends.shape[0]):
            self.write_row(row)
        if ti.static(self.keeps):
            for chunk in range(self.turns()):
                if chunk >= self.chunks():
                    self.chunk_sums[chunk][1] = 0.0  # of nodes that are no longer listed

    @ti.func
    def row_words(self):
        """Words of marks of a row."""
        return ti.static(self.dynamics.lanes.width * self.words)

    @ti.func
    def mark(self, now, k, j, word, spacing, reach):
        """Mark the nodes of a piece of a row, in every lane, that are near."""
        nz, ny, _ = ti.static(self.dynamics.sites)
        begin, approach = HALO + word * WORD, self.approach()
        for lane in ti.static(range(self.dynamics.lanes.width)):
            near = ti.Vector.zero(ti.i32, 2)
            for m in range(begin, ti.min(begin + WORD, HALO + self.dynamics.lanes.length)):
                i = self.dynamics.site_of(m, lane)
                for s in ti.static((CORNER, CENTRE)):
                    moved = ti.Vector.zero(ti.f64, 3)
                    speed = approach
                    for axis in ti.static(range(3)):
                        moved[axis] = self.dynamics.displacement[s][axis][now, k, j, m][lane]
                        speed += ti.abs(self.dynamics.velocity[s][axis][k, j, m][lane])
                    margin = 0.45 * spacing + 2 * reach * speed
                    mass = self.dynamics.mass[int(self.dynamics.code[k, j, m][lane])]
                    if mass[s] > 0 and self.near(self.rest(s, k, j, i, spacing) + moved, margin):
                        near[s] |= 1 << (m - begin)
            for s in ti.static((CORNER, CENTRE)):
                row = (s * nz + k) * ny + j
                self.marks[row * self.row_words() + lane * self.words + word] = near[s]

    @ti.func
    def number_rows(self):
        """Make of every row's count the number after its last node."""
        rows = ti.static(self.ends.shape[0])
        end = 0
        for batch in range((rows + self.batch - 1) // self.batch):
            first = batch * self.batch
            counts = [self.ends[ti.min(first + n, rows - 1)] for n in ti.static(range(self.batch))]
            for n in ti.static(range(self.batch)):
                if first + n < rows:
                    end += counts[n]
                    self.ends[first + n] = end
        self.count[0] = ti.min(end, self.capacity)
        self.count[1] = ti.max(end, self.count[1])

    @ti.func
    def write_row(self, row):
        """Write a row's nodes into the list, ascending, with their velocities."""
        nz, ny, nx = ti.static(self.dynamics.sites)
        number = 0
        if row > 0:
            number = self.ends[row - 1]
        for at in range(self.row_words()):
            bits = self.marks[row * self.row_words() + at]
            lane, m = at // self.words, HALO + at % self.words * WORD
            while bits != 0:
                if bits & 1 != 0 and number < self.capacity:
                    i = self.dynamics.site_of(m, lane)
                    self.nodes[number] = row * nx + i
                    self.before[number] = self.dynamics.node_velocity(
                        row // (nz * ny), row // ny % nz, row % ny, i
                    )
                    number += 1
                bits = bits >> 1
                m += 1

    @ti.func
    def book(self, impulse, plate_before, before, after):
        """Add a step's impulse on the plate and works on all that touches to the sums.

        Written out: ``+=`` on a field is an atomic, which not every backend has in f64.
        """
        self.sums[IMPULSE] = self.sums[IMPULSE] + impulse
        self.sums[PLATE_BEFORE] = plate_before
        self.sums[LOSS_BEFORE] = self.sums[LOSS_BEFORE] - before
        self.sums[LOSS_AFTER] = self.sums[LOSS_AFTER] - after

    @ti.kernel
    def note_velocities(self):
        """Note the velocities of the listed nodes as those of the end of the last step."""
        for number in range(self.count[0]):
            s, k, j, i = self.place(number)
            self.before[number] = self.dynamics.node_velocity(s, k, j, i)

    @ti.kernel
    def _add_up(self):
        self.add_up()

    def collected(self) -> npt.NDArray[np.float64]:
        """The four sums (see ``sums``)."""
        if self.keeps:
            self._add_up()
        return self.sums.to_numpy()


def _capacity(lattice: Lattice, diameter: float, along: bool) -> int:
    """Nodes that a round body's list has room for.

    As many as in a column of twice its diameter and four thicknesses more, a cylinder ``along`` y
    has them over the whole width; never more than there are.
    """
    nx, ny, nz = lattice.modules
    across = 2 * diameter / lattice.spacing + 4 * nz
    plan = min(across, nx + 1) * (ny + 1) if along else max(across**2, 10_000)
    return int(min(plan, (nx + 1) * (ny + 1)) * (2 * nz + 1))


@ti.data_oriented
class RoundBody(RigidBody):
    """A body whose surface has one distance, ``numbers[RADIUS]``, from a point or a line.

    Which one is a compile-time choice: ``from_axis`` of the body. Frictionless: a node that would
    get inside goes to the nearest place on the surface. Debris that other debris drives may get in
    before the next list knows of it: putting it back at once would give it energy (half a module in
    a step is a kilometre a second). It is kept from getting deeper, and leaves as it likes.
    """

    @ti.func
    def from_axis(self, position, displacement):
        """Vector from the body's axis to a point at a displacement of the body; each its own."""
        return position

    @ti.func
    def distance(self, position, displacement):
        """Signed distance of a point to the surface, m."""
        return self.from_axis(position, displacement).norm() - self.numbers[RADIUS]

    @ti.func
    def overlap(self, number, now, spacing, displacement):
        """How much deeper a listed node would be in the body, and the surface's normal there."""
        s, k, j, i = self.place(number)
        rest = self.rest(s, k, j, i, spacing)
        moved = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
        offset = self.from_axis(rest + moved, displacement)
        length = ti.max(offset.norm(), 1e-12 * self.numbers[RADIUS])
        depth = self.numbers[RADIUS] - length
        if depth > SLACK * spacing:
            old = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
            before = -self.distance(rest + old, self.gone())
            if before > SLACK * spacing:
                depth -= before
        return depth, offset / length

    @ti.func
    def gone(self):
        """The body's displacement at the start of the step, m; 0 for one that does not move."""
        return ti.cast(0.0, ti.f64)

    @ti.func
    def reached(self, time_step):
        """The body's displacement at the end of the step, m; 0 for one that does not move."""
        return ti.cast(0.0, ti.f64)

    @ti.func
    def push_out(self, now, spacing, time_step, damping):
        """Put every node that is inside the body on its surface; works go to the chunks' sums.

        Few nodes are near it: on the CPU one thread is faster than waking the others.
        """
        ti.loop_config(serialize=self.dynamics.on_cpu)
        for chunk in range(self.turns()):
            works = vec3d(0.0, 0.0, 0.0)
            displacement = self.reached(time_step)
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                s, k, j, i = self.place(number)
                depth, normal = self.overlap(number, now, spacing, displacement)
                if depth > 0:
                    moved = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
                    works += self.put(
                        number, s, k, j, i, now, time_step, damping, moved + depth * normal
                    )
                self.before[number] = self.dynamics.node_velocity(s, k, j, i)
            if chunk < self.chunks():
                self.settle(chunk, works)


@ti.data_oriented
class Striker(RoundBody):
    """Rigid nose on a shaft of its own diameter; moves along -z, frictionless.

    The nose is half a sphere on a round shaft or half a cylinder along y on a flat one.

    The step is implicit in the striker's velocity: with all touching nodes on its surface their
    impulses are linear in its change of velocity, one scalar equation. So a light striker is as
    stable as a heavy one.

    Attributes:
        state: (4,) f64: displacement (m), velocity at n + 1/2 and n - 1/2 (m/s), trial change of
            velocity (m/s), positive towards the plate.
    """

    answers = True

    def __init__(self, dynamics: Dynamics, scene: StrikerScene, time_step: float):
        lattice = dynamics.lattice
        self.cylinder = scene.shape == "cylinder"
        tip = lattice.modules[2] * dynamics.spacing + scene.gap
        super().__init__(
            dynamics,
            (scene.mass, 0.5 * scene.diameter, scene.gravity, *scene.position, tip),
            _capacity(lattice, scene.diameter, self.cylinder),
        )
        self.state = field_apart(ti.f64, 4)
        start = scene.velocity - 0.5 * time_step * scene.gravity
        self.state.from_numpy(np.array([0.0, start, start, 0.0]))

    @ti.func
    def from_axis(self, position, displacement):
        """Vector to a point from the shaft's axis or mid-plane, at or above the nose's centre."""
        height = self.numbers[TIP] + self.numbers[RADIUS] - displacement
        centre = vec3d(self.numbers[AXIS_X], self.numbers[AXIS_Y], height)
        offset = position - centre
        offset.z = ti.min(offset.z, 0.0)
        if ti.static(self.cylinder):
            offset.y = 0.0
        return offset

    @ti.func
    def near(self, position, margin):
        """Whether a point is within a margin of the striker."""
        return self.distance(position, self.state[DISPLACEMENT]) < margin

    @ti.func
    def approach(self):
        """The striker's speed, m/s."""
        return ti.cast(ti.abs(self.state[VELOCITY]), float)

    @ti.func
    def gone(self):
        """The striker's displacement at the start of the step, m."""
        return self.state[DISPLACEMENT]

    @ti.func
    def free_velocity(self, time_step):
        """The striker's velocity half a step from now if it touches nothing, m/s."""
        return self.state[VELOCITY] + ti.cast(time_step, ti.f64) * self.numbers[GRAVITY]

    @ti.func
    def reached(self, time_step):
        """The striker's displacement at the end of the step, m."""
        return self.state[DISPLACEMENT] + ti.cast(time_step, ti.f64) * (
            self.free_velocity(time_step) + self.state[TRIAL]
        )

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Put penetrating nodes on the surface and stop the striker by as much."""
        dt = ti.cast(time_step, ti.f64)
        ti.loop_config(serialize=self.dynamics.on_cpu)
        for chunk in range(self.turns()):
            # with every touching node on the surface: M dV = sum(m (depth - n_z dt dV) n_z) / dt
            driven, inertia = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
            flight = self.state[DISPLACEMENT] + dt * self.free_velocity(time_step)
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                depth, normal = self.overlap(number, now, spacing, flight)
                if depth > 0:
                    s, k, j, i = self.place(number)
                    mass = self.inertia(s, k, j, i, time_step, damping)
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
            # what the plate gets along +z the striker gets along -z, its own direction
            self.book(
                total[0],
                total[1],
                total[1] + 0.5 * total[0] * before,
                total[2] + 0.5 * total[0] * after,
            )

    def motion(self) -> tuple[float, float, float]:
        """Displacement (m), velocities at n - 1/2 and n + 1/2 (m/s), towards the plate."""
        state = self.state.to_numpy()
        return float(state[DISPLACEMENT]), float(state[VELOCITY_BEFORE]), float(state[VELOCITY])


@ti.data_oriented
class Supports(RoundBody):
    """Two fixed cylinders along y under the plate, whose lower face they touch at the start.

    Frictionless, as rollers are: no tangential work, so nothing rubs energy away unseen, and no
    thrust along the beam. Each stands on a flat shaft, like the striker's cylinder upside down.
    """

    def __init__(self, dynamics: Dynamics, scene: SupportsScene):
        numbers = (0.5 * scene.span, 0.5 * scene.diameter)
        super().__init__(dynamics, numbers, 2 * _capacity(dynamics.lattice, scene.diameter, True))

    @ti.func
    def from_axis(self, position, displacement):
        """Vector to a point from the plane below the axis of the support on its side."""
        side = ti.select(position.x < 0, ti.cast(-1.0, ti.f64), ti.cast(1.0, ti.f64))
        height = ti.max(position.z + self.numbers[RADIUS], 0.0)
        across = ti.cast(0.0, ti.f64)
        return vec3d(position.x - side * self.numbers[HALF_SPAN], across, height)

    @ti.func
    def near(self, position, margin):
        """Whether a point is within a margin of a support."""
        return self.distance(position, ti.cast(0.0, ti.f64)) < margin

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Put penetrating nodes on the supports, which nothing moves."""
        self.push_out(now, spacing, time_step, damping)
        self.book_settled()


@ti.data_oriented
class Rings(RigidBody):
    """What holds the plate: rigid rings on both faces, or nodes fixed for good.

    Rings: a node between the two circles that would cross the plane of a face stays on it, without
    slip, for as long as it is pressed against it; it separates freely. A node that gets beyond a
    face's plane through the opening is not the ring's. Bonded, rim: listed nodes never move.
    """

    def __init__(self, dynamics: Dynamics, clamp: Clamp, plate: Plate):
        assert clamp.inner_diameter is not None  # the scene refuses other clamps without it
        self.moving = clamp.kind == "rings"
        outer = clamp.outer_diameter if clamp.kind != "rim" else None
        numbers = (
            0.5 * clamp.inner_diameter,
            0.5 * outer if outer is not None else math.inf,
            plate.modules_through_thickness * dynamics.spacing,
        )
        fixed = self._fixed(dynamics, numbers, through=clamp.kind == "rim")
        if len(fixed) == 0:
            raise SceneError(
                f"clamp.inner_diameter = {clamp.inner_diameter}: the clamp holds no node"
            )
        # separating rings: as many nodes as are between the circles through the whole thickness,
        # and on a small plate all, which fast debris may bring near
        nodes = int(np.count_nonzero(dynamics.lattice.exists()))
        through = max(len(fixed) * dynamics.sites[0], 10_000)
        capacity = min(through, nodes) if self.moving else len(fixed)
        super().__init__(dynamics, numbers, capacity)
        self.set_nodes(fixed)

    @staticmethod
    def _fixed(
        dynamics: Dynamics, numbers: Sequence[float], through: bool
    ) -> npt.NDArray[np.int32]:
        """Nodes between the circles: on both faces, or through the whole thickness.

        By the lattice's own places: rounded as f32 has them, a face may lie off its ring by more
        than any slack.
        """
        inner, outer, _ = numbers
        position = dynamics.lattice.positions()
        spacing = dynamics.lattice.spacing
        height = dynamics.lattice.modules[2] * spacing
        radius = np.hypot(position[..., 0], position[..., 1])
        slack = 1e-9 * spacing
        held = dynamics.lattice.exists()
        held &= (radius >= inner - slack) & (radius <= outer + slack)
        if not through:
            z = position[..., 2]
            held &= (z < slack) | (z > height - slack)
        return np.flatnonzero(held).astype(np.int32)

    @ti.func
    def near(self, position, margin):
        """Whether a point is within a margin of a ring's plane."""
        close = False
        if (position.z < margin) | (position.z > self.numbers[HEIGHT] - margin):
            radius = ti.sqrt(position.x**2 + position.y**2)
            close = radius >= self.numbers[INNER] - margin
            close &= radius <= self.numbers[OUTER] + margin
        return close

    @ti.func
    def held_at(self, s, k, j, i, now, spacing):
        """Whether a ring holds a node at the end of the step, and its displacement then."""
        old = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
        new = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
        rest = self.rest(s, k, j, i, spacing)
        slack = SLACK * spacing
        below, above = rest.z, rest.z - self.numbers[HEIGHT]
        held = False
        if above + new.z > 0 or below + new.z < 0:
            radius = ti.sqrt((rest.x + old.x) ** 2 + (rest.y + old.y) ** 2)
            if radius >= self.numbers[INNER] and radius <= self.numbers[OUTER]:
                if above + new.z > 0 and above + old.z <= slack:
                    held, old.z = True, -above
                elif below + new.z < 0 and below + old.z >= -slack:
                    held, old.z = True, -below
        return held, old

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Hold the nodes that press against a ring, or the fixed ones, where they were."""
        for chunk in range(self.turns()):
            works = vec3d(0.0, 0.0, 0.0)
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                s, k, j, i = self.place(number)
                held, target = (
                    True,
                    ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64),
                )
                if ti.static(self.moving):
                    held, target = self.held_at(s, k, j, i, now, spacing)
                if held:
                    works += self.put(number, s, k, j, i, now, time_step, damping, target)
                self.before[number] = self.dynamics.node_velocity(s, k, j, i)
            if chunk < self.chunks():
                self.settle(chunk, works)
        self.book_settled()


@ti.data_oriented
class Grips(RigidBody):
    """Two grips that move apart along the specimen, each by half of a prescribed separation.

    The nodes in them are put where the grips are at the end of every step; across the pull they are
    held, or move as they would without grips. The impulse that the sums count is half of the
    difference between the grips, a mean pull; the energy that they count as lost is minus the
    grips' work.

    Attributes:
        state: (1,) f64: steps taken.
    """

    moving = False

    def __init__(self, dynamics: Dynamics, grips: GripsScene, angle: float):
        """``angle``: of the specimen's long side to x, radians."""
        cosine, sine = math.cos(angle), math.sin(angle)
        self.held = grips.lateral == "held"
        along = dynamics.lattice.positions()[..., :2] @ (cosine, sine)
        exists = dynamics.lattice.exists()
        start = along[exists].max() - grips.length - 1e-6 * dynamics.lattice.spacing
        nodes = np.flatnonzero(exists & (np.abs(along) >= start)).astype(np.int32)
        super().__init__(dynamics, (grips.velocity, grips.ramp, cosine, sine), len(nodes))
        self.state = field_apart(ti.f64, 1)
        self.scene = grips
        self.set_nodes(nodes)

    def separation_at(self, at: float) -> float:
        """How far the grips have moved apart at a time (s), m."""
        ramp = self.scene.ramp
        share = min(at / ramp, 1.0) if ramp > 0 else 1.0
        return self.scene.velocity * (ramp * share**3 * (1 - 0.5 * share) + max(at - ramp, 0.0))

    @ti.func
    def separation(self, at):
        """How far the grips have moved apart at a time (s), m: the integral of their speed."""
        ramp = self.numbers[RAMP]
        way = ti.max(at - ramp, 0.0)
        if ramp > 0:
            share = ti.min(at / ramp, 1.0)
            way += ramp * share**3 * (1 - 0.5 * share)
        return self.numbers[SPEED] * way

    @ti.func
    def component(self, impulse):
        """Component along the specimen."""
        return impulse.x * self.numbers[COSINE] + impulse.y * self.numbers[SINE]

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Put all nodes in the grips where these are at the end of the step."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.state[0] = self.state[0] + 1
        for chunk in range(self.turns()):
            works = vec3d(0.0, 0.0, 0.0)
            direction = vec3d(self.numbers[COSINE], self.numbers[SINE], 0.0)
            half = 0.5 * self.separation(self.state[0] * ti.cast(time_step, ti.f64))
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                s, k, j, i = self.place(number)
                sign = ti.cast(1.0, ti.f64)
                if self.component(self.rest(s, k, j, i, spacing)) < 0:
                    sign = -1.0
                target = sign * half * direction
                if ti.static(not self.held):
                    free = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
                    target += free - self.component(free) * direction
                gained = self.put(number, s, k, j, i, now, time_step, damping, target)
                gained[0] *= 0.5 * sign
                works += gained
                self.before[number] = self.dynamics.node_velocity(s, k, j, i)
            if chunk < self.chunks():
                self.settle(chunk, works)
        self.book_settled()
