"""Figure of a convergence study: error against seconds, and the error of the time step alone."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.studies.convergence.plan import GOALS
from taichi_ldem.studies.convergence.records import Row, Study
from taichi_ldem.studies.convergence.report import orders, pareto

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def figure(study: Study, rows: Sequence[Row], file: Path) -> None:
    """Draw error against seconds, a line for each family, and the error of the time step alone."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    drawing = plt.figure(figsize=(11, 5), layout="constrained")
    left, right = drawing.subplots(1, 2)
    _draw_errors(left, rows, study.plan.first)
    _draw_time_steps(right, rows, study)
    for axes in (left, right):
        axes.legend(fontsize=8)
        axes.grid(alpha=0.3, which="both")
    drawing.savefig(file, dpi=130)
    plt.close(drawing)


def _draw_errors(axes: "Axes", rows: Sequence[Row], name: str) -> None:
    """Error of a quantity against seconds of stepping, a line for each step and precision."""
    families: dict[tuple[str, float], list[Row]] = {}
    for row in rows:
        if not row.timed:
            families.setdefault((row.point.precision, row.point.share), []).append(row)
    for number, ((precision, share), members) in enumerate(families.items()):
        axes.loglog(
            [row.seconds for row in members],
            [row.errors[name] for row in members],
            "-" if precision == "f64" else "--",
            marker="o",
            ms=4,
            color=f"C{number}",
            label=f"{precision}, step {share:g} of the critical",
        )
    for row in next(iter(families.values()), []):
        at = (row.seconds, row.errors[name])
        axes.annotate(f" {row.point.modules}", at, fontsize=8, va="bottom")
    front = pareto(rows, name)
    axes.loglog(
        [row.seconds for row in front],
        [row.errors[name] for row in front],
        color="black",
        lw=5,
        alpha=0.15,
        label="Pareto front",
    )
    for goal in GOALS:
        axes.axhline(goal, color="gray", ls=":", lw=1)
    axes.set(xlabel="seconds of stepping on one core", ylabel=f"relative error of the {name}")
    order = orders(rows)[name][0]
    axes.set_title(
        f"modules through the thickness at the points; order in space {order:.1f}", fontsize=10
    )


def _draw_time_steps(axes: "Axes", rows: Sequence[Row], study: Study) -> None:
    """Error by the time step alone, a line for each quantity, and a line of order 2."""
    timed = sorted((row for row in rows if row.timed), key=lambda row: row.time_step)
    found = orders(rows)
    for number, (quantity, (_, order)) in enumerate(found.items()):
        axes.loglog(
            [row.share for row in timed],
            [row.errors[quantity] for row in timed],
            "o-",
            ms=4,
            color=f"C{number}",
            label=f"{quantity}: order {order:.1f}",
        )
    name = study.plan.first
    shares = np.array([timed[0].share, timed[-1].share])
    top = max(timed[-1].errors[name], 1e-16)
    axes.loglog(shares, top * (shares / shares[-1]) ** 2, color="black", ls=":", label="order 2")
    axes.set(xlabel="time step over the critical one", ylabel="relative error by the time step")
    axes.set_title(
        f"the time step alone, {study.plan.timed} modules, f64: order {found[name][1]:.1f}",
        fontsize=10,
    )
