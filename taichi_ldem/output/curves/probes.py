"""Curves of the probes' displacements."""

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
_MM = 1e3


def probes(run: LoadedRun) -> tuple[Panel, ...]:
    """Displacement of each probe along x, y and z over time: a colour a probe, a dash an axis."""
    elements: list[Element] = [
        Curve(
            run.time_ms,
            _MM * run.history[column],
            f"{probe.name}, along {axis}",
            PALETTE[number % len(PALETTE)],
            dash=dash,
        )
        for number, probe in enumerate(run.scene.probes)
        for axis, dash, column in zip("xyz", _DASHES, probe.columns, strict=False)
    ]
    elements += [Line(y=0.0, colour=DARK, width=0.8), times_of(run, "energy")]
    title = "Displacement of the probes"
    panel = Panel("probes", title, "time [ms]", "displacement [mm]", elements, x_range=whole(run))
    return (panel,)
