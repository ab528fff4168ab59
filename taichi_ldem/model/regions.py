"""Regions of a lattice: nodes on a side of it, in a box or between circles, and their surface.

Nodes count at their places in the regular lattice, whatever their perturbation.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from taichi_ldem.model.lattice import Lattice

SLACK = 1e-6
"""Rounding of places, in modules."""

Chosen = npt.NDArray[np.bool_]
"""(sublattices, *S) True for the nodes of a region, or (nz, ny, nx) True for its modules."""


class Places(Protocol):
    """Nodes of a lattice, which is itself an example, or its modules."""

    @property
    def spacing(self) -> float:
        """Edge of a module, m."""

    def exists(self) -> Chosen:
        """True where there is one."""

    def grid(self) -> npt.NDArray[np.float64]:
        """Their places in the regular lattice, m, with one more axis."""


@dataclass(frozen=True)
class Modules:
    """The modules of a lattice, at their centres."""

    lattice: Lattice

    @property
    def spacing(self) -> float:
        """Edge of a module, m."""
        return self.lattice.spacing

    def exists(self) -> Chosen:
        """(nz, ny, nx) True where there is one."""
        return self.lattice.mask

    def grid(self) -> npt.NDArray[np.float64]:
        """(nz, ny, nx, 3) places of their centres, m."""
        corners = self.lattice.grid()[0, 1:-2, 1:-2, 1:-2]
        return np.asarray(corners + 0.5 * self.spacing)


def side_of(face: str) -> tuple[int, int]:
    """The axis (0 = x) and the sign of a side, such as "-x"."""
    return "xyz".index(face[1]), -1 if face[0] == "-" else 1


def on_face(lattice: Lattice, face: str) -> Chosen:
    """The outermost nodes on a side, such as "-x": those less than half a module inside."""
    axis, sign = side_of(face)
    exists, along = lattice.exists(), sign * lattice.grid()[..., axis]
    return np.asarray(exists & (along > along[exists].max() - (0.5 - SLACK) * lattice.spacing))


def in_box(places: Places, corners: Sequence[Sequence[float]]) -> Chosen:
    """All nodes or modules in the box between two opposite corners (m)."""
    ends, slack = np.sort(np.array(corners), axis=0), SLACK * places.spacing
    place = places.grid()
    inside = (place >= ends[0] - slack) & (place <= ends[1] + slack)
    return np.asarray(places.exists() & inside.all(axis=-1))


def between_circles(
    lattice: Lattice, face: str, centre: Sequence[float] | None, inner: float, outer: float
) -> Chosen:
    """All nodes between two circles around an axis normal to a side, by their radii (m).

    Args:
        centre: the other two coordinates of the axis in the order x, y, z, m; None: the middle.
    """
    axis, _ = side_of(face)
    others = [other for other in range(3) if other != axis]
    middle = (0.0, 0.0, 0.5 * lattice.modules[2] * lattice.spacing)
    at = [middle[other] for other in others] if centre is None else centre
    radius = np.hypot(*np.moveaxis(lattice.grid()[..., others] - np.array(at), -1, 0))
    slack = SLACK * lattice.spacing
    return np.asarray((radius >= inner - slack) & (radius <= outer + slack))


def near_plane(places: Places, axis: str, position: float) -> Chosen:
    """All nodes or modules within half a module of a plane normal to an axis (m)."""
    away = np.abs(places.grid()[..., "xyz".index(axis)] - position)
    return np.asarray(places.exists() & (away <= (0.5 + SLACK) * places.spacing))


def nearest(places: Places, point: Sequence[float]) -> Chosen:
    """The node or module that is nearest to a point (m), or all that are equally near."""
    exists = places.exists()
    away = np.linalg.norm(places.grid() - np.array(point), axis=-1)
    return np.asarray(exists & (away <= away[exists].min() + SLACK * places.spacing))


def areas(lattice: Lattice, region: Chosen, face: str | None) -> npt.NDArray[np.float64]:
    """(sublattices, *S) area of the surface that belongs to each node of a region, m2.

    Each corner of a module's outer face has a quarter of it. Centre nodes have none.

    Args:
        face: the side whose faces count, with all nodes of the region; None: every face whose four
            corners are in the region.
    """
    area = np.zeros(lattice.exists().shape)
    quarter = 0.25 * lattice.spacing**2
    for corners in _outer_faces(lattice, face):
        if face is None:
            inside = np.all([region[0][corner] for corner in corners], axis=0)
            corners = [tuple(index[inside] for index in corner) for corner in corners]
        for corner in corners:
            np.add.at(area[0], corner, quarter)
    return np.asarray(area * region)


def _outer_faces(
    lattice: Lattice, face: str | None
) -> Iterator[list[tuple[npt.NDArray[np.int64], ...]]]:
    """For each side, the sites (z, y, x) of the four corners of all outer faces of modules."""
    padded = np.pad(lattice.mask, 1)
    sides = [face] if face is not None else [f"{s}{a}" for a in "xyz" for s in "-+"]
    for side in sides:
        axis, sign = side_of(side)
        along = 2 - axis  # of an array whose axes are z, y, x
        outside = ~np.roll(padded, -sign, axis=along)
        sites = list(np.nonzero(padded & outside))  # padded by one layer, as the sites are
        sites[along] = sites[along] + (sign > 0)
        first, second = (other for other in range(3) if other != along)
        corners = []
        for a in (0, 1):
            for b in (0, 1):
                corner = list(sites)
                corner[first], corner[second] = sites[first] + a, sites[second] + b
                corners.append(tuple(corner))
        yield corners
