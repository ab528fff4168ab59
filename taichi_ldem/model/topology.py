"""Topology of the lattice: which nodes a bar connects and which bars meet at a node.

The tables are constants of the unit cell (``lattice`` numbers the bars). Kernels unroll loops over
them, so every neighbour is reached by a constant offset of its site and no connectivity is stored.
Offsets are given in the order of the indices, (dz, dy, dx).
"""

import numpy as np

from taichi_ldem.model.lattice import BAR_VECTORS, BARS_PER_SITE, DIAGONAL

CORNER, CENTRE = 0, 1
"""The two sublattices of nodes."""

NODE_AXES = tuple((s, axis) for s in (CORNER, CENTRE) for axis in range(3))
"""The six components of a site's two nodes: sublattice, axis."""

_X, _Y, _Z = (0, 0, 1), (0, 1, 0), (1, 0, 0)

ENDS = (
    [((CORNER, (0, 0, 0)), (CORNER, axis)) for axis in (_X, _Y, _Z)]
    + [((CENTRE, (0, 0, 0)), (CENTRE, (-a[0], -a[1], -a[2]))) for a in (_X, _Y, _Z)]
    + [
        ((CENTRE, (0, 0, 0)), (CORNER, (dz, dy, dx)))
        for dz in (0, 1)
        for dy in (0, 1)
        for dx in (0, 1)
    ]
)
"""[bar] first and second node: sublattice, offset of its site from the site that owns the bar."""

FAMILY = tuple(int(bar >= DIAGONAL.start) for bar in range(BARS_PER_SITE))
"""[bar] 0 for longitudinal bars, 1 for diagonal ones: the row of a table of law parameters."""

STIFFNESS_KIND = tuple(min(bar, DIAGONAL.start) for bar in range(BARS_PER_SITE))
"""[bar] column of the table of stiffnesses: diagonal bars of a site all have the same."""

LENGTH_SQUARED = tuple((1.0, 0.75)[family] for family in FAMILY)
"""[bar] square of its length in the regular lattice, in module edges."""

INVERSE_LENGTH_SQUARED = tuple((1.0, 4.0 / 3.0)[family] for family in FAMILY)
"""[bar] the reciprocal of LENGTH_SQUARED."""


def attached_bars(sublattice: int) -> list[tuple[int, tuple[int, ...], int, tuple[int, ...]]]:
    """Bars that meet at a node of a sublattice: towards +x, -x, +y, -y, +z, -z, then diagonals.

    Returns:
        (bar, offset of the site that owns it, sublattice of the other end, offset of its site) of
        each of the fourteen bars; diagonals are in the order of their numbers.
    """
    bars = {}
    for bar, ends in enumerate(ENDS):
        for end, sign in ((0, 1), (1, -1)):
            if ends[end][0] != sublattice:
                continue
            other, here = ends[1 - end], ends[end][1]
            home = tuple(-n for n in here)
            there = tuple(o - n for o, n in zip(other[1], here, strict=True))
            axis = int(np.argmax(np.abs(BAR_VECTORS[bar])))
            order = 6 + bar
            if bar < DIAGONAL.start:
                order = 2 * axis + int(sign * BAR_VECTORS[bar][axis] < 0)
            bars[order] = (bar, home, other[0], there)
    return [bars[order] for order in sorted(bars)]


SCALARS = tuple(
    tuple((bar, home) for bar, home, _, _ in attached_bars(s)) for s in (CORNER, CENTRE)
)
"""[sublattice] where a node finds the scalars of its bars: bar, offset of the site that owns it."""

NEIGHBOURS = tuple(
    tuple((other, there) for _, _, other, there in attached_bars(s)) for s in (CORNER, CENTRE)
)
"""[sublattice] the nodes at the other ends, in the same order: sublattice, offset of the site."""

LEVERS = tuple(
    tuple(tuple(6 + d for d in range(8) if (d >> axis & 1) == side) for side in (1, 0))
    for axis in range(3)
)
"""[axis] places in SCALARS of the diagonals that lead from a centre node up and down the axis."""
