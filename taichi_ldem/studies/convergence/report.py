"""Observed orders, recommended settings and the files of numbers of a convergence study."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichi_ldem.studies.convergence.plan import GOALS, PAPER
from taichi_ldem.studies.convergence.records import Row, Study


def order(sizes: Sequence[float], errors: Sequence[float]) -> float:
    """Observed order p of error ~ size^p, by least squares of the logarithms."""
    pairs = [(s, e) for s, e in zip(sizes, errors, strict=True) if e > 0]
    if len(pairs) < 2:
        return math.nan
    x, y = np.log(np.array(pairs)).T
    return float(np.polyfit(x, y, 1)[0])


def orders(rows: Sequence[Row]) -> dict[str, tuple[float, float]]:
    """Observed orders in space (at half the critical step, in f64) and in time, by quantity."""
    found = {}
    for name in rows[0].errors:
        space = [r for r in rows if not r.timed and r.point.share == 0.5]
        space = [r for r in space if r.point.precision == "f64"]
        timed = [r for r in rows if r.timed]
        found[name] = (
            order([r.record["spacing_m"] for r in space], [r.errors[name] for r in space]),
            order([r.time_step for r in timed], [r.errors[name] for r in timed]),
        )
    return found


def pareto(rows: Sequence[Row], name: str) -> list[Row]:
    """The points that no other beats in both error and seconds, from the cheapest on."""
    front: list[Row] = []
    for row in sorted((r for r in rows if not r.timed), key=lambda r: (r.seconds, r.errors[name])):
        if not front or row.errors[name] < front[-1].errors[name]:
            front.append(row)
    return front


def advice(study: Study, rows: Sequence[Row]) -> list[str]:
    """A sentence for each goal, and one about the paper's own setting."""
    name = study.plan.first
    front = pareto(rows, name)
    lines = []
    for goal in GOALS:
        good = [row for row in front if row.errors[name] <= goal]
        if good:
            p = good[0].point
            lines.append(
                f"For an error of {100 * goal:.0f} % in the {name}, choose {p.modules} modules, "
                f"{good[0].share:.2f} of the critical time step and {p.precision}: it costs "
                f"{good[0].seconds:.2g} s on one core here, with an error of "
                f"{100 * good[0].errors[name]:.2g} %."
            )
        else:
            best = min(rows, key=lambda row: math.inf if row.timed else row.errors[name])
            lines.append(
                f"None of these settings reaches {100 * goal:.0f} % in the {name}; the best is "
                f"{best.point.modules} modules, with {100 * best.errors[name]:.2g} % in "
                f"{best.seconds:.2g} s."
            )
    for row in rows:
        if (row.point.modules, row.point.share, row.point.precision) == PAPER and not row.timed:
            lines.append(
                "The paper's own setting (six modules, half of the critical step, f64) costs "
                f"{row.seconds:.2g} s here; its error in the {name} is "
                f"{100 * row.errors[name]:.2g} %."
            )
    return lines


def report(study: Study, rows: Sequence[Row]) -> str:
    """Table, observed orders and advice, as Markdown."""
    names = list(rows[0].errors)
    lines: list[str] = []
    for timed, title in ((False, "Against the reference"), (True, "In time alone")):
        lines += [f"### {title}", ""]
        heads = ["modules", "dt/critical", "precision", "steps", "seconds of a core"]
        heads += [f"{name}: error [%]" for name in names]
        lines += ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
        for row in rows:
            if row.timed != timed:
                continue
            cells = [f"{row.point.modules}", f"{row.share:.3f}", row.point.precision]
            cells += [f"{row.record['steps']:,}", f"{row.seconds:.3g}"]
            cells += [f"{100 * row.errors[name]:.3g}" for name in names]
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    lines += ["| quantity | order in space | order in time |", "|---|---|---|"]
    for name, (space, in_time) in orders(rows).items():
        lines.append(f"| {name} | {space:.1f} | {in_time:.1f} |")
    reference = study.reference()
    if "continuum_m_s" in reference:
        lines += ["", f"The reference's speed of long waves is {reference['speed_m_s']:.1f} m/s, "]
        lines[-1] += f"the continuum's {reference['continuum_m_s']:.1f} m/s."
    lines += ["", *advice(study, rows), ""]
    return "\n".join(lines)


def write_csv(rows: Sequence[Row], file: Path) -> None:
    """Write a line for each run: its settings, its cost and its errors."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        names = list(rows[0].errors)
        cost = ["steps", "bars", "time_step_s", "cpu_s", "wall_s", "compile_s", "energy_error"]
        heads = ["against", "modules", "share", "precision", *cost]
        writer.writerow([*heads, *[f"error_{name.replace(' ', '_')}" for name in names]])
        for row in rows:
            p, against = row.point, "finer_step" if row.timed else "reference"
            values = [row.record[key] for key in cost]
            errors = [row.errors[name] for name in names]
            writer.writerow([against, p.modules, row.share, p.precision, *values, *errors])
