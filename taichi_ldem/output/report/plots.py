"""Interactive figures: the panels of ``output.curves`` drawn by Plotly, and the map of cracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taichi_ldem.analysis.cracks import Cracks
from taichi_ldem.output.curves.chart import (
    RED,
    Box,
    Curve,
    Element,
    Filled,
    Line,
    Panel,
    Point,
    Series,
)
from taichi_ldem.output.curves.cracks import (
    CIRCULAR,
    circle_elements,
    radial_elements,
    radial_title,
)
from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.output.report.page import Figure
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scene import Scene

Trace = dict[str, Any]

ONLY_HERE = ("force_strain", "broken_bars")
"""Figures of every page that has the data, in addition to those of the scenario's entry."""
_MS, _MM = 1e3, 1e3
_ENTRIES, _ENTRY_PX = 3, 19  # of the legend: a longer one makes the figure higher


def figures(run: LoadedRun) -> list[Figure]:
    """All figures of a run that panels describe, and its map of cracks."""
    if run.rows < 2:
        return []
    found = []
    for name in (*SCENARIOS[run.scene.scenario].figures, *ONLY_HERE):
        panels = FIGURES[name].panels
        if panels is not None and FIGURES[name].needs(run):
            found += [figure(panel) for panel in panels(run)]
    if run.cracks is not None:
        found.append(crack_map(run.scene, run.cracks, float(run.time_ms[-1])))
    return found


def figure(panel: Panel) -> Figure:
    """A panel; the time of the slider is a line in it, or a point on its path."""
    traces = [trace for element in panel.visible for trace in _traces(element)]
    more: dict[str, Any] = {}
    shapes = [shape for element in panel.visible for shape in _shapes(element)]
    if shapes:
        more["shapes"] = shapes
    if panel.x_range is not None:
        more["xaxis"] = {"range": list(panel.x_range)}
    if panel.y_range is not None and None not in panel.y_range:
        more["yaxis"] = {"range": list(panel.y_range)}
    if panel.log:
        more["yaxis"] = {"type": "log", "exponentformat": "power"}
    if panel.log_x:
        more["xaxis"] = {"type": "log"}
    title = _title(panel.title, panel.note)
    if panel.path is None:
        drawn = plot(title, traces, panel.x, panel.y, more)
        return Figure(panel.name, drawn, "line" if panel.in_time else "none")
    x, y = panel.path
    traces.append(_point(Point(float(x[0]), float(y[0]), "at the time of the slider", RED)))
    path = [float(f"{v:.6g}") for v in x], [float(f"{v:.6g}") for v in y]
    drawn = plot(title, traces, panel.x, panel.y, more)
    return Figure(panel.name, drawn, "point", path, len(traces) - 1)


def _title(text: str, below: str = "") -> Trace:
    title: Trace = {"text": text, "x": 0.02, "font": {"size": 15}}
    return title | ({"subtitle": {"text": below, "font": {"size": 12}}} if below else {})


def plot(title: Trace, traces: list[Trace], x: str, y: str, more: Mapping[str, Any]) -> str:
    """A figure as JSON, checked by Plotly.

    Args:
        x, y: labels of the axes. more: of the layout; mappings add to those that are there.
    """
    from plotly import graph_objects

    named = sum(bool(item.get("showlegend")) for item in (*traces, *more.get("shapes", ())))
    layout: dict[str, Any] = {
        "title": title,
        "template": "plotly_white",
        "margin": {"l": 65, "r": 15, "t": 60 if "subtitle" in title else 40, "b": 45},
        "xaxis": {"title": {"text": x}},
        "yaxis": {"title": {"text": y}, "zerolinecolor": "#888888", "zerolinewidth": 1},
        "legend": {"orientation": "h", "y": -0.2, "x": 0},
        "height": 360 + _ENTRY_PX * max(0, named - _ENTRIES),
        "hovermode": "closest",
    }
    for key, value in more.items():
        layout[key] = {**layout.get(key, {}), **value} if isinstance(value, dict) else value
    return str(graph_objects.Figure(data=traces, layout=layout).to_json())


def _traces(element: Element) -> list[Trace]:
    if isinstance(element, Curve):
        return [_curve(element)]
    if isinstance(element, Filled):
        return [_filled(element)]
    if isinstance(element, Point):
        return [_point(element)]
    return []  # boxes and lines are shapes; events have buttons


def _named(label: str) -> Trace:
    return {"name": label, "showlegend": bool(label)}


def _short(values: Series) -> Any:
    return np.asarray(values, dtype=np.float32)  # seven digits, more than a screen can show


def _curve(curve: Curve) -> Trace:
    trace = {"type": "scatter", "x": _short(curve.x), "y": _short(curve.y)} | _named(curve.label)
    if curve.dots:
        return trace | {"mode": "markers", "marker": {"size": 4, "color": curve.colour}}
    line = {"color": curve.colour, "width": curve.width, "dash": curve.dash}
    return trace | {"mode": "lines", "line": line}


def _filled(area: Filled) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": _short(area.x),
        "y": _short(area.y),
        "line": {"width": 0},
        "fill": "tozeroy",
        "fillcolor": _transparent(area.colour, area.opacity),
    } | _named(area.label)


def _transparent(colour: str, opacity: float) -> str:
    red, green, blue = (int(colour[n : n + 2], 16) for n in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity})"


def _point(point: Point) -> Trace:
    symbol = {"cross": "x-thin"}.get(point.symbol, point.symbol)
    marker: Trace = {"size": 10, "color": point.colour}
    marker["symbol"] = f"{symbol}-open" if point.hollow or point.symbol == "cross" else symbol
    trace: Trace = {"type": "scatter", "mode": "markers", "x": [point.x], "y": [point.y]}
    if point.text:
        trace |= {"mode": "markers+text", "text": [point.text], "textposition": "top center"}
    return trace | _named(point.label) | {"marker": marker}


def _shapes(element: Element) -> list[Trace]:
    if isinstance(element, Box):
        shape: Trace = {"type": "rect", "fillcolor": element.colour, "opacity": element.opacity}
        shape["line"] = {"width": 0}
        for axis, ends in (("x", element.x), ("y", element.y)):
            low, high = (0, 1) if ends is None else ends
            shape |= {f"{axis}0": low, f"{axis}1": high}
            shape[f"{axis}ref"] = f"{axis} domain" if ends is None else axis
        return [shape | _named(element.label)]
    if isinstance(element, Line) and element.label:  # zero has a line already
        style = {"color": element.colour, "width": element.width, "dash": element.dash}
        shape = {"type": "line", "line": style}
        at, along = ("x", "y") if element.x is not None else ("y", "x")
        place = element.x if element.x is not None else element.y
        shape |= {f"{at}0": place, f"{at}1": place, f"{along}0": 0, f"{along}1": 1}
        shape |= {f"{at}ref": at, f"{along}ref": f"{along} domain"}
        return [shape | _named(element.label)]
    return []


def crack_map(scene: Scene, cracks: Cracks, end: float) -> Figure:
    """When each column of modules cracked, with radial cracks and fitted circles, from below.

    Args:
        end: of the record, ms.
    """
    arrival = cracks.map.arrival
    half = [0.5 * _MM * n * cracks.map.spacing for n in arrival.shape]
    elements = radial_elements(cracks)
    elements += circle_elements(cracks.circular_circle, CIRCULAR, "d_c")
    elements += _clamp(scene)
    traces = [_arrival(cracks, half, end)]
    traces += [trace for element in elements for trace in _traces(element)]
    more = {
        "xaxis": {"range": [half[0], -half[0]], "constrain": "domain", "zeroline": False},
        "yaxis": {
            "range": [-half[1], half[1]],
            "scaleanchor": "x",
            "constrain": "domain",
            "zeroline": False,
        },
        "height": 500,
        "legend": {"y": -0.14},
    }
    title = _title("Cracks", radial_title(cracks))
    return Figure("crack_map", plot(title, traces, "x [mm]", "y [mm]", more), "map")


def _arrival(cracks: Cracks, half: Sequence[float], end: float) -> Trace:
    arrival = cracks.map.arrival
    centres = [
        np.linspace(-h, h, n, endpoint=False, dtype=np.float32) + np.float32(h / n)
        for h, n in zip(half, arrival.shape, strict=True)
    ]
    return {
        "type": "heatmap",
        "x": centres[0],
        "y": centres[1],
        "z": np.where(np.isfinite(arrival), _MS * arrival, np.nan).T.astype(np.float32),
        "zmin": 0.0,
        "zmax": end,
        "colorscale": [[0.0, "#440154"], [0.5, "#21918c"], [1.0, "#fde725"]],
        "colorbar": {"title": {"text": "cracked at [ms]"}, "len": 0.8},
        "hovertemplate": "x %{x:.2f} mm, y %{y:.2f} mm: %{z:.3f} ms<extra></extra>",
        "name": "cracked to a third of the thickness",
    }


def _clamp(scene: Scene) -> list[Curve]:
    """The clamp's inner circle."""
    clamp = scene.clamp
    if clamp is None or not scene.held or clamp.inner_diameter is None:
        return []
    angle, radius = np.linspace(0.0, 2 * np.pi, 181), _MM * clamp.inner_diameter / 2
    label = f"clamp, {2 * radius:g} mm"
    return [Curve(radius * np.cos(angle), radius * np.sin(angle), label, "#555555", 1, "dot")]
