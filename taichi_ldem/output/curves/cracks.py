"""Measured cracks on a map of the plate: their paths, tips and fitted circles, in mm."""

from __future__ import annotations

import numpy as np

from taichi_ldem.analysis.circles import Circle
from taichi_ldem.analysis.cracks import Cracks
from taichi_ldem.output.curves.chart import BLUE, RED, Curve, Element, Point, Series

_MM, _MS = 1e3, 1e3
RADIAL, CIRCULAR = RED, BLUE
"""Colours of radial cracks and of the circular crack."""
_AWAY = 14.0  # distance of a tip's number from it, points


def radial_title(cracks: Cracks) -> str:
    """Number of radial cracks and the time at which they were counted."""
    when = "t2 (energy)" if cracks.at_failure else "the end, without failure"
    at = f"{_MS * cracks.radial_time:.2f} ms"
    return f"{len(cracks.radial)} radial cracks at {when}, {at}, from below"


def circular_title(cracks: Cracks) -> str:
    """Whether there is a circular crack at the end."""
    known = cracks.circular_circle is not None
    return f"{'' if known else 'no '}circular crack at the end, from below"


def radial_elements(cracks: Cracks) -> list[Element]:
    """Paths and numbered tips of the radial cracks, and the circle through the tips."""
    elements: list[Element] = []
    for number, crack in enumerate(cracks.radial, start=1):
        along, up = _MM * crack.path.T
        elements.append(Curve(along, up, colour=RADIAL, width=1.2))
        x, y = (float(place) for place in _MM * crack.tip)
        away = crack.tip - cracks.map.axis
        # the picture is from below: x points to the left
        shift = _AWAY * away / np.linalg.norm(away) * (-1, 1)
        elements.append(Point(x, y, colour=RADIAL, text=str(number), shift=(shift[0], shift[1])))
    return elements + circle_elements(cracks.radial_circle, RADIAL, "d_r")


def circular_elements(cracks: Cracks) -> list[Element]:
    """Points of the circular crack and the circle through them."""
    elements: list[Element] = []
    if cracks.circular_points.size:
        label = f"parts around: {100 * cracks.circular_coverage:.0f} % of the turn"
        across, up = _MM * cracks.circular_points.T
        elements.append(Curve(across, up, label, CIRCULAR, dots=True))
    return elements + circle_elements(cracks.circular_circle, CIRCULAR, "d_c")


def circle_elements(circle: Circle | None, colour: str, name: str) -> list[Element]:
    """A fitted circle with its diameter and centre; nothing without one."""
    if circle is None:
        return []
    x, y, diameter = _MM * circle.x, _MM * circle.y, _MM * circle.diameter
    label = f"{name} = {diameter:.1f} mm, points within {_MM * circle.scatter:.1f} mm (rms)"
    place = ", ".join(f"{round(v, 1) + 0.0:.1f}" for v in (x, y))  # no "-0.0"
    across, up = circle_points(circle)
    return [
        Curve(across, up, label, colour, dash="dash"),
        Point(x, y, f"its centre ({place}) mm", colour, "cross"),
    ]


def circle_points(circle: Circle) -> Series:
    """(2, 361) points of a circle, mm."""
    angle = np.linspace(0.0, 2 * np.pi, 361)
    unit = np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(_MM * (np.array([[circle.x], [circle.y]]) + circle.diameter / 2 * unit))
