"""Circles through points of cracks: the fit, its points' directions and the turn they cover."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SECTORS = 36
"""Sectors of the turn in which points are looked for."""


@dataclass(frozen=True)
class Circle:
    """A circle fitted to points.

    Attributes:
        x, y: its centre, m.
        diameter: m.
        scatter: root mean square of the points' distances from the circle, m.
    """

    x: float
    y: float
    diameter: float
    scatter: float


def directions(points: Array, reach: float) -> Array:
    """(n, 2) unit vectors along the skeleton: main axis of the points within a reach, m."""
    from scipy.spatial import KDTree

    tree = KDTree(points)
    result = np.empty_like(points)
    for number, near in enumerate(tree.query_ball_point(points, reach)):
        local = points[near] - points[near].mean(axis=0)
        result[number] = np.linalg.eigh(local.T @ local)[1][:, 1]
    return result


def fit_circle(points: Array, guess: Array, scale: float) -> Circle | None:
    """Circle with a free centre and the least distances from points; None for fewer than three.

    Args:
        points: (n, 2) m. guess: (2,) m. scale: distance beyond which a point loses weight, m.
    """
    from scipy.optimize import least_squares

    if len(points) < 3:
        return None

    def off(p: Array) -> Array:
        distance: Array = np.linalg.norm(points - p[:2], axis=1) - p[2]
        return distance

    start = np.append(guess, np.median(np.linalg.norm(points - guess, axis=1)))
    fit = least_squares(off, start, loss="soft_l1", f_scale=scale, x_scale=start[2])
    x, y, radius = fit.x
    scatter = math.sqrt(float(np.mean(off(fit.x) ** 2)))
    return Circle(float(x), float(y), float(2 * radius), scatter)


def turn_covered(ray: Array) -> float:
    """Share of 36 sectors of ten degrees that hold a point, rays (n, 2) from the centre."""
    turn = np.arctan2(ray[:, 1], ray[:, 0]) / (2 * np.pi) % 1.0
    return len(np.unique((turn * SECTORS).astype(int) % SECTORS)) / SECTORS
