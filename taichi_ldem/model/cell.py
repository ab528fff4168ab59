"""Unit cells: the bars that start at a site, and what follows for the nodes that they connect.

A lattice repeats its unit cell at every site ``[k, j, i]`` (see ``lattice``). The tables here are
constants, over which kernels unroll their loops: every neighbour is reached by a constant offset of
its site, and no connectivity is stored. Offsets are in the order of the indices, (dz, dy, dx).

``MODULE`` is the paper's (Section 2, Fig. 1): a cube with nodes at its corners and its centre.

====== ============================================================ ==============================
bar    from, to                                                     exists where
====== ============================================================ ==============================
0-2    corner node to the next one along +x, +y, +z                 one of the 4 modules around does
3-5    centre node to the one before along -x, -y, -z               both modules do
6-13   centre node to corner ``6 + 4 dz + 2 dy + dx`` of its module the module does
====== ============================================================ ==============================

``CUBIC_26`` has nodes at the corners only, each with bars to its 26 neighbours: along the edges,
the diagonals of the faces and those of the cubes. Its third family lets a crack run straight in
more directions (docs/theory.md).

====== ============================================================ ==============================
bar    from, to                                                     exists where
====== ============================================================ ==============================
0-2    node to the next one along +x, +y, +z                        one of the 4 modules around does
3-8    node to that along +x+y, +x-y, +x+z, +x-z, +y+z, +y-z        one of the 2 modules around does
9-12   node to that along +x+y+z, +x+y-z, +x-y+z, +x-y-z            the module does
====== ============================================================ ==============================
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Offset = tuple[int, int, int]
Node = tuple[int, Offset]
"""A node: its sublattice, and the offset of its site."""

CORNER, CENTRE = 0, 1
"""The two sublattices of the paper's module; a lattice without centre nodes has the first only."""

HEXAHEDRON = (
    (0, 0, 0),
    (1, 0, 0),
    (1, 1, 0),
    (0, 1, 0),
    (0, 0, 1),
    (1, 0, 1),
    (1, 1, 1),
    (0, 1, 1),
)
"""The eight corners of a module as (dx, dy, dz), in VTK_HEXAHEDRON's order."""

_CODES = np.arange(256, dtype=np.uint8)
MODULES: npt.NDArray[np.bool_] = np.unpackbits(_CODES[:, None], axis=1, bitorder="little").astype(
    bool
)
"""(256, 8): which of the modules around a corner node exist, for every site byte."""


@dataclass(frozen=True, eq=False)
class UnitCell:
    """The bars of a site.

    Attributes:
        name: of the lattice in a scene.
        ends: [bar] first and second node.
        family: [bar] its family: the row of a table of law parameters.
        shares: (256, bars) share of a whole bar by site byte, where surfaces are weighted.
        node_shares: (256, sublattices) mass of a node over that of a module, by site byte.
        opening: at the tip of a crack, largest opening that counts over the elongation of the bar
            ahead of it (``solver.tips``).
        tip_openings: [family] the same where bars fail at a tip strain.
        numbering: of the bars, in words.
    """

    name: str
    ends: tuple[tuple[Node, Node], ...]
    family: tuple[int, ...]
    shares: Array
    node_shares: Array
    opening: float
    tip_openings: tuple[float, ...]
    numbering: str

    @property
    def bars(self) -> int:
        """Bars of a site."""
        return len(self.ends)

    @property
    def families(self) -> int:
        """Number of bar families."""
        return max(self.family) + 1

    @property
    def sublattices(self) -> int:
        """Nodes of a site."""
        return int(self.node_shares.shape[1])

    @cached_property
    def node_axes(self) -> tuple[tuple[int, int], ...]:
        """The components of a site's nodes: sublattice, axis."""
        return tuple((s, axis) for s in range(self.sublattices) for axis in range(3))

    @cached_property
    def vectors(self) -> Array:
        """(bars, 3): the vector x, y, z from a bar's first to its second node, in module edges."""
        places = [[0.5 * s + np.array(o[::-1], dtype=float) for s, o in both] for both in self.ends]
        return np.array([second - first for first, second in places])

    @cached_property
    def length_squared(self) -> tuple[float, ...]:
        """[bar] square of its length in the regular lattice, in module edges."""
        return tuple(float(v @ v) for v in self.vectors)

    @cached_property
    def starts(self) -> Array:
        """(bars, 3): place x, y, z of a bar's first node from its site's corner, module edges."""
        return np.array([0.5 * s + np.array(o[::-1], dtype=float) for (s, o), _ in self.ends])

    @cached_property
    def in_plane(self) -> tuple[int, ...]:
        """Bars along x and y."""
        return tuple(
            bar for bar, v in enumerate(self.vectors) if np.count_nonzero(v) == 1 and v[2] == 0
        )

    @cached_property
    def of_module(self) -> tuple[tuple[int, Offset], ...]:
        """Bars that lie in a module: their numbers, and offsets of their sites from its own."""
        found = []
        for bar, (start, vector) in enumerate(zip(self.starts, self.vectors, strict=True)):
            for offset in np.ndindex(2, 2, 2):
                both = np.array([start, start + vector]) + offset[::-1]
                if both.min() >= 0 and both.max() <= 1:
                    found.append((bar, (offset[0], offset[1], offset[2])))
        return tuple(found)

    @cached_property
    def lies_in(self) -> tuple[tuple[tuple[Offset, float], ...], ...]:
        """[bar] the modules that a bar lies in: offsets from its site, share of its length in each.

        A bar along an edge or a face lies with all of its length in each of the modules there, of
        which not all may exist.
        """
        found = []
        for start, vector in zip(self.starts, self.vectors, strict=True):
            parts = []
            for offset in np.ndindex(3, 3, 3):
                dz, dy, dx = (o - 1 for o in offset)
                low, high = 0.0, 1.0
                for begin, along, side in zip(start, vector, (dx, dy, dz), strict=True):
                    if along == 0:
                        high = high if side <= begin <= side + 1 else low
                        continue
                    one, other = (side - begin) / along, (side + 1 - begin) / along
                    low, high = max(low, min(one, other)), min(high, max(one, other))
                if high > low:
                    parts.append(((dz, dy, dx), float(high - low)))
            found.append(tuple(parts))
        return tuple(found)

    @cached_property
    def modules_of(self) -> tuple[tuple[Offset, ...], ...]:
        """[bar] offsets from its site of the modules that it lies in."""
        return tuple(tuple(offset for offset, _ in parts) for parts in self.lies_in)

    def weights(self, surface_weights: bool) -> Array:
        """Share of a whole bar carried by each of a site's bars, for every site byte.

        An edge bar is shared by four modules; on a face or an edge of the body only two or one of
        them exist, and consistent homogenisation leaves it 1/2 or 1/4 of its stiffness and fracture
        area. A diagonal of a face is shared by two.

        Args:
            surface_weights: False gives every existing bar its whole section.

        Returns:
            (256, bars) weights, zero where a bar does not exist.
        """
        return self.shares.copy() if surface_weights else (self.shares > 0).astype(float)

    @cached_property
    def stiffness_kind(self) -> tuple[int, ...]:
        """[bar] column of a table of stiffnesses; bars of one family with equal shares have one."""
        columns = [(f, *share) for f, share in zip(self.family, self.shares.T, strict=True)]
        return tuple(columns.index(column) for column in columns)

    @cached_property
    def stiffness_kinds(self) -> int:
        """Number of columns of a table of stiffnesses."""
        return max(self.stiffness_kind) + 1

    # -- bars at a node ----------------------------------------------------------------------------

    def attached(self, sublattice: int) -> list[tuple[int, Offset, int, Offset]]:
        """Bars that meet at a node: towards +x, -x, +y, -y, +z, -z, then diagonals.

        Returns:
            (bar, offset of the site that owns it, sublattice of the other end, offset of its site)
            of each of them; diagonals are in the order of their numbers, and of their ends.
        """
        found: dict[tuple[int, int], tuple[int, Offset, int, Offset]] = {}
        for bar, ends in enumerate(self.ends):
            vector = self.vectors[bar]
            for end, sign in ((0, 1), (1, -1)):
                if ends[end][0] != sublattice:
                    continue
                other, (dz, dy, dx) = ends[1 - end], ends[end][1]
                z, y, x = other[1]
                order = (6 + bar, end)
                if np.count_nonzero(vector) == 1:
                    axis = int(np.argmax(np.abs(vector)))
                    order = (2 * axis + int(sign * vector[axis] < 0), 0)
                found[order] = (bar, (-dz, -dy, -dx), other[0], (z - dz, y - dy, x - dx))
        return [found[order] for order in sorted(found)]

    @cached_property
    def scalars(self) -> tuple[tuple[tuple[int, Offset], ...], ...]:
        """[sublattice] where a node finds its bars' scalars: bar, offset of the owner's site."""
        return tuple(
            tuple((bar, home) for bar, home, _, _ in self.attached(s))
            for s in range(self.sublattices)
        )

    @cached_property
    def neighbours(self) -> tuple[tuple[Node, ...], ...]:
        """[sublattice] the nodes at the other ends, in the order of ``scalars``."""
        return tuple(
            tuple((other, there) for _, _, other, there in self.attached(s))
            for s in range(self.sublattices)
        )

    @cached_property
    def rays(self) -> tuple[Array, ...]:
        """[sublattice] (n, 3) vectors x, y, z to the other ends, in the order of ``scalars``."""
        return tuple(
            np.array([0.5 * (other - s) + np.array(there[::-1]) for other, there in nodes])
            for s, nodes in enumerate(self.neighbours)
        )

    @cached_property
    def levers(self) -> tuple[tuple[tuple[tuple[int, ...], tuple[int, ...]], ...], ...]:
        """[sublattice][axis] places in ``scalars`` of the diagonals that lead up, down the axis."""
        return tuple(
            tuple(
                (
                    tuple(n for n in range(6, len(rays)) if rays[n, axis] > 0),
                    tuple(n for n in range(6, len(rays)) if rays[n, axis] < 0),
                )
                for axis in range(3)
            )
            for rays in self.rays
        )

    @cached_property
    def reach(self) -> float:
        """Component along an axis of a diagonal that has one, in module edges."""
        return float(np.abs(self.rays[0][6:]).max())

    @cached_property
    def fewest_cut(self) -> int:
        """Bars of a node that a flat crack takes from it, least of the planes (100), (110)."""
        return min(self._cut)

    @cached_property
    def most_cut(self) -> int:
        """The same, most of the planes (100), (110)."""
        return max(self._cut)

    @property
    def _cut(self) -> tuple[int, ...]:
        """Bars of a node that a flat crack along (100), (110) takes from it."""
        return tuple(int(np.sum(self.rays[0] @ normal > 0)) for normal in ((1, 0, 0), (1, 1, 0)))


# -- the cells -------------------------------------------------------------------------------------


def _shared(vector: Offset) -> Array:
    """(256,) share of the modules that hold a bar from a corner node along (dz, dy, dx)."""
    modules = [
        bit
        for bit in range(8)
        if all(v == 0 or (bit >> axis & 1) == (v > 0) for axis, v in enumerate(reversed(vector)))
    ]
    return np.asarray(MODULES[:, modules].mean(axis=1))


def _module() -> UnitCell:
    """The paper's cube with a node at its centre."""
    origin, before = (0, 0, 0), (6, 5, 3)
    axes: tuple[Offset, ...] = ((0, 0, 1), (0, 1, 0), (1, 0, 0))
    corners = [(dz, dy, dx) for dz in (0, 1) for dy in (0, 1) for dx in (0, 1)]
    ends = (
        [((CORNER, origin), (CORNER, axis)) for axis in axes]
        + [((CENTRE, origin), (CENTRE, (-z, -y, -x))) for z, y, x in axes]
        + [((CENTRE, origin), (CORNER, corner)) for corner in corners]
    )
    own = MODULES[:, 7]
    shares = (
        [_shared(axis) for axis in axes] + [own & MODULES[:, bit] for bit in before] + [own] * 8
    )
    return UnitCell(
        name="module",
        ends=tuple(ends),
        family=(0,) * 6 + (1,) * 8,
        shares=np.stack(shares, axis=1).astype(float),
        # half a module's mass sits at its centre, the other half is spread over its corners
        node_shares=np.stack([MODULES.sum(axis=1) / 16, own / 2], axis=1),
        # a bar that stands for the stress at L/2 ahead of a tip has the strain K / (E sqrt(pi L));
        # where it fails at G_f, F w / 2 = G_f A gives w = 2 pi (l - L0)
        opening=2 * math.pi,
        # a crack then costs G_f in the mean of all directions, with nodes perturbed by 0.07 L
        # (docs/tension.md)
        tip_openings=(2.0, 4.0),
        numbering="bar of a site: 0-2 corner edges along x, y, z; 3-5 centre-to-centre bars along "
        "x, y, z; 6 + 4 dz + 2 dy + dx diagonal from the centre to corner (dx, dy, dz) of its "
        "module",
    )


def _cubic_26() -> UnitCell:
    """A cube with nodes at its corners and bars to all 26 neighbours."""
    vectors: list[Offset] = [(0, 0, 1), (0, 1, 0), (1, 0, 0)]
    vectors += [(0, 1, 1), (0, -1, 1), (1, 0, 1), (-1, 0, 1), (1, 1, 0), (-1, 1, 0)]
    vectors += [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1)]
    return UnitCell(
        name="cubic-26",
        ends=tuple(((CORNER, (0, 0, 0)), (CORNER, vector)) for vector in vectors),
        family=(0,) * 3 + (1,) * 6 + (2,) * 4,
        shares=np.stack([_shared(vector) for vector in vectors], axis=1),
        node_shares=MODULES.sum(axis=1, keepdims=True) / 8,
        # a crack in this lattice then costs G_f in the mean of all directions (docs/tension.md)
        opening=2.0,
        # the same with tip strains, with nodes perturbed by 0.07 L
        tip_openings=(2.5, 1.9, 1.7),
        numbering="bar of a site: 0-2 edges along x, y, z; 3-8 face diagonals along +x+y, +x-y, "
        "+x+z, +x-z, +y+z, +y-z; 9-12 cube diagonals along +x+y+z, +x+y-z, +x-y+z, +x-y-z",
    )


MODULE = _module()
CUBIC_26 = _cubic_26()
CELLS: dict[str, UnitCell] = {cell.name: cell for cell in (MODULE, CUBIC_26)}
"""Unit cells by the name that a scene gives them."""
