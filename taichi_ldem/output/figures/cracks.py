"""Pictures of measured cracks: the counted cracks and fitted circles, drawn on the map."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.analysis.crackmap import CrackMap
from taichi_ldem.analysis.cracks import Cracks
from taichi_ldem.analysis.window import in_words
from taichi_ldem.output.curves.cracks import (
    CIRCULAR,
    RADIAL,
    circle_points,
    circular_elements,
    circular_title,
    radial_elements,
    radial_title,
)
from taichi_ldem.output.figures.draw import draw_elements, symbols

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MS = 1e3
_MM = 1e3
_DARKEST = 5.0  # of the grey scale; deep cracks have 3, shallower ones 1


def overlay(
    figure: Figure,
    cracks: Cracks,
    outlines: Callable[[Axes], None] = lambda axes: None,
    least: float = 0.0,
) -> None:
    """Radial cracks at t2 and, to their right, the circular crack at the end, both from below.

    Args:
        outlines: draws the specimen and its clamp.
        least: smallest half side of the square that is shown, m.
    """
    left, right = figure.subplots(1, 2)
    for axes, dark, pale, until in (
        (left, cracks.map, cracks.faint, cracks.radial_time),
        (right, cracks.through, cracks.map, math.inf),
    ):
        _draw_map(axes, dark, pale, until)
        outlines(axes)
        _zoom(axes, cracks, least)
        axes.set_anchor("N")
    draw_elements(left, radial_elements(cracks))
    left.set_title(symbols(radial_title(cracks)))
    draw_elements(right, circular_elements(cracks))
    right.set_title(circular_title(cracks))
    for axes, depths in ((left, ("third", "sixth")), (right, ("two thirds", "third"))):
        for shade, depth in zip(_shades(), depths, strict=True):
            text = f"cracked to {'' if 'two' in depth else 'a '}{depth} of the thickness"
            axes.plot([], [], "s", color=shade, markersize=9, label=text)
    for axes in (left, right):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), fontsize=12)


def growth(figure: Figure, cracks: Cracks, area: np.ndarray[Any, Any]) -> tuple[Axes, Axes, Axes]:
    """Radius and speed of the furthest tip, and broken area with the cracks' length, over time.

    Args:
        area: (n,) broken area at the times of ``cracks.growth``, m2.
    """
    upper, middle, lower = figure.subplots(3, 1, sharex=True)
    grown = cracks.growth
    time = _MS * grown.time
    until = "until $t_2$ (energy)" if cracks.at_failure else "until the end"
    label = f"furthest radial tip, {until}"
    upper.plot(time, _MM * grown.tip_radius, color=RADIAL, label=label)
    mean = cracks.mean_speed
    if mean is not None:
        known = np.isfinite(grown.tip_radius)
        line = np.polyfit(grown.time[known], grown.tip_radius[known], 1)
        fitted = _MM * np.polyval(line, grown.time[known])
        upper.plot(
            time[known], fitted, "--", color="0.4", lw=1.2, label=f"straight line: {mean:.1f} m/s"
        )
    upper.set_ylabel("distance from the\nstriker's axis [mm]")
    middle.plot(time, grown.tip_speed, color=RADIAL, linewidth=1.2)
    middle.set_ylabel(f"speed of that tip\nover {in_words(grown.window)} [m/s]")
    lower.plot(time, _MM**2 * area, color="C4", label="broken area")
    lower.set_ylabel("broken area [mm$^2$]")
    lower.set_ylim(bottom=0.0)
    right = lower.twinx()
    right.grid(False)
    label = "length of all cracks, without the core under the striker"
    right.plot(time, _MM * grown.length, color="C2", linewidth=1.2, label=label)
    right.set_ylabel("crack length [mm]")
    right.set_ylim(bottom=0.0)
    lines = [*upper.lines, *lower.lines, *right.lines]
    labels = [str(line.get_label()) for line in lines]
    figure.legend(lines, labels, loc="outside lower center", ncols=2, fontsize=12)
    lower.set_xlabel("time [ms]")
    return upper, middle, lower


@dataclass(frozen=True)
class Panel:
    """A map of a sheet.

    Attributes:
        name: above it; may be empty.
        cracks: of the specimen; None where it has none.
        outlines: draws the specimen with its holes and notches, and its clamp.
    """

    name: str
    cracks: Cracks | None
    outlines: Callable[[Axes], None] = lambda axes: None


Panels = Sequence[tuple[str, Sequence[Panel]]]
"""Rows of a sheet: a name and its maps."""


def sheet(figure: Figure, rows: Panels, *, final: bool) -> None:
    """Many maps with one scale, from below: the radial cracks at t2, or all cracks at the end.

    Args:
        final: the end, with the circle of d_c; otherwise t2, with tips and the circle of d_r.
    """
    across = max(len(panels) for _, panels in rows)
    figure.set_size_inches(2.2 + 3.1 * max(2, across), 2.6 + 3.4 * len(rows))
    grid = figure.subplots(len(rows), across, squeeze=False, sharex=True, sharey=True)
    maps = [panel.cracks for _, panels in rows for panel in panels if panel.cracks is not None]
    half = max(map(_reach, maps), default=1.0)
    for line, (name, panels) in zip(grid, rows, strict=True):
        for axes, panel in zip(line, panels, strict=False):
            _draw_panel(axes, panel, final=final)
            axes.set(xlim=(half, -half), ylim=(-half, half))
        for axes in line[len(panels) :]:
            axes.set_axis_off()
        line[0].set_ylabel(f"{name}\n\ny [mm]" if name else "y [mm]")
    for column in range(across):  # the lowest map of each
        lowest = max(n for n, (_, panels) in enumerate(rows) if len(panels) > column)
        grid[lowest][column].set_xlabel("x [mm]")
        grid[lowest][column].tick_params(labelbottom=True)
    when = "at the end" if final else "at $t_2$ (energy), or at the end without failure"
    figure.suptitle(f"Cracks from below {when}", fontsize=15)
    _sheet_legend(figure, final)


def _draw_panel(axes: Axes, panel: Panel, *, final: bool) -> None:
    axes.set_aspect("equal")
    cracks, parts = panel.cracks, [panel.name] if panel.name else []
    if cracks is None:
        panel.outlines(axes)
        axes.set_title("\n".join([*parts, "no crack"]), fontsize=12)
        return
    style: dict[str, Any] = {"color": CIRCULAR if final else RADIAL}
    if final:
        _draw_map(axes, cracks.through, cracks.map, math.inf)
        panel.outlines(axes)
        circle, name = cracks.circular_circle, "$d_c$"
    else:
        _draw_map(axes, cracks.map, cracks.faint, cracks.radial_time)
        panel.outlines(axes)
        circle, name = cracks.radial_circle, "$d_r$"
        for crack in cracks.radial:
            axes.plot(*(_MM * crack.tip), "o", markeredgecolor="white", markersize=7, **style)
        when = f"at {_MS * cracks.radial_time:.2f} ms" if cracks.at_failure else "at the end"
        parts.append(f"{len(cracks.radial)} radial cracks {when}")
    if circle is not None:
        axes.plot(*circle_points(circle), "--", linewidth=1.6, **style)
    size = "no circle" if circle is None else f"{name} = {_MM * circle.diameter:.1f} mm"
    size += "" if final or cracks.at_failure else ", no failure"
    share = f", {100 * cracks.circular_coverage:.0f} % of the turn" if final else ""
    axes.set_title("\n".join([*parts, size + share]), fontsize=12)
    axes.set(xlabel="", ylabel="")


def _sheet_legend(figure: Figure, final: bool) -> None:
    from matplotlib.lines import Line2D

    deep, less = ("two thirds", "a third") if final else ("a third", "a sixth")
    handles: list[Line2D] = []
    for shade, depth in zip(_shades(), (deep, less), strict=True):
        text = f"cracked to {depth} of the thickness"
        handles.append(Line2D([], [], ls="", marker="s", color=shade, ms=9, label=text))
    color, name = (CIRCULAR, "circular crack, $d_c$") if final else (RADIAL, "tips, $d_r$")
    if not final:
        text = "tips of the radial cracks"
        handles.append(Line2D([], [], ls="", marker="o", color=color, ms=7, label=text))
    handles.append(Line2D([], [], ls="--", color=color, label=f"circle fitted to the {name}"))
    handles.append(Line2D([], [], ls="", marker="+", color="black", ms=12, label="striker's axis"))
    drawn = {line.get_label(): line for axes in figure.axes for line in axes.lines}
    known = {handle.get_label() for handle in handles}
    # what the outlines have named: notches and the clamp
    handles += [
        line
        for label, line in drawn.items()
        if not str(label).startswith("_") and label not in known
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=12)


def _draw_map(axes: Axes, dark: CrackMap, pale: CrackMap, until: float) -> None:
    """Cracked columns at a time in grey, less deeply cracked ones in pale grey."""
    x, y = (_MM * 0.5 * n * dark.spacing for n in dark.arrival.shape)
    shade = sum(np.isfinite(m.arrival) & (m.arrival <= until) for m in (dark, dark, pale))
    axes.imshow(
        np.asarray(shade).T,
        extent=(-x, x, -y, y),
        origin="lower",
        cmap="Greys",
        vmin=0.0,
        vmax=_DARKEST,
        interpolation="nearest",
    )
    axes.grid(False)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.plot(*(_MM * dark.axis), "k+", markersize=12, label="striker's axis")


def _shades() -> tuple[Any, Any]:
    """Colours of columns that are cracked deeply and less deeply."""
    from matplotlib import colormaps

    return colormaps["Greys"](3 / _DARKEST), colormaps["Greys"](1 / _DARKEST)


def _zoom(axes: Axes, cracks: Cracks, least: float) -> None:
    """Both panels show the same square around all cracks, from below: x points to the left."""
    half = max(_reach(cracks), _MM * least)
    x, y = _MM * cracks.map.axis
    axes.set_xlim(x + half, x - half)
    axes.set_ylim(y - half, y + half)


def _reach(cracks: Cracks) -> float:
    """Half of the side of a square about the axis that holds all cracks and circles, mm."""
    radius = np.where(np.isfinite(cracks.map.arrival), cracks.map.radius(), 0.0).max()
    circles = [c for c in (cracks.radial_circle, cracks.circular_circle) if c is not None]
    reach = [math.dist((c.x, c.y), cracks.map.axis) + c.diameter / 2 for c in circles]
    return float(1.15 * _MM * max(radius, 2 * cracks.map.thickness, *reach, 0.0))
