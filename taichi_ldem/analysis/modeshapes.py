"""Names of a plate's modes from their shapes, and the frequencies of thin-plate theory.

A mode of a plate that is held along a circle is (m, n): m nodal diameters, n nodal circles inside
the clamped one. Its shape is taken on the mid-plane.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

RADII, ANGLES = 60, 128
"""Points of the polar grid on which shapes are analysed."""

SIGNIFICANT = 0.05
"""Share of the largest amplitude below which a sign of the radial profile counts for nothing."""

SAME = 1e-4
"""Relative difference of frequencies up to which modes of one name are a degenerate pair.

The lattice has the symmetry of a square: pairs of odd m are exactly degenerate, of even m not.
"""


@dataclass(frozen=True)
class Name:
    """The kind of a mode, and its nodal lines.

    Attributes:
        kind: "plate" (bending inside the circle), "in-plane" (mostly motion in the plane),
            "outside" (mostly motion outside the circle), "rigid", or "other" (there is no circle).
        diameters, circles: of a plate mode.
    """

    kind: str
    diameters: int | None = None
    circles: int | None = None

    def __str__(self) -> str:
        if self.kind == "plate":
            return f"({self.diameters}, {self.circles})"
        return self.kind


def nodal_lines(x: Array, y: Array, deflection: Array, radius: float) -> tuple[int, int]:
    """Nodal diameters and circles of a deflection inside a circle around the origin.

    The angular order with the largest integral of its squared amplitude names the diameters, sign
    changes of its radial profile the circles.

    Args:
        x: (nx,), y: (ny,) grid lines, m. deflection: (ny, nx). radius: m.
    """
    from scipy.interpolate import RegularGridInterpolator

    r = radius * (np.arange(RADII) + 0.5) / RADII
    angle = 2 * math.pi * np.arange(ANGLES) / ANGLES
    points = np.stack([np.outer(r, np.sin(angle)), np.outer(r, np.cos(angle))], axis=-1)
    value = RegularGridInterpolator((y, x), deflection, bounds_error=False, fill_value=0.0)(points)
    orders = np.fft.rfft(value, axis=1)[:, : ANGLES // 4]
    diameters = int(np.argmax(r @ np.abs(orders) ** 2))
    profile = orders[:, diameters]
    largest = profile[np.abs(profile).argmax()]
    real = (profile / largest).real
    signs = np.sign(real[np.abs(real) > SIGNIFICANT])
    return diameters, int(np.count_nonzero(np.diff(signs)))


def groups(names: list[Name], frequencies: Array) -> list[list[int]]:
    """Groups of modes in ascending order: degenerate modes, and pairs (m, n) with m > 0.

    A square lattice splits pairs of even m, which are therefore recognised by their names alone.
    """
    found: list[list[int]] = []
    for number, (name, frequency) in enumerate(zip(names, frequencies, strict=True)):
        for group in found:
            first = group[0]
            same = name == names[first]
            pair = name.kind == "plate" and name.diameters != 0 and len(group) < 2
            near = abs(frequency - frequencies[first]) <= SAME * frequencies[first]
            if same and (pair or near or name.kind == "rigid"):
                group.append(number)
                break
        else:
            found.append([number])
    return found


def clamped_disc(diameters: int, circles: int) -> float:
    """lambda^2 = omega a^2 sqrt(rho h / D) of a thin disc clamped at its rim.

    The root of J_m(x) I_m+1(x) + I_m(x) J_m+1(x) = 0 (Leissa, Vibration of Plates, NASA SP-160,
    1969, Eq. 2.4), where the Rayleigh-Ritz method converges to: 10.216, 21.261, 34.877, 39.771,
    89.104 for the paper's five modes.
    """
    from scipy.optimize import brentq
    from scipy.special import ive, jv

    def residual(x: float) -> float:
        m = diameters
        return float(jv(m, x) * ive(m + 1, x) + ive(m, x) * jv(m + 1, x))

    # the roots lie near (m + 2 n + 2) pi / 2 and are about pi apart
    grid = np.arange(0.5, (diameters + 2 * circles + 6) * math.pi / 2 + diameters, 0.05)
    values = np.array([residual(x) for x in grid])
    at = np.flatnonzero(np.diff(np.sign(values)))[circles]
    return float(brentq(residual, grid[at], grid[at + 1])) ** 2


def thin_plate_frequency(
    name: Name, radius: float, thickness: float, modulus: float, poisson: float, density: float
) -> float:
    """Frequency of a thin clamped disc's mode, Hz (SI units)."""
    assert name.diameters is not None
    assert name.circles is not None
    rigidity = modulus * thickness**3 / (12 * (1 - poisson**2))
    root = math.sqrt(rigidity / (density * thickness))
    return clamped_disc(name.diameters, name.circles) * root / (2 * math.pi * radius**2)
