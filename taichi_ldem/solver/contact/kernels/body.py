"""The base of all rigid bodies: the list of nearby nodes, the sums, and the motion of a node.

The contact is kinematic (hard, no penalty stiffness): a node that its free flight would carry into
a rigid body is put on the body's surface at the end of the same step, and the impulse that this
takes acts back on the body. A node therefore never penetrates by more than rounding, no stiffness
has to be chosen, and the critical time step is not lowered (a constraint cannot raise the highest
frequency). Momentum along z is conserved; a node that strikes a body sticks to it inelastically,
and the energy lost that way is accumulated, so the ledger closes. Where landings are ``elastic``,
the node turns back instead, and nothing is lost (``surface``).

Only nodes near a body are visited. They are listed anew every few steps, in ascending order, from
positions and speeds, on the device, without waiting for the host. Impulses and works are summed
over chunks of the list, then over the chunks, one after the other in f64, so the results do not
depend on the number of threads. On a GPU, where one thread is slow, a body at rest accumulates its
chunks' sums over the steps and adds them up only for a sample.

Friction is Coulomb's, exactly in every step: the tangential impulse on a node is what stops its
sliding along the body, but at most the coefficient times the normal impulse. A body without
friction compiles nothing of it.

Discrete energy: with kinetic energy 1/2 v(n-1/2) M v(n+1/2), a force F at t_n does the work
dt F (v(n-1/2) + v(n+1/2)) / 2, one half before t_n and one half after. The two halves are kept
apart, so that the ledger is exact at the sampled time itself.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.solver.contact.kernels.nearby import NearbyNodes, vec3d
from taichi_ldem.solver.dynamics import Dynamics, field_apart

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

CHUNK = 8
"""Nodes of a chunk: few, because Taichi gives a CPU thread at least 512 iterations of a loop."""

SLACK = 1e-3
"""Share of a module by which rounding may put a node inside a body or behind a ring."""

GROUP = 64
"""Chunks whose sums one thread of a GPU adds up."""

# the entries of ``sums``
IMPULSE, PLATE_BEFORE, LOSS_BEFORE, LOSS_AFTER = range(4)


@dataclass(frozen=True)
class Layout:
    """The numbers and sizes of a body in a scene, from which its fields are allocated.

    Attributes:
        numbers: parameters of the body, f64, SI units; other values need no compilation.
        capacity: nodes that its list has room for.
        kind: choices that are compiled into its kernels.
        nodes: (n,) node numbers listed from the start, flat over (sublattices, *S).
        friction: coefficient of friction; infinite where nodes do not slip.
    """

    numbers: Sequence[float]
    capacity: int
    kind: Hashable = None
    nodes: npt.NDArray[np.int32] | None = None
    friction: float = 0.0

    @property
    def rubs(self) -> bool:
        """Whether a coefficient decides which nodes slip."""
        return 0 < self.friction < math.inf


@dataclass(frozen=True)
class Reading:
    """The values of a body at the time t_n of a sample.

    Attributes:
        impulse: on the plate since the start, N s (``RigidBody.component`` says along what).
        plate_before: half-step work on the plate before t_n, J.
        lost: energy lost in the contact until t_n, J.
        displacement: of the body, m; 0 for one at rest.
        velocity_before, velocity_after: of the body half a step before and after t_n, m/s.
        held: energy at t_n that elastic landings give back within the step, J.
    """

    impulse: float
    plate_before: float
    lost: float
    displacement: float
    velocity_before: float
    velocity_after: float
    held: float


@dataclass(frozen=True)
class Energies:
    """A body's terms of the energy ledger, J.

    Attributes:
        kinetic: of the body. contact: lost in its contact. external: work done from outside.
    """

    kinetic: float = 0
    contact: float = 0
    external: float = 0


@ti.data_oriented
class RigidBody(NearbyNodes):
    """A rigid body: its sums, and the motion of a node.

    Attributes:
        name: of the body's declaration.
        numbers: parameters of the body, f64, SI units.
        rubs: whether a coefficient decides which nodes slip.
        friction: (1,) f64, the coefficient; only where ``rubs``.
        free: velocity of each listed node at the end of the step, m/s, before any body was
            resolved; only where ``shared``.
        chunk_sums: (chunks,) vectors in f64 of length ``width``.
        group_sums: (groups,) 4-vectors in f64, on a GPU.
        sums: (4,) f64 since the start: impulse on the plate along z (N s); half-step work on the
            plate in the latest step (J); energy lost before and after the latest sample time (J).
    """

    name = ""

    sideways = False
    """Whether samples have the forces on the body along x and y, which come last of its columns."""

    width = 4
    """Length of a chunk's sums."""

    needs_sums: ClassVar[bool] = False
    """Whether the body's own motion needs the chunks' sums in every step."""

    meets_others = False
    """Whether another body may press nodes against this one, which is then resolved after it."""

    state: Any = None
    """The field of the body's own motion, if it has any."""

    columns: tuple[str, ...] = ()
    """Names of what ``observe`` returns."""

    elastic = False
    """Whether nodes leave the body at the speed at which they land."""

    shared = False
    """Whether the scene has other bodies that may press nodes against this one."""

    def __init__(self, dynamics: Dynamics, layout: Layout):
        super().__init__(dynamics, layout.capacity)
        self.layout = layout
        self.numbers = field_apart(ti.f64, len(layout.numbers))
        self.rubs = layout.rubs
        if self.rubs:
            self.friction = field_apart(ti.f64, 1)
        self.chunk_sums = field_apart(ti.f64, self.capacity // CHUNK + 1, self.width)
        self.sums = field_apart(ti.f64, 4)
        self.accumulates = not (dynamics.on_cpu or self.needs_sums)
        if self.accumulates:
            self.group_sums = field_apart(ti.f64, self.chunk_sums.shape[0] // GROUP + 1, 4)
        self._fill(layout)

    def _fill(self, layout: Layout) -> None:
        self.numbers.from_numpy(np.array(layout.numbers, dtype=np.float64))
        if self.rubs:
            self.friction.fill(layout.friction)

    # -- on the host -------------------------------------------------------------------------------

    def layout_of(self, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The body's layout in a scene; each body's own.

        Raises:
            SceneError: the body has no place on this plate.
        """
        raise NotImplementedError

    def place(self, scene: "Scene", time_step: float) -> None:
        """Put the body to t = 0, when the plate has its motion."""
        if self.layout.nodes is not None:
            self.set_nodes(self.layout.nodes)
        self.start(scene, time_step)

    def start(self, scene: "Scene", time_step: float) -> None:
        """Set the body's own motion at t = 0; each body's own."""

    def reset(self, scene: "Scene", time_step: float) -> None:
        """Put the body back to t = 0 with the numbers of another scene.

        Raises:
            ValueError: the scene needs other kernels or a longer list of nodes.
            SceneError: the body has no place on this plate.
        """
        layout, old = self.layout_of(self.dynamics, scene), self.layout
        if layout.kind != old.kind:
            raise ValueError(f"{self.name}: {layout.kind} needs other kernels than {old.kind}")
        if layout.rubs != old.rubs or math.isinf(layout.friction) != math.isinf(old.friction):
            raise ValueError(
                f"{self.name}: friction = {layout.friction:g} needs other kernels than "
                f"{old.friction:g}"
            )
        if layout.capacity > self.capacity:
            raise ValueError(
                f"{self.name}: needs room for {layout.capacity} nodes near it and was built for "
                f"{self.capacity}"
            )
        self.layout = layout
        for field in (self.sums, self.chunk_sums, self.count):
            field.fill(0)
        self._fill(layout)
        self.place(scene, time_step)

    def observe(self, reading: Reading, force: float, time: float, now: int) -> tuple[Any, ...]:
        """The values of the body's observables at a sample, in the order of its declaration.

        Args:
            force: impulse over the time since the last sample, N.
            time: of the sample, s.
            now: buffer of the displacement at that time.
        """
        return (force,)

    def impulses_sideways(self) -> list[float]:
        """Impulses on the body along x and y since the start, N s, where it is ``sideways``."""
        return []

    def energies(self, reading: Reading) -> Energies:
        """The body's terms of the ledger at a sample."""
        return Energies(contact=reading.lost)

    def kernel_names(self) -> list[str]:
        """Names of the kernels that a run of the body compiles."""
        return [f"contact: {self.name}"] + [f"nodes near: {self.name}"] * self.listed_anew

    def fields(self) -> dict[str, ti.Field]:
        """All fields of the body by name, ``part.field``."""
        own = vars(self).items()
        return {f"{self.name}.{name}": value for name, value in own if isinstance(value, ti.Field)}

    def saved_state(self) -> dict[str, npt.NDArray]:
        """Copies of the state before the next step: list, velocities, sums, the body's motion."""
        own = {} if self.state is None else {"state": self.state.to_numpy()}
        if self.accumulates:
            own["chunks"] = self.chunk_sums.to_numpy()
        nodes = self.listed()
        before = self.before.to_numpy()[: len(nodes)]
        return own | {"sums": self.sums.to_numpy(), "nodes": nodes, "before": before}

    def restore_state(self, saved: Mapping[str, npt.NDArray]) -> None:
        """Continue from ``saved_state``.

        Raises:
            ValueError: the list of nodes does not belong to this body.
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
        if self.accumulates:
            self.chunk_sums.from_numpy(saved["chunks"])

    def collected(self) -> npt.NDArray[np.float64]:
        """(4,) the sums (see ``sums``)."""
        if self.accumulates:
            self._add_up()
        return self.sums.to_numpy()

    # -- together with other bodies ----------------------------------------------------------------

    def share_nodes(self) -> None:
        """Prepare for other bodies that press nodes against this one."""
        self.shared = True
        self.free = ti.Vector.field(3, float, shape=self.capacity)

    @ti.func
    def begin(self):
        """Keep the velocities before any body is resolved, where other bodies share nodes."""
        if ti.static(self.shared):
            for number in range(self.count[0]):
                s, k, j, i = self.site_of(number)
                self.free[number] = self.dynamics.node_velocity(s, k, j, i)

    # -- a node's place and motion -----------------------------------------------------------------

    @ti.func
    def component(self, impulse):
        """Component of an impulse that the body's sums count: along z, unless overridden."""
        return impulse.z

    @ti.func
    def inertia(self, s, k, j, i, time_step, damping):
        """Impulse that changes a node's velocity at the end of a step, over that change, kg.

        It is the node's mass and half of a step's damping, which acts on the mean of both
        velocities.
        """
        mass = ti.cast(self.dynamics.node_mass(s, k, j, i), ti.f64)
        if ti.static(self.dynamics.features.damping):
            mass *= 1 + 0.5 * ti.cast(damping, ti.f64) * ti.cast(time_step, ti.f64)
        return mass

    @ti.func
    def put(self, number, now, time_step, damping, displacement):
        """Move a listed node to a displacement (f64).

        Returns:
            impulse on the plate (see ``component``), N s, and the works before and after t_n, J.
        """
        s, k, j, i = self.site_of(number)
        old = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
        velocity = (displacement - old) / ti.cast(time_step, ti.f64)
        return self.change(number, now, time_step, damping, displacement, velocity)

    @ti.func
    def change(self, number, now, time_step, damping, displacement, velocity):
        """Give a listed node a displacement (m) and a velocity (m/s) at the end of the step, f64.

        Returns:
            as ``put``.
        """
        s, k, j, i = self.site_of(number)
        free = ti.cast(self.dynamics.node_velocity(s, k, j, i), ti.f64)
        impulse = self.inertia(s, k, j, i, time_step, damping) * (velocity - free)
        self.dynamics.put_node(
            1 - now, s, k, j, i, ti.cast(displacement, float), ti.cast(velocity, float)
        )
        before = ti.cast(self.before[number], ti.f64)
        if ti.static(self.dynamics.features.damping):
            # the loss by damping was added for the velocity of the free flight
            mean = 0.25 * ti.cast(2 * before + free + velocity, float)
            drag = damping * self.dynamics.node_mass(s, k, j, i) * mean
            path = ti.cast(time_step * (velocity - free), float)
            self.dynamics.add_damped(s, k, j, i, drag.dot(path))
        works = self.works_of(impulse, before, velocity)
        if ti.static(self.shared):
            # other bodies have counted their work up to a velocity that is not the node's last
            others = free - ti.cast(self.free[number], ti.f64)
            mass = self.inertia(s, k, j, i, time_step, damping)
            works[2] += 0.5 * mass * others.dot(velocity - free)
        return works

    @ti.func
    def works_of(self, impulse, before, velocity):
        """What a body sums of a node's impulse (see ``put``), from its velocities around t_n."""
        return vec3d(
            self.component(impulse), 0.5 * impulse.dot(before), 0.5 * impulse.dot(velocity)
        )

    @ti.func
    def no_works(self):
        """The sums of ``works_of`` without a node."""
        return vec3d(0.0, 0.0, 0.0)

    @ti.func
    def braking(self, slid, pushed):
        """Share of a node's sliding that friction stops.

        Args:
            slid: way that the node would slide along the body in this step, m.
            pushed: way that the body pushes it along its normal, m; the impulses of both have the
                same inertia.
        """
        way, share = slid.norm(), ti.cast(1.0, ti.f64)
        if way > self.friction[0] * pushed:
            share = self.friction[0] * pushed / way
        return share

    # -- sums --------------------------------------------------------------------------------------

    @ti.func
    def chunks(self):
        """Number of chunks of the list."""
        return (self.count[0] + CHUNK - 1) // CHUNK

    @ti.func
    def turns(self):
        """Iterations of a loop over the chunks: on a GPU the capacity, which needs no transfer."""
        turns = self.chunks()
        if ti.static(not self.dynamics.on_cpu):
            turns = self.chunk_sums.shape[0]
        return turns

    @ti.func
    def chunk_end(self, chunk):
        """Number after the last node of a chunk."""
        return ti.min((chunk + 1) * CHUNK, self.count[0])

    @ti.func
    def total(self):
        """Sum of the chunks' sums, in their order."""
        total, chunks = ti.Vector.zero(ti.f64, self.width), self.chunks()
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
    def store_chunk(self, chunk, works):
        """Store a chunk's impulse and both works of this step."""
        if ti.static(self.accumulates):
            kept = self.chunk_sums[chunk]
            self.chunk_sums[chunk] = ti.Vector(
                [kept[0] + works[0], works[1], kept[2] + works[1], kept[3] + works[2]], ti.f64
            )
        else:
            self.chunk_sums[chunk] = ti.Vector([works[0], works[1], works[2], 0.0], ti.f64)

    @ti.func
    def book_chunks(self):
        """Add the sums of the chunks to the body's, for a body at rest."""
        if ti.static(not self.accumulates):
            ti.loop_config(serialize=True)
            for _ in range(1):
                total = self.total()
                self.book(total[0], total[1], total[1], total[2])

    @ti.func
    def forget_unlisted(self):
        """Clear the work of the latest step in chunks whose nodes are no longer listed."""
        if ti.static(self.accumulates):
            for chunk in range(self.turns()):
                if chunk >= self.chunks():
                    self.chunk_sums[chunk][1] = 0.0

    @ti.func
    def add_up(self):
        """Add the sums that the chunks have accumulated since the last call to the body's."""
        if ti.static(self.accumulates):
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

    @ti.kernel
    def _add_up(self):
        self.add_up()

    @ti.func
    def book(self, impulse, plate_before, before, after):
        """Add a step's impulse on the plate and its works to the sums.

        Written out: ``+=`` on a field is an atomic, which not every backend has in f64.
        """
        self.sums[IMPULSE] = self.sums[IMPULSE] + impulse
        self.sums[PLATE_BEFORE] = plate_before
        self.sums[LOSS_BEFORE] = self.sums[LOSS_BEFORE] - before
        self.sums[LOSS_AFTER] = self.sums[LOSS_AFTER] - after

    # -- the body's motion -------------------------------------------------------------------------

    @ti.func
    def act_first(self, now, time_step, damping):
        """Change the free flight of nodes before any body is resolved; a load's own."""

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Correct the nodes whose free flight the body prevents; each body's own."""

    @ti.func
    def displacement_before(self):
        """The body's displacement at the start of the step, m; 0 for one that does not move."""
        return ti.cast(0.0, ti.f64)

    @ti.func
    def travelled(self):
        """Way of the body towards the plate at the start of the step, m, for the samples."""
        return self.displacement_before()

    @ti.func
    def velocities(self):
        """Velocities of the body in the last two half steps, m/s."""
        return ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
