"""Contact of nodes that were not neighbours: soft spheres with friction.

Two nodes of a pair (``pairs``) touch when they are closer than the shortest bar of the lattice, d,
or than they were at rest, if that is less. They then push each other apart with k (d - r), and
friction resists their sliding. A bar fails in tension, when its ends are further apart than at
rest, so a pair is never inside each other when it becomes one.

The stiffness is k = 2 STIFFER m k_l / m_0: of two nodes inside the body, STIFFER of that of a bar
along an edge, k_l = EA/L, and for lighter nodes less, by their reduced mass m. With n contacts at
a node at most, the element-wise bound gives the contacts alone a highest frequency of
omega^2 <= 2 STIFFER n k_l / m_0; the lattice's own is 16 k_l / m_0 (``module``) or 9.5
(``cubic-26``). So ten contacts at each node of intact bodies would raise omega^2 by a third or a
half, which the default safety of one half leaves room for. Nodes that have lost bars need less.

Friction is Coulomb's, regularised in the sliding velocity and without memory: its impulse in a step
is the friction coefficient times the normal one, but at most STICK of what would stop the sliding.
Pieces under a shear load T < mu N creep at T dt / (STICK m). It acts at the velocity half a step
before the displacement. With the lattice's own frequency as above, dt stays stable if
(omega dt)^2 + 2 n STICK < 4.

Forces are those at t_n, so that contact is a part of the same central differences. Each node
gathers its own pairs in their order; both ends compute the same numbers with opposite signs. The
energy of the springs follows from the positions. Half of the work of friction lies before t_n and
half after it, where the velocity is known when the next step starts: then it is booked, so the loss
is that until t_n. The velocities that a step leaves include contact, but its sums of kinetic energy
do not: they lack half of the impulse times the velocity before it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.model.material import bars_of
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.contact.kernels.pairs import (
    BLOCK,
    DISTANCE,
    FRICTION,
    LATE,
    SKIN,
    STIFFNESS,
    NearbyPairs,
    distance_of_contact,
)
from taichi_ldem.solver.dynamics import Dynamics, field_apart

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

STIFFER = 0.25
"""Stiffness of a contact of two nodes inside the body over that of a bar along an edge."""

STICK = 0.1
"""Largest share of the sliding of two free nodes that friction stops within a step."""

TINY = 1e-12
"""Least distance of two nodes, over that of contact, that has a direction."""

OF_LISTED = ("friction", "home", "loose", "shown", "joins")
"""Fields of a checkpoint with a value for each listed node, apart from the ends of their pairs."""

# the entries of what a contact does to a node: impulses (N s), and half of the energy (J)
Effect = ti.types.vector(7, ti.f64)
PUSH, DRAG, ENERGY = range(0, 7, 3)

# the entries of ``works``
ELASTIC, PLATE_BEFORE, LOST = range(3)


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
class Fragments(NearbyPairs):
    """Contact of pieces of the plate.

    Attributes:
        name: of the declaration.
        before: velocity of the listed nodes before the step, m/s.
        impulse, friction: on each listed node in the latest step, all and friction's, N s.
        moved: 1 if a listed node that is no dust has moved far since the listing.
        dusty: a bit for each cell around a cell, 9 z + 3 y + x from (-1, -1, -1) on: there is dust
            in it that may touch something in this cell.
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
        self.dusty, self.dusty_in, self.dust_in = (
            field_apart(ti.i32, self.hot.shape[0]) for _ in range(3)
        )
        self.dust_after = field_apart(ti.i32, self.capacity)
        self.reset(scene)

    # -- on the host -------------------------------------------------------------------------------

    def reset(self, scene: "Scene") -> None:
        """Put everything back to t = 0 with the numbers of another scene."""
        lattice, edge = self.dynamics.lattice, bars_of(scene)[0]
        assert scene.contact is not None
        whole = scene.material.density * lattice.spacing**3 * lattice.cell.node_shares[255, 0]
        self.distance = distance = distance_of_contact(self.dynamics)
        stiffness = 2 * STIFFER * edge.axial_stiffness / edge.length / whole
        numbers = (distance, (1 + SKIN) * distance, stiffness, scene.contact.friction, np.inf)
        self.numbers.from_numpy(np.array(numbers))
        self.find_surface()
        for field in (self.count, self.works, self.impulse, self.friction):
            field.fill(0)
        self.size, self.dust_size, self.next_listing, self.most = 0, 0, 0, 0

    def list_anew(self, now: int, step: int, time_step: float) -> None:
        """List the pairs, and complete what the latest step left open."""
        self._settle(self.size)
        self.list_pairs(now, step, time_step)
        self.most = max(self.most, self.size)
        self._forget(self.size)

    def renew(self, step: int) -> None:
        """Forget the steps so far, before one that starts from another state."""
        self._forget(self.size)
        self.size, self.dust_size, self.next_listing = 0, 0, step

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
            "schedule": np.array(self.next_listing),
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
        self.next_listing = int(saved["schedule"])
        self.count.from_numpy(np.array([size, size], dtype=np.int32))
        for name in ("nodes", "pairs", "works", *OF_LISTED):
            field = getattr(self, name)
            padded = field.to_numpy()
            padded[:] = 0
            padded[: len(saved[name])] = saved[name]
            field.from_numpy(padded)
        self.moved.fill(0)
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
            s, k, j, i = self.site_of(a)
            velocity = ti.cast(self.dynamics.node_velocity(s, k, j, i), ti.f64)
            work = 0.5 * self.friction[a].dot(velocity)
            self.works[a][LOST] = self.works[a][LOST] - work

    @ti.kernel
    def _forget(self, size: int):
        """Clear what belongs to the steps with the list before."""
        for a in range(size):
            self.friction[a] = vec3d(0.0, 0.0, 0.0)
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
        for cell in range(ti.select(dust > 0, ti.static(self.hot.shape[0]), 0)):
            self.dusty[cell] = 0
        for a in range(size):
            s, k, j, i = self.site_of(a)
            place = self.place(now, s, k, j, i, spacing)
            self.position[a] = place
            self.before[a] = self.dynamics.node_velocity(s, k, j, i)
            way, least = place - self.home[a], LATE * SKIN * self.numbers[DISTANCE]
            if self.loose[a] != 0:
                self.announce_dust(place)
            elif way.dot(way) > least * least:
                self.moved[0] = 1
        ti.loop_config(serialize=True)
        for n in range(dust):
            # from the last one, so that each cell's are in ascending order
            b = self.dust[dust - 1 - n]
            cell, after = self.number_of(self.position[b]), -1
            if self.dusty_in[cell] == self.stamp[0]:
                after = self.dust_in[cell]
            self.dust_after[b], self.dust_in[cell] = after, b
            self.dusty_in[cell] = self.stamp[0]
        for a in range(size):
            found = self.gathered(a, spacing, ti.cast(time_step, ti.f64), dust)
            push, drag = self.impulses(found)
            velocity = ti.cast(self.before[a], ti.f64)
            # the latest step's friction acted until the middle of this velocity, and this one's
            # from there on
            work = 0.5 * (self.friction[a] + drag).dot(velocity)
            lost = self.works[a][LOST] - work
            self.works[a] = vec3d(found[ENERGY], 0.5 * (push + drag).dot(velocity), lost)
            self.impulse[a], self.friction[a] = push + drag, drag

    @ti.func
    def impulses(self, effect):
        """The normal impulse of an effect, and that of friction."""
        push, drag = vec3d(0.0, 0.0, 0.0), vec3d(0.0, 0.0, 0.0)
        for axis in ti.static(range(3)):
            push[axis], drag[axis] = effect[PUSH + axis], effect[DRAG + axis]
        return push, drag

    @ti.func
    def announce_dust(self, place):
        """Tell the cells in which something may touch dust at a place where it is."""
        cell = self.cell_of(place)
        low, high = self.cells_within(place, self.numbers[DISTANCE])
        for z in range(low[2], high[2] + 1):
            for y in range(low[1], high[1] + 1):
                for x in range(low[0], high[0] + 1):
                    back = 9 * (1 - z) + 3 * (1 - y) + 1 - x
                    ti.atomic_or(self.dusty[self.beside(cell, z, y, x)], 1 << back)

    @ti.func
    def gathered(self, a, spacing, time_step, dust):
        """The sum of what a node's contacts do to it."""
        total = Effect(0.0)
        for n in range(self.first_pair(a), self.pair_ends[a]):
            total += self.contact(a, self.pairs[n], spacing, time_step)
        if dust > 0:
            cell = self.cell_of(self.position[a])
            around = self.dusty[self.beside(cell, 0, 0, 0)]
            if around != 0:
                for n in range(27):
                    if (around >> n) & 1 != 0:
                        there = self.beside(cell, n // 9 - 1, n // 3 % 3 - 1, n % 3 - 1)
                        total += self.with_dust(a, there, spacing, time_step)
            if self.loose[a] != 0:
                total += self.with_listed(a, cell, spacing, time_step)
        return total

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
                        if self.loose[b] == 0:
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
    def contact(self, a, b, spacing, time_step):
        """What another listed node does to a node."""
        effect, distance = Effect(0.0), self.numbers[DISTANCE]
        away = self.position[a] - self.position[b]
        square = away.dot(away)
        if square < distance * distance:
            length = ti.sqrt(square)
            depth = self.contact_distance(a, b, spacing) - length
            if depth > 0:
                normal = away / ti.max(length, TINY * distance)
                reduced = self.mass[a] * self.mass[b] / (self.mass[a] + self.mass[b])
                stiffness = self.numbers[STIFFNESS] * reduced
                impulse = time_step * stiffness * depth
                drag = self.friction_between(impulse, reduced, a, b, normal)
                for axis in ti.static(range(3)):
                    effect[PUSH + axis] = impulse * normal[axis]
                    effect[DRAG + axis] = -drag[axis]
                effect[ENERGY] = 0.25 * stiffness * depth * depth
        return effect

    @ti.func
    def friction_between(self, impulse, reduced, a, b, normal):
        """Impulse of friction between two nodes, along their sliding."""
        sliding = ti.cast(self.before[a], ti.f64) - ti.cast(self.before[b], ti.f64)
        sliding -= normal * sliding.dot(normal)
        speed = sliding.norm()
        factor = ti.cast(0.0, ti.f64)
        if speed > 0:
            factor = ti.min(self.numbers[FRICTION] * impulse / speed, STICK * reduced)
        if self.numbers[FRICTION] == 0:
            factor = 0.0
        return factor * sliding

    @ti.func
    def contact_distance(self, a, b, spacing):
        """Distance at which two listed nodes touch, m."""
        distance = self.numbers[DISTANCE]
        if ti.static(self.dynamics.features.perturbed):
            s, k, j, i = self.site_of(a)
            t, m, g, h = self.site_of(b)
            rest = self.rest_position(s, k, j, i, spacing)
            rest -= self.rest_position(t, m, g, h, spacing)
            distance = ti.min(distance, rest.norm())
        return distance

    @ti.func
    def kick(self, now, time_step, damping, size):
        """Give the nodes that touch their impulses, after the passes of the step."""
        for a in range(size):
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
