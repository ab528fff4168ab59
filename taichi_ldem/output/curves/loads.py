"""Curves of the loads on the plate."""

from __future__ import annotations

from taichi_ldem.output.curves.chart import (
    DARK,
    PALETTE,
    Curve,
    Element,
    Line,
    Panel,
)
from taichi_ldem.output.curves.forces import whole
from taichi_ldem.output.curves.times import times_of
from taichi_ldem.output.loaded import LoadedRun


def loads(run: LoadedRun) -> tuple[Panel, ...]:
    """The force of each load over time, along its direction."""
    elements: list[Element] = [
        Curve(
            run.time_ms,
            run.history[load.columns[0]],
            f"{load.name}, along its direction",
            PALETTE[number % len(PALETTE)],
        )
        for number, load in enumerate(run.scene.loads)
    ]
    elements += [Line(y=0.0, colour=DARK, width=0.8), times_of(run, "energy")]
    panel = Panel(
        "loads", "Forces of the loads", "time [ms]", "force [N]", elements, x_range=whole(run)
    )
    return (panel,)
