"""The description of a figure: panels of curves, points, boxes, lines and named times.

Labels are plain text. Symbols in them are written as t1, P2, d_r; ``output.figures`` sets them as
mathematics. All numbers are in the units that the axes' labels name.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Series = NDArray[np.float64]
Dash = Literal["solid", "dash", "dot", "dashdot"]

BLUE, ORANGE, GREEN, RED, VIOLET = "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd"
BROWN, PINK, GREY = "#8c564b", "#e377c2", "#7f7f7f"
PALE, DARK, BLACK = "#bfbfbf", "#666666", "#000000"
PALETTE = (BLUE, ORANGE, GREEN, RED, VIOLET, BROWN, PINK)
"""Colours of curves of one kind, in their order."""
WIDTH = 1.8
"""Width of a curve, points."""


@dataclass(frozen=True)
class Curve:
    """A line through points, or the points alone.

    Attributes:
        x, y: (n,) each; NaN leaves a gap.
        label: in the legend; empty: no entry.
        width: points.
        dots: whether the points are drawn instead of the line.
    """

    x: Series
    y: Series
    label: str = ""
    colour: str = BLUE
    width: float = WIDTH
    dash: Dash = "solid"
    dots: bool = False


@dataclass(frozen=True)
class Filled:
    """The area between a curve and zero."""

    x: Series
    y: Series
    label: str
    colour: str = BLUE
    opacity: float = 0.15


@dataclass(frozen=True)
class Point:
    """A single point.

    Attributes:
        text: next to it. shift: of the text from the point, to the right and up, points.
    """

    x: float
    y: float
    label: str = ""
    colour: str = BLUE
    symbol: Literal["circle", "square", "diamond", "cross"] = "circle"
    hollow: bool = False
    text: str = ""
    shift: tuple[float, float] = (0.0, 14.0)


@dataclass(frozen=True)
class Box:
    """A shaded rectangle; without ``x`` or ``y`` it spans the whole panel in that direction."""

    label: str
    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    colour: str = RED
    opacity: float = 0.12


@dataclass(frozen=True)
class Line:
    """A straight line across the panel, at an ``x`` (upright) or at a ``y``."""

    x: float | None = None
    y: float | None = None
    label: str = ""
    colour: str = RED
    width: float = 1.2
    dash: Dash = "solid"


@dataclass(frozen=True)
class Times:
    """Times of events as thin upright lines.

    Attributes:
        events: time and name of each, in order of time.
        named: whether the names stand above the panel.
    """

    events: tuple[tuple[float, str], ...]
    named: bool = True


Element: TypeAlias = Curve | Filled | Point | Box | Line | Times
"""One thing in a panel."""


@dataclass(frozen=True)
class Panel:
    """A pair of axes with what is drawn on them, in the order of drawing.

    Attributes:
        name: of the panel, unique among all figures.
        title: what the panel shows.
        x, y: labels of the axes, with units.
        x_range, y_range: limits; None: as the elements need.
        log, log_x: whether the y axis, the x axis is logarithmic.
        height: relative to the other panels of the figure.
        note: stands above the panel. remark: stands below it, smaller.
        in_time: whether x is the time, so that the time of a reader's choice is an upright line.
        path: (x, y) at every row of the history, along which a reader can follow the run.
    """

    name: str
    title: str
    x: str
    y: str
    elements: Sequence[Element]
    x_range: tuple[float, float] | None = None
    y_range: tuple[float | None, float | None] | None = None
    log: bool = False
    log_x: bool = False
    height: float = 1.0
    note: str = ""
    remark: str = ""
    in_time: bool = True
    path: tuple[Series, Series] | None = None

    @property
    def visible(self) -> list[Element]:
        """The elements without marks that lie beyond the range of x.

        A mark that nobody sees must not stand in the legend.
        """
        if self.x_range is None:
            return list(self.elements)
        low, high = self.x_range
        return [e for e in self.elements if _reach(e)[0] <= high and _reach(e)[1] >= low]


def _reach(element: Element) -> tuple[float, float]:
    """Smallest and largest x of a mark; of anything else, no limits."""
    if isinstance(element, Line | Point) and element.x is not None:
        return element.x, element.x
    if isinstance(element, Box) and element.x is not None:
        return element.x
    return -math.inf, math.inf
