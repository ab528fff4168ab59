"""The cells of a grid into which nodes that may touch are sorted.

The grid is wrapped around, so that it has no ends that debris could leave: nodes that share a cell
that way are far apart.
"""

import math

import taichi as ti

from taichi_ldem.solver.contact.kernels.nearby import NearbyNodes
from taichi_ldem.solver.dynamics import Dynamics, field_apart

BLOCK = 256
"""Counts that one thread adds up."""

# the entries of ``numbers``
DISTANCE, REACH, STIFFNESS, FRICTION, FAST, CELLS_A_METRE, DRIVEN = range(7)


@ti.data_oriented
class NodesInCells(NearbyNodes):
    """Listed nodes, sorted into cells.

    Attributes:
        numbers: DISTANCE, REACH (m), STIFFNESS (N/m for a reduced mass of 1 kg), FRICTION, FAST,
            the speed from which a node is dust (m/s), CELLS_A_METRE, one over REACH, and DRIVEN,
            the largest speed that a rigid body or a load gives to nodes (m/s).
        dims: number of cells along x, y, z. A cell is as wide as the reach of the list.
        home: of the listed nodes when they were listed, m. member_home: the same, in the order of
            ``members``, so that the nodes of a cell lie side by side.
        hot: 1 for cells of the grid within one of a bare node.
        starts, members: first place in ``members`` of each cell, and the nodes of the cells.
        block_sums: of ``scan``.
    """

    def __init__(self, dynamics: Dynamics, capacity: int, reach: float):
        """``reach``: width of a cell, m."""
        super().__init__(dynamics, capacity)
        self.numbers = field_apart(ti.f64, 7)
        self.home = field_apart(ti.f64, capacity, 3)
        self.member_home = field_apart(ti.f64, capacity, 3)
        across = reach / dynamics.spacing
        self.dims = tuple(max(8, math.ceil(n / across) + 2) for n in dynamics.lattice.modules)
        cells = math.prod(self.dims)
        self.hot = field_apart(ti.i32, cells)
        self.starts = field_apart(ti.i32, cells + 1)
        self.members = field_apart(ti.i32, capacity)
        self.block_sums = field_apart(ti.i32, max(cells, capacity) // BLOCK + 1)

    # -- places ------------------------------------------------------------------------------------

    @ti.func
    def place(self, now, s, k, j, i, spacing):
        """Position of a node, m, in f64."""
        displacement = self.dynamics.node_displacement(now, s, k, j, i)
        return self.rest_position(s, k, j, i, spacing) + ti.cast(displacement, ti.f64)

    @ti.func
    def cell_of(self, place):
        """Cell of a place: whole numbers along x, y, z."""
        cell = ti.Vector([0, 0, 0])
        for axis in ti.static(range(3)):
            along = ti.floor(place[axis] * self.numbers[CELLS_A_METRE])
            # a place that is not finite gets some cell
            cell[axis] = ti.cast(ti.max(-1e9, ti.min(along, 1e9)), ti.i32)
            cell[axis] = cell[axis] % ti.static(self.dims[axis])
        return cell

    @ti.func
    def wrapped(self, along, axis: ti.template()):
        """Number of a cell along an axis, of one that lies at most one beyond the ends."""
        count = ti.static(self.dims[axis])
        if along < 0:
            along += count
        elif along >= count:
            along -= count
        return along

    @ti.func
    def column(self, x, y):
        """Number of the lowest of the cells above each other at x and y."""
        row = self.wrapped(x, 0) * ti.static(self.dims[1]) + self.wrapped(y, 1)
        return row * ti.static(self.dims[2])

    @ti.func
    def beside(self, cell, z, y, x):
        """Number of the cell that lies (z, y, x) cells from another, which are -1 to 1."""
        return self.column(cell[0] + x, cell[1] + y) + self.wrapped(cell[2] + z, 2)

    @ti.func
    def cells_within(self, place, radius):
        """Offsets along x, y, z of the first and last cell within less than a cell of a place."""
        first, last = ti.Vector([0, 0, 0]), ti.Vector([0, 0, 0])
        for axis in ti.static(range(3)):
            along = place[axis] * self.numbers[CELLS_A_METRE]
            inside = (along - ti.floor(along)) * self.numbers[REACH]
            first[axis] = -int(inside < radius)
            last[axis] = int(self.numbers[REACH] - inside < radius)
        return first, last

    @ti.func
    def number_of(self, place):
        """Number of the cell of a place."""
        return self.beside(self.cell_of(place), 0, 0, 0)

    @ti.func
    def heat(self, place):
        """Mark the cells around a place; all threads write the same."""
        cell = self.cell_of(place)
        for z, y, x in ti.ndrange((-1, 2), (-1, 2), (-1, 2)):
            self.hot[self.beside(cell, z, y, x)] = 1

    # -- counts ------------------------------------------------------------------------------------

    @ti.func
    def scan(self, counts: ti.template(), size):
        """Turn counts into their sums up to and including each of them."""
        for block in range((size + BLOCK - 1) // BLOCK):
            total = 0
            for n in range(block * BLOCK, ti.min((block + 1) * BLOCK, size)):
                total += counts[n]
            self.block_sums[block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = 0
            for block in range((size + BLOCK - 1) // BLOCK):
                total += self.block_sums[block]
                self.block_sums[block] = total
        for block in range((size + BLOCK - 1) // BLOCK):
            total = 0
            if block > 0:
                total = self.block_sums[block - 1]
            for n in range(block * BLOCK, ti.min((block + 1) * BLOCK, size)):
                total += counts[n]
                counts[n] = total

    @ti.func
    def sort(self, numbers: ti.template(), begin, end):
        """Sort a few numbers in ascending order, in their place."""
        for n in range(begin + 1, end):
            value, at = numbers[n], n
            while at > begin and numbers[at - 1] > value:
                numbers[at] = numbers[at - 1]
                at -= 1
            numbers[at] = value

    @ti.kernel
    def _sort(self, size: int):
        """Sort the listed nodes into cells."""
        cells = ti.static(self.hot.shape[0])
        for cell in range(cells + 1):
            self.starts[cell] = 0
        for a in range(size):
            ti.atomic_add(self.starts[self.number_of(self.home[a])], 1)
        self.scan(self.starts, cells + 1)
        for a in range(size):
            # from the end of a cell down, which turns the ends into starts
            taken = ti.atomic_add(self.starts[self.number_of(self.home[a])], -1)
            self.members[taken - 1] = a
        for cell in range(cells):
            begin, end = self.starts[cell], self.starts[cell + 1]
            self.sort(self.members, begin, end)
            for n in range(begin, end):
                self.member_home[n] = self.home[self.members[n]]
