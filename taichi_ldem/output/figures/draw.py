"""Panels drawn by Matplotlib."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_ldem.output.curves.chart import (
    DARK,
    WIDTH,
    Box,
    Curve,
    Element,
    Filled,
    Line,
    Panel,
    Point,
    Times,
)
from taichi_ldem.storage.durable import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLE: dict[Any, Any] = {
    "font.size": 13,
    "lines.linewidth": WIDTH,
    "axes.grid": True,
    "grid.color": "0.9",
    "axes.axisbelow": True,
    "legend.frameon": False,
}
_DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
_SYMBOLS = {"circle": "o", "square": "s", "diamond": "D", "cross": "x"}
_CROWDED = 0.11
"""Names of times that are closer than this share of the axes' width stand in two rows."""


def save(
    file: Path,
    draw: Callable[[Figure], None],
    *,
    size: tuple[float, float] | None = None,
    dpi: int = 150,
    metadata: dict[str, str] | None = None,
) -> Path:
    """Draw a figure into a file, without a display; returns the file.

    Args:
        size: width and height, inches; None: ``draw`` sets them.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        figure = Figure(figsize=size, dpi=dpi, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        write_figure(file, figure, metadata=metadata)
    return file


def write_figure(file: Path, figure: Figure, **how: Any) -> None:
    """Write a figure whole or not at all; ``how`` is given to Matplotlib's ``savefig``."""
    image = io.BytesIO()
    figure.savefig(image, format="png", **how)
    write_whole(file, image.getvalue())


def symbols(text: str) -> str:
    """A label with its symbols (t1, P2, d_r) as mathematics."""
    text = re.sub(r"\b([tP])([12])\b", r"$\1_\2$", text)
    return re.sub(r"\b(d)_([rc])\b", r"$\1_\2$", text)


def draw_panels(figure: Figure, panels: Sequence[Panel]) -> None:
    """Panels below each other with a common x axis, and one legend for all."""
    heights = [panel.height for panel in panels]
    grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)
    for axes, panel in zip(grid.ravel(), panels, strict=True):
        _draw_panel(axes, panel)
    grid[-1][0].set_xlabel(panels[-1].x)
    entries: dict[str, Any] = {}  # a curve of one name in several panels has one entry
    for axes in grid.ravel():
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend([*entries.values()], [*entries], loc="outside lower center", ncols=2, fontsize=12)


def _draw_panel(axes: Axes, panel: Panel) -> None:
    axes.set_ylabel(panel.y)
    if panel.log:
        axes.set_yscale("log")
    if panel.log_x:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(_plain)
        axes.xaxis.set_minor_formatter(_plain)
    draw_elements(axes, panel.visible)
    if panel.y_range is not None:
        axes.set_ylim(*panel.y_range)
    if panel.x_range is not None:
        axes.set_xlim(*panel.x_range)
    if panel.note:
        axes.set_title(panel.note, fontsize=12)
    if panel.remark:
        axes.set_title(panel.remark, loc="right", color="0.5", fontsize=11, y=-0.14)
    for element in panel.visible:
        if isinstance(element, Times) and element.named:
            name_times(axes, element)


def _plain(value: float, _: object) -> str:
    """A mark of a logarithmic axis, without a power of ten: 0.5, 1, 2, 5, 10, and no other ones."""
    leading = value / 10 ** math.floor(math.log10(value))
    return f"{value:g}" if round(leading, 6) in (1, 2, 5) else ""


def draw_elements(axes: Axes, elements: Sequence[Element]) -> None:
    """Draw elements in their order; the names of times are left to ``name_times``."""
    for element in elements:
        if isinstance(element, Curve):
            _draw_curve(axes, element)
        elif isinstance(element, Filled):
            axes.fill_between(
                element.x,
                element.y,
                color=element.colour,
                alpha=element.opacity,
                lw=0,
                label=_label(element.label),
            )
        elif isinstance(element, Point):
            _draw_point(axes, element)
        elif isinstance(element, Box):
            _draw_box(axes, element)
        elif isinstance(element, Line):
            _draw_line(axes, element)
        else:
            for at, _ in element.events:
                axes.axvline(at, color=DARK, linewidth=0.8)


def _label(text: str) -> str | None:
    """A label for the legend; None keeps an element out of it."""
    return symbols(text) if text else None


def _draw_curve(axes: Axes, curve: Curve) -> None:
    style: dict[str, Any] = {"color": curve.colour, "label": _label(curve.label)}
    if curve.dots:
        axes.plot(curve.x, curve.y, ".", markersize=5, **style)
        return
    dash = _DASHES[curve.dash]
    axes.plot(curve.x, curve.y, linestyle=dash, linewidth=curve.width, **style)


def _draw_point(axes: Axes, point: Point) -> None:
    style: dict[str, Any] = {"color": point.colour, "markersize": 9, "linestyle": "none"}
    if point.hollow:
        style["fillstyle"] = "none"
    elif point.symbol != "cross":
        style |= {"markeredgecolor": "white", "zorder": 5}
    label = _label(point.label)
    axes.plot(point.x, point.y, _SYMBOLS[point.symbol], label=label, **style)
    if point.text:
        axes.annotate(
            point.text,
            (point.x, point.y),
            point.shift,
            textcoords="offset points",
            ha="center",
            va="center",
            color=point.colour,
            fontsize=14,
        )


def _draw_box(axes: Axes, box: Box) -> None:
    from matplotlib.patches import Rectangle

    style: dict[str, Any] = {"color": box.colour, "alpha": box.opacity, "lw": 0}
    label = _label(box.label)
    if box.x is not None and box.y is not None:
        corner = box.x[0], box.y[0]
        sides = box.x[1] - box.x[0], box.y[1] - box.y[0]
        axes.add_patch(Rectangle(corner, *sides, label=label, **style))
    elif box.x is not None:
        axes.axvspan(*box.x, label=label, **style)
    elif box.y is not None:
        axes.axhspan(*box.y, label=label, **style)


def _draw_line(axes: Axes, line: Line) -> None:
    style: dict[str, Any] = {"color": line.colour, "linewidth": line.width}
    style |= {"linestyle": _DASHES[line.dash], "label": _label(line.label)}
    if line.x is not None:
        axes.axvline(line.x, **style)
    if line.y is not None:
        axes.axhline(line.y, **style)


def name_times(axes: Axes, times: Times) -> None:
    """Names of times above the panel, in a second row where they are close."""
    width = axes.get_xlim()[1]
    for at, name, row in _rows(times.events, width):
        style: dict[str, Any] = {"ha": "left" if row else "center", "va": "bottom", "fontsize": 12}
        xy: Any = ("data", "axes fraction")
        above = (-4 * row, 4 + 16 * row)
        axes.annotate(
            symbols(name), (at, 1.0), above, xycoords=xy, textcoords="offset points", **style
        )


def _rows(events: Sequence[tuple[float, str]], width: float) -> Iterator[tuple[float, str, int]]:
    """Time, name and row (0 or 1) of events in order of time."""
    last, row = -math.inf, 0
    for at, name in events:
        row = 1 - row if at - last < _CROWDED * width else 0
        last = at
        yield at, name, row
