"""The finished picture: panels with outlines, scale bar and axes, captions and the colour key."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.output.render.scales import Scale
from taichi_ldem.output.render.shading import BODY_RGB
from taichi_ldem.output.render.views import SIZE_PX, WIDTH, Panel, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.floating[Any]]


def compose(
    view: View,
    images: Sequence[FloatArray],
    lines: Sequence[tuple[list[FloatArray], list[FloatArray], list[tuple[str, FloatArray]]]],
    scale: Scale,
) -> Figure:
    """One picture of the panels, with outlines, scale bars, axes and the colour key.

    Args:
        images: (rows, columns, 3) of each panel.
        lines: of each panel, the outlines (n, 2) of solid bodies, the lines of circles, and marks
            with their places, m.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(SIZE_PX[0] / 100, SIZE_PX[1] / 100), dpi=100)
    FigureCanvasAgg(figure)
    for panel, image, (solids, circles, marks) in zip(view.panels, images, lines, strict=True):
        place = ((1 - WIDTH) / 2, panel.bottom, WIDTH, panel.height)
        axes = figure.add_axes(place, frameon=False, xticks=(), yticks=())
        half = panel.span / 2
        axes.imshow(image, extent=(-half, half, -half * panel.aspect, half * panel.aspect))
        hidden = panel.rotation[2, 2] < -0.1  # behind the plate
        for line in solids:
            axes.plot(*line.T, ":" if hidden else "-", color=tuple(BODY_RGB), linewidth=1.5)
        for line in circles:
            axes.plot(*line.T, "--", color="0.35", linewidth=1.5, dashes=(5, 4))
        for mark, at in marks:
            _draw_mark(axes, mark, at)
        _annotate(axes, panel)
    _colour_key(figure, scale)
    return figure


def _annotate(axes: Axes, panel: Panel) -> None:
    """Scale bar at the lower right, directions of x, y, z at the lower left, the panel's label."""
    _draw_scale_bar(axes, panel)
    if panel.triad:
        _draw_triad(axes, panel)


def _draw_mark(axes: Axes, mark: str, at: FloatArray) -> None:
    box = {"boxstyle": "circle,pad=0.2", "facecolor": "white", "edgecolor": tuple(BODY_RGB)}
    axes.text(
        float(at[0]),
        float(at[1]),
        mark,
        ha="center",
        va="center",
        fontsize=14,
        bbox=box,
        clip_on=True,
    )


def _draw_scale_bar(axes: Axes, panel: Panel) -> None:
    half = panel.span / 2
    low, unit = -half * panel.aspect, panel.span / 100
    end = half - unit
    axes.plot((end - panel.scale_bar, end), (low + unit, low + unit), color="black", linewidth=4)
    text = f"{1e3 * panel.scale_bar:g} mm"
    axes.text(end - panel.scale_bar / 2, low + 1.6 * unit, text, ha="center", fontsize=16)
    axes.text(-half, -low, panel.label, ha="left", va="top", fontsize=16)
    axes.set_xlim(-half, half)
    axes.set_ylim(low, -low)


def _draw_triad(axes: Axes, panel: Panel) -> None:
    unit = panel.span / 100
    half, low = panel.span / 2, -panel.span / 2 * panel.aspect
    arrow = {"arrowstyle": "-|>", "color": "black", "shrinkA": 0, "shrinkB": 0}
    x, y = -half + 6.5 * unit, low + 2.5 * unit
    for name, (right, up) in zip("xyz", panel.rotation[:2].T, strict=True):
        if np.hypot(right, up) > 0.1:
            tip = (x + 4 * unit * right, y + 4 * unit * up)
            axes.annotate("", xy=tip, xytext=(x, y), arrowprops=arrow)
            mark = (x + 5.2 * unit * right, y + 5.2 * unit * up)
            axes.text(*mark, name, ha="center", va="center", fontsize=16)


def _colour_key(figure: Figure, scale: Scale) -> None:
    from matplotlib.cm import ScalarMappable

    axes = figure.add_axes((0.30, 0.055, 0.40, 0.018))
    colours = ScalarMappable(scale.norm, scale.colours)
    bar = figure.colorbar(
        colours, cax=axes, orientation="horizontal", format="{x:g}", ticks=scale.ticks
    )
    bar.ax.tick_params(labelsize=14)
    bar.set_label(scale.label, fontsize=14)
