"""Declaration of a nose: its surface for the kernels, and its profile for drawing."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Nose:
    """A nose and the shaft above it, which has the nose's width.

    A nose may need a number beside the radius, for which the scene has a key of its own (see
    ``NOSE_KEYS`` in ``scene.strikers``). Its functions then take that number last.

    Places are measured from the point of the axis that lies one radius above the tip, in m; z
    points up, away from the plate.

    Attributes:
        surface: ``surface(place, radius)`` returns the signed distance of a place to the surface
            (negative inside) and the outward normal there. Taichi compiles it: ``place`` is a
            vector in f64 with ``x``, ``y``, ``z`` and ``norm()``. Far outside, the distance may be
            too small but not too large: nodes beyond it are not visited.
        profile: ``profile(radius)`` returns (n,) half widths and (n,) heights above the tip from
            the tip to the lower end of the shaft, for drawing.
        along_y: whether the profile runs along y, rather than around the axis.
        number: ``number(value, radius)`` turns the value of the scene's key into the number that
            ``surface`` and ``profile`` take; None for a nose that needs none.
    """

    surface: Callable[..., Any]
    profile: Callable[..., tuple[Floats, Floats]]
    along_y: bool = False
    number: Callable[[float, float], float] | None = None

    def numbers(self, value: float | None, radius: float) -> tuple[float, ...]:
        """The nose's number as a tuple, empty for a nose that needs none.

        Args:
            value: of the scene's key.
        """
        if self.number is None:
            return ()
        assert value is not None  # the scene refuses a striker without it
        return (self.number(value, radius),)


def quarter_circle(radius: float) -> tuple[Floats, Floats]:
    """The profile of a nose that is round from the tip to the shaft."""
    angle = np.linspace(0.0, np.pi / 2, 17)
    return radius * np.sin(angle), radius * (1.0 - np.cos(angle))
