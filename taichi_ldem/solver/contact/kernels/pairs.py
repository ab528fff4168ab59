"""The pairs of nodes that may touch: a list that is made anew when something has moved far enough.

A node is *bare* if one of its bars has failed or was removed by a notch. A node at the *rim* has
fewer bars than one inside the body. A pair is made of a bare node and of one that is bare or at the
rim, with no bar between them that still carries compression.

Bare nodes mark the cells of a grid around them. The nodes in marked cells are listed in ascending
order, sorted into the cells, and each gets the numbers of its partners in ascending order. The grid
is wrapped around, so that it has no ends that debris could leave: nodes that share a cell that way
are far apart. Atomics add whole numbers only, whose order does not matter; the order of every list
is fixed, and with it the order of all sums.

A node that flies off at hundreds of metres a second would ask for a new list every few steps. Such
*dust*, listed nodes that are fast, has no partners in the list: wherever it is in a step, it is
compared with what was listed in the cells around it, and with other dust.
"""

import math

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.errors import TooManyNodes
from taichi_ldem.model.cell import UnitCell
from taichi_ldem.solver.contact.kernels.cells import (
    FAST,
    REACH,
    NodesInCells,
)
from taichi_ldem.solver.contact.kernels.nearby import WORD
from taichi_ldem.solver.contact.sizes import most_nodes, most_pairs
from taichi_ldem.solver.dynamics import Dynamics, field_apart
from taichi_ldem.solver.lanes import HALO

SKIN = 0.3
"""Distance that two nodes may approach each other between two listings, over that of contact."""

LONGEST = 64
"""Most steps between two listings."""

SOON = 16
"""Most steps to the next listing where bars have failed before this one. Their ends touch nothing
of each other before they are listed, and where they have come near until then, the springs between
them hold energy from nowhere. Where no bar fails, the steps double until they are LONGEST."""

FEWEST = 48
"""Steps between two listings that a fast node would allow if it had partners in the list."""

LATE = 0.4
"""Share of the skin that a node may cover since the listing: less than a half, as nodes are looked
at every few steps, and the list is made anew at the step after."""

QUICKER = 1.2
"""Speed that a node that is no dust may come to before it is looked at again, over that from which
a node is dust when the list is made."""

FARTHEST = 16
"""Most cells that dust may pass through between two listings."""

# the entries of ``fastest``
UNLISTED, DUST = range(2)


def places_of_bars(cell: UnitCell) -> npt.NDArray[np.int32]:
    """Place of the bar between two nodes among those of the first; -1 where there is none.

    For every pair of sublattices, and of offsets from -1 to 1 along z, y, x of the second node.
    """
    found = np.full((cell.sublattices, cell.sublattices, 3, 3, 3), -1, dtype=np.int32)
    for s, nodes in enumerate(cell.neighbours):
        for n, (other, (z, y, x)) in enumerate(nodes):
            found[s, other, z + 1, y + 1, x + 1] = n
    return found.ravel()


def distance_of_contact(dynamics: Dynamics) -> float:
    """Distance at which two nodes touch, m: the length of the shortest bar of a regular lattice."""
    return math.sqrt(min(dynamics.cell.length_squared)) * dynamics.spacing


@ti.data_oriented
class NearbyPairs(NodesInCells):
    """The nodes near bare ones, and for each of them its partners.

    Attributes:
        size, dust_size: numbers of listed nodes, and of those that are dust.
        distance: at which nodes touch, m.
        next_listing: step at which the list has to be made again.
        mass: of the listed nodes, kg.
        pairs: partners, as places in the list; those of node a end before ``pair_ends[a]``.
        bare, marks: a bit for each column of a piece of a row: its node is bare, or listed.
        loose, shown: 1 for listed nodes that are dust, or bare. dust: places in the list of dust.
        joins: a bit for each bar of a listed node, as in ``UnitCell.scalars``, that pushes its ends
            apart. between: the place there of a bar between two nodes; -1 where there is none.
        surface: a bit for each lane of a column: its node is at the rim of the body at rest.
        fastest: squares of the largest speeds, of nodes at the rim not listed, and of dust.
        gone: number of failed and removed bars, each counted at both ends. known: the same at the
            latest listing. patience: most steps from it to the next.
    """

    def __init__(self, dynamics: Dynamics):
        lattice, cell = dynamics.lattice, dynamics.cell
        self.distance = distance_of_contact(dynamics)
        most = most_nodes(lattice.modules, cell.sublattices)
        super().__init__(dynamics, most, (1 + SKIN) * self.distance)
        self.begin_lists(0)
        self.loose = field_apart(ti.i32, self.capacity)
        self.dust = field_apart(ti.i32, self.capacity)
        self.joins = field_apart(ti.i32, self.capacity)
        self.shown = field_apart(ti.i32, self.capacity)
        self.between = field_apart(ti.i32, cell.sublattices**2 * 27)
        self.between.from_numpy(places_of_bars(cell))
        self.mass = field_apart(ti.f64, self.capacity)
        self.pair_ends = field_apart(ti.i32, self.capacity)
        self.pairs = field_apart(ti.i32, most_pairs(self.capacity))
        self.bare = field_apart(ti.i32, self.marks.shape[0])
        self.surface = [field_apart(ti.u8, dynamics.shape) for _ in range(cell.sublattices)]
        self.fastest = field_apart(ti.f32, 2)
        self.gone = field_apart(ti.i32, 1)
        self.homes = [sorted({home for _, home in bars}) for bars in cell.scalars]

    def begin_lists(self, step: int) -> None:
        """List nothing, and forget what was listed, until a list is made at a step."""
        self.size, self.dust_size, self.next_listing = 0, 0, step
        self.known, self.patience = -1, SOON

    def find_surface(self) -> None:
        """Mark the nodes of the lattice that have fewer bars than one inside it."""
        lattice, cell = self.dynamics.lattice, self.dynamics.cell
        there, exists = lattice.bar_exists(), lattice.exists()
        for s, field in enumerate(self.surface):
            whole = np.ones(lattice.sites, dtype=bool)
            for bar, home in cell.scalars[s]:
                whole &= np.roll(there[..., bar], [-n for n in home], axis=(0, 1, 2))
            rim = self.dynamics.lanes.spread(exists[s] & ~whole)
            bits = np.uint8(1) << np.arange(rim.shape[-1], dtype=np.uint8)
            field.from_numpy(np.asarray((rim * bits).sum(axis=-1, dtype=np.uint8)))

    # -- listing -----------------------------------------------------------------------------------

    def list_pairs(self, now: int, step: int, time_step: float) -> None:
        """List the pairs that may touch until a listed node has moved far enough.

        The list is made again at ``next_listing`` at the latest, which is set here.

        Raises:
            TooManyNodes: there are more pairs than the list holds.
        """
        spacing = self.dynamics.lattice.spacing
        limit = 2 * FEWEST * time_step
        self.numbers[FAST] = SKIN * self.distance / limit if limit > 0 else math.inf
        self._expose(now, spacing, time_step)
        gone = int(self.gone[0])
        self.patience = SOON if gone != self.known else min(2 * self.patience, LONGEST)
        self.known = gone
        self._list(now, spacing, 0.0)
        self.size = int(self.count[0])
        self.next_listing = step + self._steps(time_step)
        if self.size == 0:
            self.dust_size = 0
            return
        self._settle_in(now, spacing, self.size)
        self._sort_cells()
        self._find_pairs(self.size, 0)
        total = int(self.pair_ends[self.size - 1])
        if total > self.pairs.shape[0]:
            self.size = 0
            raise TooManyNodes(
                f"{total} pairs of nodes came near each other, and the list of [contact] holds "
                f"{self.pairs.shape[0]}: the pieces are crushed; end the run earlier "
                "(solver.duration) or strike more slowly"
            )
        self._find_pairs(self.size, 1)

    def _sort_cells(self) -> None:
        """Sort the listed nodes into cells, and list the dust among them."""
        self._sort(self.size)
        self._list_dust(self.size)
        self.dust_size = int(self.pair_ends[self.size - 1]) if self.size else 0

    def _steps(self, time_step: float) -> int:
        """Most steps until the list has to be made again."""
        ways = time_step * np.sqrt(self.fastest.to_numpy().astype(np.float64))
        reach = (1 + SKIN) * self.distance
        # what is not listed may come nearer by half of the skin, and dust may fly so far
        allowed = 0.5 * SKIN * self.distance, (FARTHEST - 1) * reach
        steps = [free / way for free, way in zip(allowed, ways, strict=True) if way > 0]
        return max(1, int(min([self.patience, *steps])))

    @ti.kernel
    def _expose(self, now: int, spacing: float, time_step: float):
        """Find the bare nodes and the dust among them, and the cells that they may come to."""
        nz, ny = ti.static(self.dynamics.sites[:2])
        for cell in range(self.hot.shape[0]):
            self.hot[cell] = 0
        for n in range(2):
            self.fastest[n] = 0.0
        for n in range(1):
            self.gone[n] = 0
        for k, j, word in ti.ndrange((1, nz - 1), (1, ny - 1), self.words):
            self.mark_bare(now, k, j, word, spacing, time_step)

    @ti.func
    def word_of(self, s, k, j, lane, word):
        """Place in the marks of a piece of a row."""
        nz, ny, _ = ti.static(self.dynamics.sites)
        return ((s * nz + k) * ny + j) * self.row_words() + lane * self.words + word

    @ti.func
    def mark_bare(self, now, k, j, word, spacing, time_step):
        """Mark the bare nodes of a piece of a row, and the cells around them."""
        begin = HALO + word * WORD
        for s in ti.static(range(self.dynamics.cell.sublattices)):
            for lane in range(self.dynamics.lanes.width):
                self.bare[self.word_of(s, k, j, lane, word)] = 0
            for m in range(begin, ti.min(begin + WORD, HALO + self.dynamics.lanes.length)):
                lanes = 0
                for home in ti.static(self.homes[s]):
                    lanes |= int(self.dynamics.touched[k + home[0], j + home[1], m + home[2]])
                if lanes != 0:
                    for lane in range(self.dynamics.lanes.width):
                        gone = 0
                        if (lanes >> lane) & 1:
                            gone = self.lost_bars(s, k, j, m, lane)
                        if gone > 0:
                            ti.atomic_add(self.gone[0], gone)
                            at = self.word_of(s, k, j, lane, word)
                            self.bare[at] = self.bare[at] | 1 << (m - begin)
                            i = self.dynamics.site_of(m, lane)
                            place = self.place(now, s, k, j, i, spacing)
                            v = ti.cast(self.dynamics.node_velocity(s, k, j, i), ti.f64)
                            self.heat_way(place, v, ti.cast(time_step, ti.f64))

    @ti.func
    def lost_bars(self, s: ti.template(), k, j, m, lane):
        """Number of a node's bars that have failed or were removed."""
        lost = 0
        for bar, home in ti.static(self.dynamics.cell.scalars[s]):
            at = ti.Struct(k=k + home[0], j=j + home[1], m=m + home[2])
            lost += int(self.is_gone(bar, at, lane))
        return lost

    @ti.func
    def is_gone(self, bar, at: ti.template(), lane):
        """Whether a bar has failed or was removed."""
        gone = False
        if ti.static(self.dynamics.features.damage):
            peak = self.dynamics.peak[bar, at.k, at.j, at.m][lane]
            gone |= self.dynamics.bars.has_failed(bar, peak)
        if ti.static(self.dynamics.features.notch):
            gone |= self.dynamics.bars.is_removed(bar, at, lane)
        return gone

    @ti.func
    def heat_way(self, place, velocity, time_step):
        """Mark the cells around a bare node, and where it is dust also around its way."""
        cells, way = 0, velocity * time_step * LONGEST
        if velocity.norm() > self.numbers[FAST]:
            self.note_speed(DUST, velocity)
            # beyond the farthest cell it does not come: the list is made again before
            way *= ti.min(1.0, (FARTHEST - 1) * self.numbers[REACH] / way.norm())
            cells = int(way.norm() / self.numbers[REACH]) + 1
        for n in range(cells + 1):
            self.heat(place + n * way / ti.max(cells, 1))

    @ti.func
    def mark(self, now, k, j, word, spacing, duration):
        """Mark the bare nodes and those at the rim, in marked cells, of a piece of a row."""
        begin = HALO + word * WORD
        for s in ti.static(range(self.dynamics.cell.sublattices)):
            for lane in range(self.dynamics.lanes.width):
                at, bits = self.word_of(s, k, j, lane, word), 0
                bare = self.bare[at]
                for m in range(begin, ti.min(begin + WORD, HALO + self.dynamics.lanes.length)):
                    bit = 1 << (m - begin)
                    rim = (int(self.surface[s][k, j, m]) >> lane) & 1
                    if rim != 0 or bare & bit != 0:
                        i = self.dynamics.site_of(m, lane)
                        place = self.place(now, s, k, j, i, spacing)
                        if self.hot[self.number_of(place)] != 0:
                            bits |= bit
                        else:
                            self.note_speed(UNLISTED, self.dynamics.node_velocity(s, k, j, i))
                self.marks[at] = bits

    @ti.func
    def note_speed(self, whose: ti.template(), velocity):
        """Keep the square of a largest speed; the order of threads does not matter."""
        square = ti.cast(velocity.dot(velocity), ti.f32)
        if square > self.fastest[whose]:
            ti.atomic_max(self.fastest[whose], square)

    # -- pairs -------------------------------------------------------------------------------------

    @ti.kernel
    def _settle_in(self, now: int, spacing: float, size: int):
        """Note where the listed nodes are, and which of them are dust."""
        for a in range(size):
            s, k, j, i = self.site_of(a)
            self.home[a] = self.place(now, s, k, j, i, spacing)
            self.mass[a] = ti.cast(self.dynamics.node_mass(s, k, j, i), ti.f64)
            velocity = ti.cast(self.dynamics.node_velocity(s, k, j, i), ti.f64)
            self.loose[a] = int(velocity.norm() > self.numbers[FAST])
            self.shown[a] = self.is_bare(a)
            self.joins[a] = self.bars_that_push(a)

    @ti.kernel
    def _list_dust(self, size: int):
        """List the dust; ``pair_ends``, which is filled afterwards, holds its numbers."""
        for a in range(size):
            self.pair_ends[a] = self.loose[a]
        self.scan(self.pair_ends, size)
        for a in range(size):
            if self.loose[a] != 0:
                self.dust[self.pair_ends[a] - 1] = a

    @ti.kernel
    def _find_pairs(self, size: int, write: int):
        """Count the partners of the listed nodes; or, with ``write``, list them."""
        for a in range(size):
            begin, found = 0, 0
            if write != 0:
                begin = self.first_pair(a)
            # dust has no partners, and only nodes with partners are looked at again to write them
            if self.loose[a] == 0 and (write == 0 or self.pair_ends[a] > begin):
                middle = self.cell_of(self.home[a])
                # cells above each other follow each other, but for the ends of the grid
                within = 0 < middle[2] < ti.static(self.dims[2] - 1)
                for x in range(middle[0] - 1, middle[0] + 2):
                    for y in range(middle[1] - 1, middle[1] + 2):
                        column = self.column(x, y)
                        for part in range(ti.select(within, 1, 3)):
                            low = self.wrapped(middle[2] + part - 1, 2)
                            high = low + ti.select(within, 2, 0)
                            first, last = self.starts[column + low], self.starts[column + high + 1]
                            found += self.partners(a, first, last, begin + found, write)
            if write != 0:
                self.sort(self.pairs, begin, begin + found)
            else:
                self.pair_ends[a] = found
        self.scan(self.pair_ends, ti.select(write == 0, size, 0))

    @ti.func
    def partners(self, a, first, last, at, write):
        """Number of a node's partners among some members; with ``write`` they are listed."""
        found, home = 0, self.home[a]
        square = self.numbers[REACH] * self.numbers[REACH]
        for n in range(first, last):
            away = home - self.member_home[n]
            if away.dot(away) < square:
                b = self.members[n]
                if a != b and self.loose[b] == 0 and self.shown[a] + self.shown[b] > 0:
                    if not self.are_joined(a, b):
                        if write != 0:
                            self.pairs[at + found] = b
                        found += 1
        return found

    @ti.func
    def first_pair(self, a):
        """Place of a node's first partner."""
        begin = 0
        if a > 0:
            begin = self.pair_ends[a - 1]
        return begin

    @ti.func
    def is_bare(self, a):
        """1 for a listed node that has lost a bar, else 0."""
        s, k, j, i = self.site_of(a)
        m, lane = self.dynamics.column_of(i)
        word, bit = (m - HALO) // WORD, (m - HALO) % WORD
        return (self.bare[self.word_of(s, k, j, lane, word)] >> bit) & 1

    @ti.func
    def are_joined(self, a, b):
        """Whether a bar between two listed nodes carried compression when they were listed."""
        nz, ny, nx = ti.static(self.dynamics.sites)
        s, t = self.nodes[a] // (nz * ny * nx), self.nodes[b] // (nz * ny * nx)
        # neither node is at an end of its row, so the numbers' difference tells the offsets
        apart = self.nodes[b] - self.nodes[a] - (t - s) * (nz * ny * nx) + (ny + 1) * nx + 1
        z, y, x = apart // (ny * nx), apart // nx % ny, apart % nx
        joined = False
        if apart >= 0 and ti.max(x, y, z) <= 2:
            sublattices = ti.static(self.dynamics.cell.sublattices)
            bar = self.between[(((s * sublattices + t) * 3 + z) * 3 + y) * 3 + x]
            joined = bar >= 0 and (self.joins[a] >> bar) & 1 != 0
        return joined

    @ti.func
    def bars_that_push(self, a):
        """A bit for each bar of a listed node that carries compression."""
        s, k, j, i = self.site_of(a)
        bits = 0
        for sublattice in ti.static(range(self.dynamics.cell.sublattices)):
            if s == sublattice:
                for n in ti.static(range(len(self.dynamics.cell.scalars[sublattice]))):
                    bar, home = ti.static(self.dynamics.cell.scalars[sublattice][n])
                    m, lane = self.dynamics.column_of(i + home[2])
                    at = ti.Struct(k=k + home[0], j=j + home[1], m=m)
                    if self.carries_compression(bar, at, lane):
                        bits |= 1 << n
        return bits

    @ti.func
    def carries_compression(self, bar, at: ti.template(), lane):
        """Whether a bar exists and pushes its ends apart; with ``closing`` a failed one does."""
        carries = self.dynamics.bars.stiffness(bar, at, lane) > 0
        if ti.static(self.dynamics.features.closing):
            if ti.static(self.dynamics.features.notch):
                carries &= not self.dynamics.bars.is_removed(bar, at, lane)
        else:
            carries &= not self.is_gone(bar, at, lane)
        return carries
