"""Deformation and strain of modules, from the displacement of their corners."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.model.cell import HEXAHEDRON

Array = NDArray[np.float64]
Real = NDArray[np.floating[Any]]


def mean_gradient(points: Real, hexahedra: NDArray[np.integer[Any]], displacement: Real) -> Array:
    """(C, 3, 3) mean gradient H of the displacement in each module: row i, direction j.

    Args:
        points: (P, 3) corners at rest, m. hexahedra: (C, 8) their numbers. displacement: (P, 3), m.
    """
    place = _opposite_sides(points, hexahedra)
    return np.asarray(_opposite_sides(displacement, hexahedra) @ np.linalg.inv(place))


def _opposite_sides(values: Real, hexahedra: NDArray[np.integer[Any]]) -> Array:
    """(C, 3, 3) sums over the corners on one side less those on the other, along x, y and z."""
    total = np.zeros((len(hexahedra), 3, 3))
    for corner, place in enumerate(HEXAHEDRON):
        own = values[hexahedra[:, corner]].astype(np.float64)
        for axis in range(3):
            if place[axis]:
                total[:, :, axis] += own
            else:
                total[:, :, axis] -= own
    return total


def module_volumes(points: Real, hexahedra: NDArray[np.integer[Any]]) -> Array:
    """(C,) volume of each module, m3: the determinant of the mean gradient of its corners."""
    return np.asarray(np.linalg.det(_opposite_sides(points, hexahedra) / 4))


def green_strain(gradient: Array) -> Array:
    """(C, 3, 3) Green-Lagrange strain 1/2 (F^T F - 1) of F = 1 + H: zero in any rigid rotation."""
    both = gradient + np.swapaxes(gradient, 1, 2)
    return np.asarray((both + np.einsum("cki,ckj->cij", gradient, gradient)) / 2)


def swelling(gradient: Array) -> Array:
    """(C,) J - 1, the change of volume over the volume at rest, without cancellation."""
    trace = np.trace(gradient, axis1=1, axis2=2)
    minors = (trace**2 - np.einsum("cij,cji->c", gradient, gradient)) / 2
    return np.asarray(trace + minors + np.linalg.det(gradient))
