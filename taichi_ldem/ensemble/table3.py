"""Table 3 of the paper from an ensemble, with the paper's and the experiments' values."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taichi_ldem.analysis.paper import EXPERIMENTS, P1_N, P2_N, T1_S, T2_S, TABLE_3, is_papers_test
from taichi_ldem.analysis.quantities import AT_T2, at_end
from taichi_ldem.ensemble.attempt import FINISHED
from taichi_ldem.ensemble.axes import CV, SEED
from taichi_ldem.ensemble.plan import Plan
from taichi_ldem.ensemble.results import Row, groups, numbers_of, statistics
from taichi_ldem.scenarios.registry import entry_of
from taichi_ldem.storage.durable import write_whole

COLUMNS = (
    ("radial cracks", "radial_cracks", 1.0, 0, 1),
    ("d_r [mm]", "radial_diameter_m", 1e3, 1, 1),
    ("d_c [mm]", "circular_diameter_m", 1e3, 1, 1),
    ("onset [ms]", "damage_onset_time_s", 1e3, 2, 2),
    ("t1 [ms]", "first_peak_time_s", 1e3, 2, 2),
    ("P1 [N]", "first_peak_force_n", 1.0, 0, 0),
    ("t2 (energy) [ms]", "failure_time_energy_s", 1e3, 2, 2),
    ("t2 (velocity) [ms]", "failure_time_velocity_s", 1e3, 2, 2),
    ("P2 [N]", "second_peak_force_n", 1.0, 0, 0),
)
"""Title, number of the summary, factor to the unit, digits of a value, digits of a mean."""

EXPLAINED = """\
Values of the members in the order of their seeds, and below them mean ± half of the 95 % confidence
interval of the mean (Student's t) over those that have the number, for three or more; "-": a
member has none. d_r: circle through the radial tips at t2 (energy), the largest strain energy; "*":
measured at the end, because the strain energy shows no failure; d_c: circle through the circular
crack at the end; onset: the dissipated energy is no longer zero.
"""


def label(group: Sequence[tuple[str, Any]]) -> str:
    """A group in words, e.g. "CV 25 %"."""
    words = []
    for key, value in group:
        if key == CV:
            words.append("homogeneous" if not value else f"CV {100 * value:g} %")
        elif value is not None:
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            words.append(f"{key.rpartition('.')[2]} {format(value, 'g') if number else value}")
    return ", ".join(words) or "all seeds"


def write_table_3(plan: Plan, folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Write ``table3.md`` and ``table3.csv`` for scenarios whose tables have its numbers."""
    shown = {name for _, name, *_ in COLUMNS}
    if any(not shown <= set(entry_of(member.scene).numbers) for member in plan.members):
        return []
    papers = all(is_papers_test(member.scene) for member in plan.members)
    files = [folder / "table3.md", folder / "table3.csv"]
    write_whole(files[0], markdown(rows, papers).encode())
    write_whole(files[1], comma_separated(rows, papers).encode())
    return files


def markdown(rows: Sequence[Row], papers: bool) -> str:
    """The table, with the paper's values where the scenes are its test."""
    lines = [
        "| | " + " | ".join(title for title, *_ in COLUMNS) + " |",
        "|---" * (len(COLUMNS) + 1) + "|",
    ]
    for key, group in groups(rows).items():
        finished = [row for row in group if row.state == FINISHED]
        name = label(key)
        count = "" if len(finished) == len(group) else f" ({len(finished)} of {len(group)} done)"
        lines.append(_line(name + count, [_values(finished, c) for c in COLUMNS]))
        if len(finished) > 1:
            lines.append(_line("mean", [_mean(finished, c) for c in COLUMNS]))
        if papers and (printed := _printed(key)) is not None:
            lines.append(_line(f"*paper's LDEM, {name}*", printed))
    if papers:
        lines.append(_line("*experiments*", _experiments()))
        note = ""
    else:
        note = "\nThe paper's values are left out: plate, striker or speed are not its own.\n"
    return "\n".join(lines) + "\n\n" + EXPLAINED + note


def _line(name: str, cells: Sequence[str]) -> str:
    return f"| {name} | " + " | ".join(cells) + " |"


def _values(rows: Sequence[Row], column: tuple[str, str, float, int, int]) -> str:
    _, name, factor, digits, _ = column
    cells = []
    for row in rows:
        value = row.numbers.get(name)
        star = "*" if name in AT_T2 and at_end(row.numbers) else ""
        cells.append("-" if value is None else f"{factor * value:.{digits}f}{star}")
    return " ".join(cells) or "-"


def _mean(rows: Sequence[Row], column: tuple[str, str, float, int, int]) -> str:
    _, name, factor, _, digits = column
    found = statistics(numbers_of(rows, name))
    if found is None:
        return "-"
    mean = f"{factor * found.mean:.{digits}f}"
    if found.half_interval is None:
        return f"{mean} ({'one' if found.count == 1 else 'two'})"
    some = "" if found.count == len(rows) else f" ({found.count} of {len(rows)})"
    return f"{mean} ± {factor * found.half_interval:.{digits}f}{some}"


def _printed(key: Sequence[tuple[str, Any]]) -> list[str] | None:
    """The paper's cells for a group given by the variability of G_f alone; None for another."""
    cv = dict(key).get(CV)
    if cv is None or len(key) != 1:
        return None
    for known, specimens in TABLE_3.items():
        if math.isclose(cv, known, abs_tol=1e-9):
            cells = [
                " ".join(str(n) for n in specimens.radial_cracks),
                " ".join(f"{1e3 * d:.1f}" for d in specimens.radial_diameter),
                " ".join(f"{1e3 * d:.0f}" for d in specimens.circular_diameter),
            ]
            return cells + [""] * (len(COLUMNS) - len(cells))
    return None


def _experiments() -> list[str]:
    e = EXPERIMENTS
    return [
        " ".join(str(n) for n in e.radial_cracks),
        " ".join(f"{1e3 * d:.0f}" for d in e.radial_diameter),
        " ".join(f"{1e3 * d:.0f}" for d in e.circular_diameter),
        "",
        f"~{1e3 * T1_S:.2f}",
        f"~{P1_N:.0f}",
        f"{1e3 * T2_S[0]:.1f} to {1e3 * T2_S[1]:.1f}",
        "",
        f"{P2_N[0]:.0f} to {P2_N[1]:.0f}",
    ]


def comma_separated(rows: Sequence[Row], papers: bool) -> str:
    """The same in SI units, a line for each specimen."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [name for _, name, *_ in COLUMNS]
    writer.writerow(["source", "group", "specimen", *names])
    for key, group in groups(rows).items():
        for row in group:
            if row.state == FINISHED:
                seed = row.member.varied.get(SEED)
                specimen = row.member.name if seed is None else f"seed {seed}"
                values = [row.numbers.get(name) for name in names]
                writer.writerow(["computed", label(key), specimen, *values])
    printed = [("paper's LDEM", label(((CV, cv),)), s) for cv, s in TABLE_3.items()]
    for source, name, s in [*printed, ("experiments", "", EXPERIMENTS)] if papers else []:
        cracks = zip(s.radial_cracks, s.radial_diameter, s.circular_diameter, strict=True)
        for number, measured in enumerate(cracks, start=1):
            writer.writerow([source, name, number, *measured, *[""] * (len(names) - 3)])
    return text.getvalue()
