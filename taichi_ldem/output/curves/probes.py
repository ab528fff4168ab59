"""Curves of what the probes record, apart from velocities."""

from __future__ import annotations

from taichi_ldem.output.curves.chart import (
    DARK,
    PALETTE,
    Curve,
    Dash,
    Element,
    Line,
    Panel,
)
from taichi_ldem.output.curves.forces import whole
from taichi_ldem.output.curves.times import times_of
from taichi_ldem.output.loaded import LoadedRun

_DASHES: tuple[Dash, ...] = ("dot", "dash", "solid")
_SHOWN = {
    "displacement": ("Displacement of the probes", "displacement [mm]", 1e3),
    "strain": ("Strain of the probes along the axes", "strain [%]", 1e2),
    "stress": ("Stress of the probes along the axes", "stress [MPa]", 1e-6),
}


def probes(run: LoadedRun) -> tuple[Panel, ...]:
    """Displacement, strain and stress along x, y and z over time, a panel each where recorded."""
    panels = [
        _panel(run, quantity)
        for quantity in _SHOWN
        if any(quantity in probe.quantities for probe in run.scene.probes)
    ]
    return tuple(panels)


def _panel(run: LoadedRun, quantity: str) -> Panel:
    """A quantity of each probe: a colour a probe, a dash an axis."""
    title, words, scale = _SHOWN[quantity]
    elements: list[Element] = [
        Curve(
            run.time_ms,
            scale * run.history[column],
            f"{probe.name}, along {axis}",
            PALETTE[number % len(PALETTE)],
            dash=dash,
        )
        for number, probe in enumerate(run.scene.probes)
        for axis, dash, column in zip("xyz", _DASHES, probe.columns_of(quantity), strict=False)
    ]
    elements += [Line(y=0.0, colour=DARK, width=0.8), times_of(run, "energy")]
    name = "probes" if quantity == "displacement" else f"probes_{quantity}"
    return Panel(name, title, "time [ms]", words, elements, x_range=whole(run))
