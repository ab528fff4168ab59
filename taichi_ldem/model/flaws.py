"""Flat flaws: rectangles, parallelograms and discs, whose bars a notch removes.

A bar is cut where the line between its two nodes at rest crosses the flaw. A plane through nodes is
taken to lie just beyond them (``beyond``), and the edge of a flaw belongs to it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from taichi_ldem.scene import Notch

Floats = npt.NDArray[np.float64]

NUDGE = 1e-6
"""How far beyond nodes a plane through them lies, and how far its edges reach, in module edges."""


@dataclass(frozen=True)
class Flaw:
    """A part of a plane.

    Attributes:
        normal: (3,) of length 1; its largest component is positive.
        position: of the plane along the normal, m.
        corners: (n, 3) places whose box holds the flaw, m.
        holds: whether places (..., 3) of the plane lie in the flaw, given how far its edges reach
            outwards, m.
    """

    normal: Floats
    position: float
    corners: Floats
    holds: Callable[[Floats, float], npt.NDArray[np.bool_]]

    def plane(self, middle: Sequence[float], spacing: float) -> float:
        """Position of the plane, moved off nodes that it goes through, m.

        Args:
            middle: of the plate, m.
        """
        return beyond(self.position, float(np.dot(self.normal, middle)), spacing)


def rectangle(axis: int, position: float, lower: Sequence[float], upper: Sequence[float]) -> Flaw:
    """A rectangle normal to an axis; its corners lie along the other axes, in rising order."""
    others = [a for a in range(3) if a != axis]
    ends = np.array([lower, upper], dtype=float)
    corners = np.full((4, 3), float(position))
    corners[:, others] = [(a, b) for a in ends[:, 0] for b in ends[:, 1]]

    def holds(places: Floats, slack: float) -> npt.NDArray[np.bool_]:
        inside = np.ones(places.shape[:-1], dtype=bool)
        for other, low, high in zip(others, lower, upper, strict=True):
            inside &= (places[..., other] >= low - slack) & (places[..., other] <= high + slack)
        return inside

    return Flaw(np.eye(3)[axis], position, corners, holds)


def parallelogram(points: Sequence[Sequence[float]]) -> Flaw:
    """The parallelogram with corners p0, p1, p2 and p1 + p2 - p0."""
    origin, first, second = np.array(points, dtype=float)
    sides = np.stack([first - origin, second - origin])
    normal = _upwards(np.cross(*sides))
    # of length 1 in the plane, across the other side
    across = np.stack([np.cross(sides[1], normal), np.cross(normal, sides[0])])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    heights = np.abs((sides * across).sum(axis=1))
    across *= np.sign((sides * across).sum(axis=1))[:, None]

    def holds(places: Floats, slack: float) -> npt.NDArray[np.bool_]:
        along = (places - origin) @ across.T
        return np.asarray(((along >= -slack) & (along <= heights + slack)).all(axis=-1))

    corners = np.stack([origin, first, second, first + second - origin])
    return Flaw(normal, float(normal @ origin), corners, holds)


def penny(centre: Sequence[float], diameter: float, direction: Sequence[float]) -> Flaw:
    """A disc of a diameter around a place, normal to a direction."""
    middle, normal = np.array(centre, dtype=float), _upwards(np.array(direction, dtype=float))
    reach = 0.5 * diameter * np.sqrt(np.maximum(0.0, 1 - normal**2))

    def holds(places: Floats, slack: float) -> npt.NDArray[np.bool_]:
        return np.asarray(np.linalg.norm(places - middle, axis=-1) <= 0.5 * diameter + slack)

    return Flaw(normal, float(normal @ middle), np.stack([middle - reach, middle + reach]), holds)


def flaw_of(notch: "Notch") -> Flaw:
    """The flaw that a scene's notch describes."""
    if notch.points is not None:
        return parallelogram(notch.points)
    if notch.centre is not None:
        assert notch.diameter is not None
        assert notch.direction is not None
        return penny(notch.centre, notch.diameter, notch.direction)
    (a, b), (c, d) = notch.bounds
    return rectangle(notch.axes[0], notch.place, (a, c), (b, d))


def rim(notch: "Notch") -> Floats:
    """(n, 3) places on the edge of a notch, all around, m."""
    if notch.points is not None:
        origin, first, second = np.array(notch.points, dtype=float)
        return np.stack([origin, first, first + second - origin, second])
    if notch.centre is None:
        return flaw_of(notch).corners[[0, 1, 3, 2]]
    assert notch.diameter is not None
    assert notch.direction is not None
    normal = np.array(notch.direction, dtype=float)
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    second = np.cross(normal, first)
    angle = np.linspace(0.0, 2 * math.pi, 73)[:-1, None]
    ways = [way / np.linalg.norm(way) for way in (first, second)]
    around = np.cos(angle) * ways[0] + np.sin(angle) * ways[1]
    return np.asarray(notch.centre + 0.5 * notch.diameter * around)


def beyond(position: float, middle: float, spacing: float) -> float:
    """The place of a plane that does not go through nodes, m: a little further from the middle.

    So planes that are mirror images of each other stay that. One in the middle itself has to lie on
    one side of the nodes there, and lies above them.
    """
    side = -1.0 if position < middle - NUDGE * spacing else 1.0
    return position + side * NUDGE * spacing


def turned(places: npt.NDArray[Any], angle: float) -> Floats:
    """Coordinates (..., 3) along axes that are turned about z by an angle (radians) to those given.

    A specimen's coordinates come from the lattice's, and the other way round with minus the angle.
    """
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.asarray(places @ [[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _upwards(vector: Floats) -> Floats:
    """A vector of length 1 along one, or against it, whose largest component is positive."""
    unit = vector / np.linalg.norm(vector)
    largest = int(np.argmax(np.round(np.abs(unit), 9)))
    return np.asarray(unit * np.sign(unit[largest]) + 0.0)
