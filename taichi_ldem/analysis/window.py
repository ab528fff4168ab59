"""The time over which forces are averaged before numbers are read from them.

It is a fixed share of the specimen's own first oscillation, so that results scale when all lengths
and times do: 0.2 ms for the paper's plate and 0.06 ms for its beam, and for others in proportion to
the period by thin-plate (thin-beam) theory. The key ``output.smoothing_window`` sets another time.
"""

import math

from taichi_ldem.scene import Scene

PLATE_WINDOW = 0.2e-3
"""Time for the paper's plate, s: a third of a period, which keeps oscillations and hides noise."""

BEAM_WINDOW = 60e-6
"""Time for the paper's beam, s: the period in which it swings between striker and supports."""

CLAMPED, FREE, SUPPORTED = 10.216, 9.0, 4.9
"""lambda^2 of a thin disc's first axisymmetric mode (Leissa, Vibration of Plates, NASA SP-160,
1969). For Poisson's ratios from 0.25 to 0.33 it is 8.9 to 9.1 with a free rim, and 4.9 to 5.0 with
one that is supported."""


def smoothing_window(scene: Scene) -> float:
    """Time over which a scene's forces are averaged, s (see the module)."""
    if scene.output.smoothing_window is not None:
        return scene.output.smoothing_window
    m, plate, clamp = scene.material, scene.plate, scene.clamp
    sound, height = math.sqrt(m.youngs_modulus / m.density), plate.size[2]
    if scene.supports is not None and scene.supports.span is not None:
        return BEAM_WINDOW * _beam(scene.supports.span, height, sound) / _PAPERS_BEAM
    root, diameter = FREE, plate.diameter or plate.width
    if scene.supports is not None:
        root, diameter = SUPPORTED, scene.supports.across
    if scene.held and clamp is not None and clamp.inner_diameter is not None:
        root, diameter = CLAMPED, clamp.inner_diameter
    period = _disc(root, diameter, height, sound, m.poisson_ratio)
    return PLATE_WINDOW * period / _PAPERS_PLATE


def _disc(root: float, diameter: float, height: float, sound: float, ratio: float) -> float:
    """Period of a thin disc over a factor that all discs share, s.

    Args:
        root: lambda^2. diameter, height: m. sound: sqrt(E / rho), m/s. ratio: Poisson's.
    """
    return diameter**2 * math.sqrt(1 - ratio**2) / (root * height * sound)


def _beam(span: float, height: float, sound: float) -> float:
    """Period of a thin beam on supports over a factor that all beams share, s."""
    return span**2 / (height * sound)


_PMMA = math.sqrt(3.35e9 / 1190.0)
_PAPERS_PLATE = _disc(CLAMPED, 0.076, 3.2e-3, _PMMA, 0.25)
_PAPERS_BEAM = _beam(0.024, 6.5e-3, _PMMA)


def in_words(window: float) -> str:
    """The time in milliseconds, to three digits."""
    return f"{1e3 * window:.3g} ms"
