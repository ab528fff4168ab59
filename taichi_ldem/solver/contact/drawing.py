"""How a rigid body is drawn: faces of a solid, and circles on the plate's faces."""

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
    """

    caption: str
    faces: Floats = field(default_factory=no_faces)
    radii: tuple[float, ...] = ()
    thickness: float = 0.0
