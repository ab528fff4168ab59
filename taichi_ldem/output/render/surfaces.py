"""The surface of the plate that is drawn: the bare faces of its modules, by NumPy alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.model.flaws import flaw_of, turned
from taichi_ldem.scene import Notch
from taichi_ldem.storage.fields import Fields

FloatArray = NDArray[np.floating[Any]]

FAILED_SHARE = 0.4
"""Share of failed bars from which on a module is not drawn.

A plane between two layers of nodes cuts four edges and four diagonals of a module, 8 of its 20
bars: that module is cut in two.
"""

# A corner whose bars have all failed may fly off on its own. A module one of whose corners is
# further than this multiple of half a diagonal from the middle would be a spike in the picture.
_TORN = 1.5

# Local corners of a module's faces, counter-clockwise from outside, by outward direction (x, y, z).
_FACES = (
    ((-1, 0, 0), (0, 4, 7, 3)),
    ((1, 0, 0), (1, 2, 6, 5)),
    ((0, -1, 0), (0, 1, 5, 4)),
    ((0, 1, 0), (3, 7, 6, 2)),
    ((0, 0, -1), (0, 3, 2, 1)),
    ((0, 0, 1), (4, 5, 6, 7)),
)


@dataclass(frozen=True)
class Surface:
    """Exterior quadrilaterals of the modules that are drawn.

    Attributes:
        corners: (F, 4, 3) in the deformed configuration, counter-clockwise from outside, m.
        normals: (F, 3), outward unit vectors.
        value: (F,) of each face's module, by which it is coloured.
        opened: (F,) whether a crack has opened the face.
    """

    corners: FloatArray
    normals: FloatArray
    value: FloatArray
    opened: NDArray[np.bool_]


def holding(fields: Fields) -> NDArray[np.bool_]:
    """Mask (C,) of the modules that are neither cut in two nor torn."""
    corners = (fields.points + fields.displacement)[fields.hexahedra]
    spread = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    first = fields.points[fields.hexahedra[0]]
    half_diagonal = np.linalg.norm(first[6] - first[0]) / 2
    # a comparison with NaN is false: such modules are not drawn either
    return (fields.broken_fraction < FAILED_SHARE) & (spread < _TORN * half_diagonal)


def notched(fields: Fields, notches: Sequence[Notch], angle: float = 0.0) -> NDArray[np.bool_]:
    """Mask (C,) of the modules that an open notch cuts. They are left out, so that it shows.

    Args:
        angle: of the specimen's axes, along which notches lie, to the lattice's, radians.
    """
    low = fields.points[fields.hexahedra[:, 0]]
    edge = float(np.linalg.norm(fields.points[fields.hexahedra[0, 1]] - low[0]))
    middle = turned(low + edge / 2, angle) if angle else low + edge / 2
    half_way = (0.0, 0.0, 0.5 * float(fields.points[:, 2].max()))  # through the plate
    found = np.zeros(len(low), dtype=bool)
    for notch in notches:
        if notch.opens_at > fields.time:
            continue
        flaw = flaw_of(notch)
        off = flaw.plane(half_way, edge) - middle @ flaw.normal
        # a module reaches so far to either side of its middle along the normal
        reach = 0.5 * edge * np.abs(turned(flaw.normal, -angle)).sum()
        places = middle + off[:, None] * flaw.normal
        found |= (np.abs(off) < reach) & flaw.holds(places, -1e-9 * edge)
    return found


def exterior(fields: Fields, part: NDArray[np.bool_], values: FloatArray | None = None) -> Surface:
    """Bare faces of the modules of a part of the plate, without those that are cut or torn.

    Args:
        part: (C,) mask of the part.
        values: (C,) to colour by; None: the share of failed bars.
    """
    base = fields.points[fields.hexahedra[:, 0]]
    # the offsets of perturbed nodes cancel within a row of modules, since its ends have none
    edge = (fields.points[fields.hexahedra[:, 1]] - base)[:, 0].mean()
    # one empty layer all around, so that modules at the rim are no special case
    site = np.rint((base - base.min(axis=0)) / edge).astype(np.int64) + 1
    drawn = part & holding(fields)
    taken, filled = np.zeros((2, *(site.max(axis=0) + 2)), dtype=bool)
    taken[tuple(site[part].T)] = True
    filled[tuple(site[drawn].T)] = True

    position = fields.points + fields.displacement
    quads, modules, opened = [], [], []
    for direction, local in _FACES:
        neighbour = tuple((site + direction).T)
        bare = np.flatnonzero(drawn & ~filled[neighbour])
        quads.append(position[fields.hexahedra[bare][:, local]])
        modules.append(bare)
        opened.append(taken[neighbour][bare])
    corners, module = np.concatenate(quads), np.concatenate(modules)
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    shown = fields.broken_fraction if values is None else values
    return Surface(corners, normals, shown[module], np.concatenate(opened))
