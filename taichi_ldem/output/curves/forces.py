"""Curves of forces and of the striker's velocity."""

from __future__ import annotations

import numpy as np

from taichi_ldem.analysis import paper
from taichi_ldem.analysis.quantities import named
from taichi_ldem.analysis.signals import low_pass, smooth_force
from taichi_ldem.analysis.window import in_words
from taichi_ldem.output.curves.chart import (
    BLUE,
    BROWN,
    DARK,
    GREEN,
    ORANGE,
    PALE,
    PINK,
    RED,
    VIOLET,
    Box,
    Curve,
    Element,
    Filled,
    Line,
    Panel,
    Point,
    Series,
)
from taichi_ldem.output.curves.times import times_of
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.solver.contact import BODIES

_MS, _MM = 1e3, 1e3
_TIME = "time [ms]"
_FORCE = "_force_n"
_FILTERED = (ORANGE, VIOLET, BROWN, PINK)
_OTHER_BODIES = (GREEN, BROWN, PINK)


def force(run: LoadedRun) -> tuple[Panel, ...]:
    """Striker force over time, as sampled, averaged and filtered, with other bodies' forces."""
    time, sampled = run.history["time_s"], run.history["striker_force_n"]
    smooth, average = _averaged(run, "striker_force_n"), _average(run)
    curves = [
        Curve(run.time_ms, sampled, "striker, as sampled", PALE, 0.6),
        Curve(run.time_ms, smooth, f"striker, {average}", BLUE, 2.4),
    ]
    for count, cutoff in enumerate(run.scene.output.filter_frequencies):
        filtered = low_pass(time, sampled, cutoff, run.number("first_peak_time_s"))
        label = f"striker, low-pass at {cutoff / 1e3:g} kHz after t1"
        curves.append(Curve(run.time_ms, filtered, label, _FILTERED[count % 4], 2.0))
    others = _other_bodies(run)
    elements: list[Element] = [*curves, *others, Line(y=0.0, colour=DARK, width=0.8)]
    elements += [*_peaks(run), times_of(run, "force")]
    # a beam oscillates rather than rattles: its samples are within the limits
    shown = [sampled if run.is_beam else smooth, *(curve.y for curve in others)]
    if run.is_papers_test:
        elements += papers_force()
        shown.append(np.array(paper.P2_N))
    low, high = _limits(np.concatenate(shown))
    remark = ""
    if sampled.max() > high or sampled.min() < low:
        remark = f"samples reach from {sampled.min():.0f} to {sampled.max():.0f} N"
    panel = Panel(
        "force",
        "Striker force",
        _TIME,
        "force [N]",
        elements,
        x_range=whole(run),
        y_range=(low, high),
        remark=remark,
    )
    return (panel,)


def whole(run: LoadedRun) -> tuple[float, float]:
    """The range of a time axis that holds the record, ms."""
    return 0.0, float(run.time_ms[-1])


def _average(run: LoadedRun) -> str:
    return f"mean over {in_words(run.window)}"


def _averaged(run: LoadedRun, column: str) -> Series:
    return smooth_force(run.history["time_s"], run.history[column], run.window)


def _other_bodies(run: LoadedRun) -> list[Curve]:
    """Averaged forces of all rigid bodies but the striker that the history has."""
    names = _others(run)
    curves = []
    plural = {o.column: body.name for body in BODIES for o in body.observables_in(run.scene)}
    for number, name in enumerate(names):
        sign = f", positive {positive}" if (positive := named(name).positive) else ""
        label = f"{plural[name]}, {_average(run)}{sign}"
        curves.append(Curve(run.time_ms, _averaged(run, name), label, _OTHER_BODIES[number % 3], 1))
    return curves


def _others(run: LoadedRun) -> list[str]:
    """Columns of the forces of all rigid bodies but the first striker."""
    return [c for c in run.history if c.endswith(_FORCE) and c != "striker_force_n"]


def _peaks(run: LoadedRun) -> list[Point]:
    """The peaks as points; their values stand in the legend, where they hide no curve."""
    points = []
    for name, order, square in (("P1", "first", False), ("P2", "second", True)):
        peak, at = run.number(f"{order}_peak_force_n"), run.number(f"{order}_peak_time_s")
        if peak is not None and at is not None:
            label = f"{name} = {peak:.0f} N at {_MS * at:.2f} ms"
            symbol = "square" if square else "circle"
            points.append(Point(_MS * at, peak, label, BLUE, symbol))  # type: ignore[arg-type]
    return points


def _limits(shown: Series) -> tuple[float, float]:
    """Limits that hold zero and all of some values."""
    low, high = min(0.0, float(shown.min())), max(float(shown.max()), 1e-9)
    return low - 0.05 * (high - low), high + 0.08 * (high - low)


def papers_force() -> list[Element]:
    """Peaks and time of failure of the paper's experiments, and time of failure of its model."""
    model = _MS * paper.T2_LDEM_S
    label = f"paper's LDEM, t2 ~ {model:g} ms"
    return [*experiments_force(), Line(x=model, label=label, dash="dash")]


def experiments_force() -> list[Element]:
    """Peaks and time of failure of the paper's experiments."""
    t1, first, last = _MS * paper.T1_S, _MS * paper.T2_S[0], _MS * paper.T2_S[1]
    label = f"experiments, P1 ~ {paper.P1_N:.0f} N at {t1:g} ms"
    return [
        Point(t1, paper.P1_N, label, RED, "diamond", hollow=True),
        Box("experiments, P2 and t2", (first, last), paper.P2_N, opacity=0.15),
    ]


def floor_force(run: LoadedRun) -> tuple[Panel, ...]:
    """Force of the floor over time, as sampled and averaged."""
    sampled, smooth = run.history["floor_force_n"], _averaged(run, "floor_force_n")
    elements: list[Element] = [
        Curve(run.time_ms, sampled, "floor, as sampled", PALE, 0.6),
        Curve(run.time_ms, smooth, f"floor, {_average(run)}", BLUE, 2.4),
        times_of(run, "energy"),
    ]
    return (Panel("floor_force", "Floor force", _TIME, "force [N]", elements, x_range=whole(run)),)


def force_displacement(run: LoadedRun) -> tuple[Panel, ...]:
    """Force over the striker's displacement, with the work up to the peak as an area."""
    sampled = run.history["striker_force_n"]
    displacement = _MM * run.history["striker_displacement_m"]
    average = _average(run)
    smooth, support = _averaged(run, "striker_force_n"), _averaged(run, "support_force_n")
    elements: list[Element] = [
        Curve(displacement, sampled, "striker, as sampled", PALE, 0.6),
        Curve(displacement, smooth, f"striker, {average}", BLUE, 2.4),
        Curve(displacement, support, f"supports, {average}", GREEN, 1.0),
    ]
    at, work = run.number("peak_time_s"), run.number("peak_work_j")
    if at is not None and work is not None:
        until = run.history["time_s"] <= at
        label = f"work until the crack runs, {1e3 * work:.2f} mJ"
        elements.append(Filled(displacement[until], sampled[until], label))
    panel = Panel(
        "force_displacement",
        "Force over displacement",
        "striker displacement [mm]",
        "force [N]",
        elements,
        x_range=(0.0, float(displacement.max())),
        y_range=(min(0.0, float(sampled.min())), None),
        path=(displacement, sampled),
    )
    return (panel,)


def velocity(run: LoadedRun) -> tuple[Panel, ...]:
    """The velocity of each striker over time."""
    column = run.history["striker_velocity_m_s"]
    elements: list[Element] = [
        Curve(run.time_ms, column, "striker, positive towards the plate"),
        *_other_strikers(run),
        times_of(run, "velocity"),
    ]
    if run.is_papers_test:
        t1 = _MS * paper.T1_S
        largest, failure = papers_velocity()
        elements += [
            largest,
            Line(x=t1, label=f"experiments, t1 ~ {t1:g} ms", dash="dashdot"),
            failure,
        ]
    y = "striker velocity [m/s]"
    return (Panel("velocity", "Striker velocity", _TIME, y, elements, x_range=whole(run)),)


def _other_strikers(run: LoadedRun) -> list[Curve]:
    """Velocities of all strikers but the first, in the colours of their forces."""
    curves = []
    for count, column in enumerate(_others(run)):
        name = column.removesuffix(_FORCE)
        speed = run.history.get(f"{name}_velocity_m_s")
        if speed is not None:
            curves.append(Curve(run.time_ms, speed, name, _OTHER_BODIES[count % 3], 1.5))
    return curves


def papers_velocity() -> tuple[Line, Box]:
    """Time of the largest velocity, and of failure, in the paper's experiments."""
    largest, first, last = _MS * paper.V_MAX_S, _MS * paper.T2_S[0], _MS * paper.T2_S[1]
    label = f"experiments, largest velocity at ~{largest:g} ms"
    return (
        Line(x=largest, label=label, width=1.5, dash="dot"),
        Box(f"experiments, t2 from {first:g} to {last:g} ms", (first, last)),
    )
