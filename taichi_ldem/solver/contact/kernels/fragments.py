"""Contact of nodes that were not neighbours: pieces push each other away, and rub.

Forces are those at t_n, so that contact is a part of the same central differences. Each node
gathers its own pairs in their order; both ends compute the same numbers with opposite signs. The
energy of the springs follows from the positions. Half of the work of friction lies before t_n and
half after it, where the velocity is known when the next step starts: then it is booked, so the loss
is that until t_n. The velocities that a step leaves include contact, but its sums of kinetic energy
do not: they lack half of the impulse times the velocity before it.

Most listed nodes touch nothing. Those that cannot touch anything in the next few steps, by their
distance from their partners and by the speed of what is no dust, rest meanwhile: no step looks at
them. A node that dust touches is awake in that step.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.model.material import bars_of
from taichi_ldem.solver.contact.kernels.cells import BLOCK, DISTANCE, DRIVEN, FAST
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.contact.kernels.pairs import (
    LATE,
    LONGEST,
    QUICKER,
    SKIN,
    distance_of_contact,
)
from taichi_ldem.solver.contact.kernels.spheres import ENERGY, STIFFER, Effect, SoftSpheres
from taichi_ldem.solver.dynamics import Dynamics, field_apart

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

OF_LISTED = ("friction", "home", "loose", "shown", "joins", "rest")
"""Fields of a checkpoint with a value for each listed node, apart from the ends of their pairs."""

# the entries of ``works``
ELASTIC, PLATE_BEFORE, LOST = range(3)


def driven_speed(scene: "Scene") -> float:
    """The largest speed that a striker, a load or grips give to nodes, m/s."""
    speeds = [striker.speed for striker in scene.strikers]
    speeds += [load.largest_speed for load in scene.loads]
    if scene.grips is not None:
        speeds.append(abs(scene.grips.velocity))
    return max(speeds, default=0.0)


@dataclass(frozen=True)
class Touching:
    """Energies of contact between pieces at the time t_n of a sample, J.

    Attributes:
        elastic: stored where pieces touch.
        plate_before: half-step work on the plate before t_n.
        lost: by friction until t_n.
    """

    elastic: float = 0
    plate_before: float = 0
    lost: float = 0


@ti.data_oriented
class Fragments(SoftSpheres):
    """Contact of pieces of the plate.

    Attributes:
        name: of the declaration.
        impulse, friction: on each listed node in the latest step, all and friction's, N s.
        moved: 1 if a listed node that is no dust has moved far since the listing.
        rest: steps in which a listed node need not be looked at.
        seen, struck: the latest ``stamp`` at which a listed node was awake, or touched by dust.
        dust_in, dust_after: the first dust in a cell (where ``dusty_in`` is the latest ``stamp``, a
            count of steps), and the next in the same cell after each, in ascending order; -1 where
            there is none.
        works: of each listed node (see ``ELASTIC``), J; the loss since the start.
    """

    name = ""

    def __init__(self, dynamics: Dynamics, scene: "Scene"):
        super().__init__(dynamics)
        self.impulse = field_apart(ti.f64, self.capacity, 3)
        self.friction = field_apart(ti.f64, self.capacity, 3)
        self.works = field_apart(ti.f64, self.capacity, 3)
        self.work_sums = field_apart(ti.f64, self.capacity // BLOCK + 1, 3)
        self.moved, self.stamp = field_apart(ti.i32, 1), field_apart(ti.i32, 1)
        self.dusty_in, self.dust_in = (field_apart(ti.i32, self.hot.shape[0]) for _ in range(2))
        self.dust_after = field_apart(ti.i32, self.capacity)
        self.rest, self.seen, self.struck = (field_apart(ti.i32, self.capacity) for _ in range(3))
        self.reset(scene)

    # -- on the host -------------------------------------------------------------------------------

    def reset(self, scene: "Scene") -> None:
        """Put everything back to t = 0 with the numbers of another scene."""
        lattice, edge = self.dynamics.lattice, bars_of(scene)[0]
        assert scene.contact is not None
        whole = scene.material.density * lattice.spacing**3 * lattice.cell.node_shares[255, 0]
        self.distance = distance = distance_of_contact(self.dynamics)
        stiffness = 2 * STIFFER * edge.axial_stiffness / edge.length / whole
        reach = (1 + SKIN) * distance
        friction, driven = scene.contact.friction, driven_speed(scene)
        numbers = (distance, reach, stiffness, friction, np.inf, 1 / reach, driven)
        self.numbers.from_numpy(np.array(numbers))
        self.find_surface()
        for field in (self.count, self.works, self.impulse, self.friction):
            field.fill(0)
        self.begin_lists(0)
        self.most = 0

    def list_anew(self, now: int, step: int, time_step: float) -> None:
        """List the pairs, and complete what the latest step left open."""
        self._settle(self.size)
        self.list_pairs(now, step, time_step)
        self.most = max(self.most, self.size)
        self._forget(self.size)

    def renew(self, step: int) -> None:
        """Forget the steps so far, before one that starts from another state."""
        self._forget(self.size)
        self.begin_lists(step)

    def compile(self, now: int) -> None:
        """Compile all kernels of the listing and of samples; the lists change."""
        spacing = self.dynamics.lattice.spacing
        self.list_anew(now, self.next_listing, 0.0)
        self._settle_in(now, spacing, 0)
        self._sort(0)
        self._list_dust(0)
        self._find_pairs(0, 0)
        self._weigh(0)
        self.reading()

    def press(self, now: int, spacing: float, time_step: float) -> None:
        """Compute the impulses of a step that starts at the displacement ``now``."""
        if self._press(now, spacing, time_step, self.size, self.dust_size):
            self.next_listing = 0

    def look_whether_moved(self) -> None:
        """Let the list be made anew at the next step if a step of a launch has moved a node far."""
        if self.moved[0]:
            self.next_listing = 0

    def reading(self) -> Touching:
        """Energies at the start of the latest step."""
        values = np.zeros(3)
        self._add_up(values, self.size, self.most)
        return Touching(*values.tolist())

    def kernel_names(self) -> list[str]:
        """Names of the kernels that a run compiles for contact."""
        return [f"contact: {self.name}", f"pairs near: {self.name}"]

    def fields(self) -> dict[str, ti.Field]:
        """All fields by name, ``part.field``."""
        own = {name: value for name, value in vars(self).items() if isinstance(value, ti.Field)}
        own |= {f"surface_{s}": field for s, field in enumerate(self.surface)}
        return {f"{self.name}.{name}": value for name, value in own.items()}

    def saved_state(self) -> dict[str, npt.NDArray]:
        """Copies of the state before the next step: the lists, open works, sums."""
        size = self.size
        ends = self.pair_ends.to_numpy()[:size]
        return {
            "schedule": np.array([self.next_listing, self.known, self.patience]),
            "fast": np.array(self.numbers[FAST]),
            "nodes": self.nodes.to_numpy()[:size],
            "ends": ends,
            "pairs": self.pairs.to_numpy()[: ends[-1] if size else 0],
            "works": self.works.to_numpy()[: self.most],
            **{name: getattr(self, name).to_numpy()[:size] for name in OF_LISTED},
        }

    def restore_state(self, saved: Mapping[str, npt.NDArray]) -> None:
        """Continue from ``saved_state``.

        Raises:
            ValueError: the lists do not belong to this lattice.
        """
        nodes, ends, pairs = saved["nodes"], saved["ends"], saved["pairs"]
        size, total = len(nodes), len(pairs)
        fits = size <= len(saved["works"]) <= self.capacity and total <= self.pairs.shape[0]
        fits &= all(len(saved[name]) == size for name in ("ends", *OF_LISTED))
        fits &= total == (ends[-1] if size else 0) and not (np.diff(ends, prepend=0) < 0).any()
        for numbers, limit in ((nodes, self._node_numbers()), (pairs, size)):
            fits &= not len(numbers) or bool(numbers.min() >= 0 and numbers.max() < limit)
        if not fits:
            raise ValueError("the pairs of nodes that may touch are of another lattice")
        self.size, self.most = size, len(saved["works"])
        self.next_listing, self.known, self.patience = saved["schedule"].tolist()
        self.count.from_numpy(np.array([size, size], dtype=np.int32))
        for name in ("nodes", "pairs", "works", *OF_LISTED):
            field = getattr(self, name)
            padded = field.to_numpy()
            padded[:] = 0
            padded[: len(saved[name])] = saved[name]
            field.from_numpy(padded)
        self.moved.fill(0)
        self.numbers[FAST] = float(saved["fast"])
        self._weigh(size)
        self._sort_cells()
        padded = self.pair_ends.to_numpy()
        padded[:size] = ends
        self.pair_ends.from_numpy(padded)

    # -- in a step ---------------------------------------------------------------------------------

    @ti.kernel
    def _settle(self, size: int):
        """Book the friction of the latest step at the velocities after it."""
        for a in range(size):
            friction = self.friction[a]
            if friction.dot(friction) > 0:
                s, k, j, i = self.site_of(a)
                velocity = ti.cast(self.dynamics.node_velocity(s, k, j, i), ti.f64)
                self.works[a][LOST] = self.works[a][LOST] - 0.5 * friction.dot(velocity)

    @ti.kernel
    def _forget(self, size: int):
        """Clear what belongs to the steps with the list before."""
        for a in range(size):
            self.impulse[a], self.friction[a] = vec3d(0.0, 0.0, 0.0), vec3d(0.0, 0.0, 0.0)
            self.works[a] = vec3d(0.0, 0.0, self.works[a][LOST])
            self.rest[a] = 0
        for n in range(1):
            self.moved[n] = 0

    @ti.kernel
    def _weigh(self, size: int):
        for a in range(size):
            s, k, j, i = self.site_of(a)
            self.mass[a] = ti.cast(self.dynamics.node_mass(s, k, j, i), ti.f64)

    @ti.kernel
    def _press(self, now: int, spacing: float, time_step: float, size: int, dust: int) -> int:
        self.find_impulses(now, spacing, time_step, size, dust)
        return self.moved[0]

    @ti.func
    def find_impulses(self, now, spacing, time_step, size, dust):
        """Compute the impulses of a step, and book its works."""
        for n in range(1):
            self.stamp[n] = self.stamp[n] + 1
        for a in range(size):
            if self.rest[a] > 0:
                self.rest[a] = self.rest[a] - 1
            else:
                self.visit(a, now, spacing)
        ti.loop_config(serialize=True)
        for n in range(dust):
            # from the last one, so that each cell's are in ascending order
            b = self.dust[dust - 1 - n]
            cell, after = self.number_of(self.position[b]), -1
            if self.dusty_in[cell] == self.stamp[0]:
                after = self.dust_in[cell]
            self.dust_after[b], self.dust_in[cell] = after, b
            self.dusty_in[cell] = self.stamp[0]
        for n in range(dust):
            self.strike_around(self.dust[n], now, spacing)
        for a in range(size):
            if self.seen[a] == self.stamp[0]:
                self.press_node(a, spacing, ti.cast(time_step, ti.f64))

    @ti.func
    def press_node(self, a, spacing, time_step):
        """Compute the impulses of a node, and book its works; or let it rest."""
        found, rest = self.gathered(a, spacing, time_step)
        push, drag = self.impulses(found)
        velocity = ti.cast(self.before[a], ti.f64)
        # the latest step's friction acted until the middle of this velocity, and this one's from
        # there on
        work = 0.5 * (self.friction[a] + drag).dot(velocity)
        lost = self.works[a][LOST] - work
        self.works[a] = vec3d(found[ENERGY], 0.5 * (push + drag).dot(velocity), lost)
        self.impulse[a], self.friction[a] = push + drag, drag
        if found[ENERGY] == 0 and self.loose[a] == 0:
            self.rest[a] = rest

    @ti.func
    def visit(self, a, now, spacing):
        """Note where a node is and how fast, and whether it has moved far."""
        s, k, j, i = self.site_of(a)
        place = self.place(now, s, k, j, i, spacing)
        self.position[a], self.before[a] = place, self.dynamics.node_velocity(s, k, j, i)
        self.seen[a] = self.stamp[0]
        if self.loose[a] == 0:
            way, least = place - self.home[a], LATE * SKIN * self.numbers[DISTANCE]
            if way.dot(way) > least * least:
                self.moved[0] = 1

    @ti.func
    def strike_around(self, a, now, spacing):
        """Mark the listed nodes that touch dust, and wake them."""
        place = self.position[a]
        cell = self.cell_of(place)
        least = self.numbers[DISTANCE] * self.numbers[DISTANCE]
        radius = (1 + 0.5 * SKIN) * self.numbers[DISTANCE]
        low, high = self.cells_within(place, radius)
        for z in range(low[2], high[2] + 1):
            for y in range(low[1], high[1] + 1):
                for x in range(low[0], high[0] + 1):
                    there = self.beside(cell, z, y, x)
                    for n in range(self.starts[there], self.starts[there + 1]):
                        if self.is_near_member(a, n, radius):
                            b = self.members[n]
                            s, k, j, i = self.site_of(b)
                            away = place - self.place(now, s, k, j, i, spacing)
                            if away.dot(away) < least:
                                self.strike(b, now, spacing)

    @ti.func
    def is_near_member(self, a, n, radius):
        """Whether a member of a cell that is no dust may touch dust, by where it was listed."""
        away, found = self.position[a] - self.member_home[n], False
        if away.dot(away) < radius * radius:
            b = self.members[n]
            found = self.loose[b] == 0 and self.shown[a] + self.shown[b] > 0
            found = found and not self.are_joined(a, b)
        return found

    @ti.func
    def strike(self, b, now, spacing):
        """Mark a listed node that dust touches; all threads write the same."""
        self.struck[b] = self.stamp[0]
        if self.rest[b] > 0 or self.seen[b] != self.stamp[0]:
            self.visit(b, now, spacing)
            self.rest[b] = 0

    @ti.func
    def gathered(self, a, spacing, time_step):
        """The sum of what a node's contacts do to it, and the steps that it may rest."""
        total, rest = self.with_partners(a, spacing, time_step)
        if self.loose[a] != 0 or self.struck[a] == self.stamp[0]:
            place = self.position[a]
            cell = self.cell_of(place)
            low, high = self.cells_within(place, self.numbers[DISTANCE])
            for z in range(low[2], high[2] + 1):
                for y in range(low[1], high[1] + 1):
                    for x in range(low[0], high[0] + 1):
                        total += self.with_dust(a, self.beside(cell, z, y, x), spacing, time_step)
            if self.loose[a] != 0:
                total += self.with_listed(a, cell, spacing, time_step)
        return total, rest

    @ti.func
    def with_partners(self, a, spacing, time_step):
        """The same for its partners."""
        total, least = Effect(0.0), self.numbers[DISTANCE]
        # the way of a node in a step, and what it may cover until it is looked at again
        # a body may give it any speed up to twice its own while it rests
        way = ti.max(QUICKER * self.numbers[FAST], 2 * self.numbers[DRIVEN]) * time_step
        rest = self.whole_steps((0.5 - LATE) * SKIN * least - way, way)
        for n in range(self.first_pair(a), self.pair_ends[a]):
            b = self.pairs[n]
            if self.seen[b] == self.stamp[0]:
                away = self.position[a] - self.position[b]
                rest = ti.min(rest, self.whole_steps(away.norm() - least, 2 * way))
                total += self.contact(a, b, spacing, time_step)
            else:
                rest = ti.min(rest, self.rest[b])
        return total, rest

    @ti.func
    def whole_steps(self, distance, way):
        """Number of ways that fit into a distance; 0 where they do not, or are not known."""
        count = 0
        if distance > way:
            count = ti.cast(ti.min(distance / way, LONGEST), ti.i32)
        return count

    @ti.func
    def with_dust(self, a, cell, spacing, time_step):
        """The same for the dust that is in a cell now."""
        total, other = Effect(0.0), -1
        if self.dusty_in[cell] == self.stamp[0]:
            other = self.dust_in[cell]
        while other >= 0:
            total += self.unpaired(a, other, spacing, time_step)
            other = self.dust_after[other]
        return total

    @ti.func
    def with_listed(self, a, cell, spacing, time_step):
        """The same for dust and what was listed in the cells around it, but for other dust."""
        total = Effect(0.0)
        # what was listed has moved since
        radius = (1 + 0.5 * SKIN) * self.numbers[DISTANCE]
        low, high = self.cells_within(self.position[a], radius)
        # cells above each other follow each other, but for the ends of the grid
        within = 0 < cell[2] < ti.static(self.dims[2] - 1)
        for part in range(ti.select(within, 0, low[2]), ti.select(within, 0, high[2]) + 1):
            bottom, top = ti.select(within, low[2], part), ti.select(within, high[2], part)
            for y in range(low[1], high[1] + 1):
                for x in range(low[0], high[0] + 1):
                    last = self.starts[self.beside(cell, top, y, x) + 1]
                    for n in range(self.starts[self.beside(cell, bottom, y, x)], last):
                        b = self.members[n]
                        # what it touches has been struck
                        if self.struck[b] == self.stamp[0] and self.loose[b] == 0:
                            total += self.unpaired(a, b, spacing, time_step)
        return total

    @ti.func
    def unpaired(self, a, b, spacing, time_step):
        """What another listed node does to a node where one of them is dust."""
        effect, least = Effect(0.0), self.numbers[DISTANCE]
        away = self.position[a] - self.position[b]
        near = a != b and away.dot(away) < least * least
        if near and self.shown[a] + self.shown[b] > 0 and not self.are_joined(a, b):
            effect = self.contact(a, b, spacing, time_step)
        return effect

    @ti.func
    def kick(self, now, time_step, damping, size):
        """Give the nodes that touch their impulses, after the passes of the step."""
        for a in range(size):
            impulse = vec3d(0.0, 0.0, 0.0)
            if self.seen[a] == self.stamp[0]:
                impulse = self.impulse[a]
            if impulse.dot(impulse) > 0:
                s, k, j, i = self.site_of(a)
                dt = ti.cast(time_step, ti.f64)
                inertia = self.mass[a]
                if ti.static(self.dynamics.features.damping):
                    # as for rigid bodies: half of a step's damping resists the change
                    inertia *= 1 + 0.5 * ti.cast(damping, ti.f64) * dt
                free = ti.cast(self.dynamics.node_velocity(s, k, j, i), ti.f64)
                velocity = free + impulse / inertia
                if ti.static(self.dynamics.features.damping):
                    # the loss by damping was added for the velocity of the free flight
                    mean = 0.25 * (2 * ti.cast(self.before[a], ti.f64) + free + velocity)
                    drag = ti.cast(damping, ti.f64) * self.mass[a] * mean
                    energy = ti.cast(drag.dot(dt * (velocity - free)), float)
                    self.dynamics.add_damped(s, k, j, i, energy)
                old = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
                new = ti.cast(old + dt * velocity, float)
                self.dynamics.put_node(1 - now, s, k, j, i, new, ti.cast(velocity, float))

    # -- samples -----------------------------------------------------------------------------------

    @ti.kernel
    def _add_up(self, values: ti.types.ndarray(), size: int, most: int):
        for block in range((most + BLOCK - 1) // BLOCK):
            total = vec3d(0.0, 0.0, 0.0)
            for a in range(block * BLOCK, ti.min((block + 1) * BLOCK, most)):
                works = self.works[a]
                if a >= size:
                    works[ELASTIC], works[PLATE_BEFORE] = 0.0, 0.0
                total += works
            self.work_sums[block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = vec3d(0.0, 0.0, 0.0)
            for block in range((most + BLOCK - 1) // BLOCK):
                total += self.work_sums[block]
            for n in ti.static(range(3)):
                values[n] = total[n]
