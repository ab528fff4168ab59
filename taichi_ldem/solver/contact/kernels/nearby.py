"""The list of the nodes near a rigid body; a step visits no others.

They are listed anew every few steps, in ascending order, from positions and speeds, on the device,
without waiting for the host.
"""

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.errors import TooManyNodes
from taichi_ldem.solver.dynamics import Dynamics, field_apart
from taichi_ldem.solver.lanes import HALO

WORD = 16
"""Columns of a row whose nodes one number marks as near or not."""

BATCH = 8
"""Numbers that one thread of a GPU reads at once."""

vec3d = ti.types.vector(3, ti.f64)


@ti.data_oriented
class NearbyNodes:
    """The nodes near a body.

    Attributes:
        nodes: node numbers, ascending, flat over (sublattices, *S).
        before: velocity of each listed node at the end of the last step, m/s.
        count: (2,) number of listed nodes, and the largest number that has been near so far.
        marks: a bit for each column of a piece of a row (s, k, j, lane): its node is near.
        ends: for each row (s, k, j) the number after its last node in the list.
    """

    listed_anew = True
    """Whether the list is made anew while the plate moves."""

    def __init__(self, dynamics: Dynamics, capacity: int):
        """``capacity`` is the largest number of nodes in the list."""
        self.dynamics, self.capacity = dynamics, capacity
        self.nodes = field_apart(ti.i32, capacity)
        self.before = ti.Vector.field(3, float, shape=capacity)
        self.count = field_apart(ti.i32, 2)
        self.batch = 1 if dynamics.on_cpu else BATCH
        if self.listed_anew:
            nz, ny, _ = dynamics.sites
            self.words = -(-dynamics.lanes.length // WORD)
            rows = dynamics.cell.sublattices * nz * ny
            self.marks = field_apart(ti.i32, rows * dynamics.lanes.width * self.words)
            self.ends = field_apart(ti.i32, rows)

    # -- on the host
    # -------------------------------------------------------------------------------------

    def set_nodes(self, nodes: npt.NDArray[np.int32]) -> None:
        """Replace the list and record the nodes' velocities."""
        padded = np.zeros(self.capacity, dtype=np.int32)
        padded[: len(nodes)] = np.sort(nodes)
        self.nodes.from_numpy(padded)
        self.count[0] = len(nodes)
        self.record_velocities()

    def _node_numbers(self) -> int:
        return self.dynamics.cell.sublattices * int(np.prod(self.dynamics.sites))

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

    # -- a node
    # -------------------------------------------------------------------------------------

    @ti.func
    def site_of(self, number):
        """Sublattice and site of a listed node."""
        node = self.nodes[number]
        nz, ny, nx = ti.static(self.dynamics.sites)
        return node // (nz * ny * nx), node // (ny * nx) % nz, node // nx % ny, node % nx

    @ti.func
    def rest_position(self, s, k, j, i, spacing):
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

    @ti.kernel
    def record_velocities(self):
        """Record the velocities of the listed nodes as those at the end of the last step."""
        self.record()

    @ti.func
    def record(self):
        """``record_velocities`` within a kernel."""
        for number in range(self.count[0]):
            s, k, j, i = self.site_of(number)
            self.before[number] = self.dynamics.node_velocity(s, k, j, i)

    # -- listing
    # -------------------------------------------------------------------------------------

    def list_nodes(self, now: int, duration: float) -> None:
        """List the nodes that may touch the body within a ``duration`` (s) from now.

        A node's margin is 0.45 of a module plus twice the distance that it and the body cover in
        that time (bounded by the sum of its velocity's components): a node may be accelerated
        meanwhile, at most to about the wave speed times eps_p, the speed of a node when
        a bar breaks. Where more nodes are near than the list holds, ``count`` records it: see
        ``refuse_more``.
        """
        self._list(now, self.dynamics.lattice.spacing, duration)

    @ti.kernel
    def _list(self, now: int, spacing: float, duration: float):
        nz, ny = ti.static(self.dynamics.sites[:2])
        for k, j, word in ti.ndrange((1, nz - 1), (1, ny - 1), self.words):
            self.mark(now, k, j, word, spacing, duration)
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
        self.forget_unlisted()

    @ti.func
    def near(self, position, margin):
        """Whether a point (m, f64) is within a margin of the body; each body's own."""
        return False

    @ti.func
    def speed(self):
        """Speed at which the body itself moves, m/s."""
        return ti.cast(0.0, float)

    @ti.func
    def forget_unlisted(self):
        """Clear values of nodes that are no longer listed; each body's own."""

    @ti.func
    def row_words(self):
        """Words of marks of a row."""
        return ti.static(self.dynamics.lanes.width * self.words)

    @ti.func
    def mark(self, now, k, j, word, spacing, duration):
        """Mark the nodes of a piece of a row, in every lane, that are near."""
        nz, ny, _ = ti.static(self.dynamics.sites)
        begin, body_speed = HALO + word * WORD, self.speed()
        for lane in range(self.dynamics.lanes.width):
            near = ti.Vector.zero(ti.i32, self.dynamics.cell.sublattices)
            for m in range(begin, ti.min(begin + WORD, HALO + self.dynamics.lanes.length)):
                i = self.dynamics.site_of(m, lane)
                for s in ti.static(range(self.dynamics.cell.sublattices)):
                    displacement = ti.Vector.zero(ti.f64, 3)
                    speed = body_speed
                    for axis in ti.static(range(3)):
                        displacement[axis] = self.dynamics.displacement[s][axis][now, k, j, m][lane]
                        speed += ti.abs(self.dynamics.velocity[s][axis][k, j, m][lane])
                    margin = 0.45 * spacing + 2 * duration * speed
                    mass = self.dynamics.mass[int(self.dynamics.code[k, j, m][lane])]
                    position = self.rest_position(s, k, j, i, spacing) + displacement
                    if mass[s] > 0 and self.near(position, margin):
                        near[s] |= 1 << (m - begin)
            for s in ti.static(range(self.dynamics.cell.sublattices)):
                row = (s * nz + k) * ny + j
                self.marks[row * self.row_words() + lane * self.words + word] = near[s]

    @ti.func
    def number_rows(self):
        """Turn every row's count into the number after its last node."""
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
