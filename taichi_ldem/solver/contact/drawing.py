"""How a rigid body is drawn: faces of a solid, and circles on the plate's faces."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]


def no_faces() -> Floats:
    """The faces of a body that is not solid: (0, 4, 3)."""
    return np.empty((0, 4, 3))


@dataclass(frozen=True)
class Drawing:
    """A body as it is drawn at a time.

    Attributes:
        caption: the words on the picture that explain it.
        faces: (F, 4, 3) of a solid, counter-clockwise from outside, m.
        radii: of circles around the plate's axis on both of its faces, m.
        thickness: of the plate, m.
        label: a mark on the solid that tells it from others of its kind; empty: none.
        below: whether the solid lies under the plate, which hides it from above.
    """

    caption: str
    faces: Floats = field(default_factory=no_faces)
    radii: tuple[float, ...] = ()
    thickness: float = 0.0
    label: str = ""
    below: bool = False


TURN = 64
"""Faces that are drawn around an axis."""


def turned(out: Floats, up: Floats, around: int = TURN) -> Floats:
    """(F, 4, 3) of a profile that is turned around the z axis, m.

    Args:
        out, up: (n,) distances from the axis and heights, from the bottom up along the outside.
        around: faces around the axis.
    """
    turn = np.linspace(0.0, 2 * np.pi, around + 1)
    return between([np.stack([out * np.cos(a), out * np.sin(a), up], axis=1) for a in -turn])


def between(rows: Sequence[Floats]) -> Floats:
    """(F, 4, 3) of the faces between rows of points, (n, 3) each, m."""
    grid = np.array(rows)
    faces = [grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]]
    return np.asarray(np.stack(faces, axis=2).reshape(-1, 4, 3))
