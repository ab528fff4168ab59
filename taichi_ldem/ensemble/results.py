"""Numbers of an ensemble: a table with a row for each member, and statistics of each group."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem import __version__
from taichi_ldem.ensemble.attempt import FINISHED, Outcome, is_finished, read_attempts
from taichi_ldem.ensemble.plan import MEMBERS, Member, Plan
from taichi_ldem.scenarios.registry import entry_of
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.folder import RunFolder

COST = ("wall_s", "compile_s", "bars_per_s", "steps", "bars", "nodes")
CONFIDENCE = 0.95
FEWEST = 3
"""Least number of members for a confidence interval: with two, Student's t is 12.7 deviations."""
WAITING = "waiting"


@dataclass(frozen=True)
class Row:
    """A member, its numbers and its attempts.

    Attributes:
        numbers: those of its summary; empty where it has not finished.
        attempts: the attempts at it, in order.
        state: "finished", "waiting", or the state in which the last attempt ended.
    """

    member: Member
    numbers: Mapping[str, Any]
    attempts: tuple[Outcome, ...]
    state: str

    @property
    def reason(self) -> str:
        """The reason why it has not finished."""
        return "" if self.state == FINISHED or not self.attempts else self.attempts[-1].reason


def read_rows(plan: Plan, folder: Path) -> list[Row]:
    """All members of an ensemble, read from its folder."""
    return [read_row(member, folder) for member in plan.members]


def read_row(member: Member, folder: Path) -> Row:
    """A member of an ensemble, read from its folder."""
    run = RunFolder(folder / MEMBERS / member.name)
    attempts = tuple(read_attempts(folder, member.name))
    if is_finished(run.path):
        return Row(member, run.read_summary(), attempts, FINISHED)
    return Row(member, {}, attempts, attempts[-1].state if attempts else WAITING)


def write_tables(plan: Plan, folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Write ``ensemble.csv`` and ``ensemble.json``."""
    return [write_table(plan, folder, rows), write_statistics(plan, folder, rows)]


def columns(plan: Plan, rows: Sequence[Row]) -> list[str]:
    """Names of the summary's numbers in the table: the scenario's choice, or all of them."""
    chosen = {entry_of(member.scene).numbers for member in plan.members}
    if len(chosen) == 1 and (numbers := chosen.pop()):
        return list(numbers)
    names = dict.fromkeys(name for row in rows for name in row.numbers)
    return [name for name in names if name not in COST and any(_is_number(r, name) for r in rows)]


def _is_number(row: Row, name: str) -> bool:
    value = row.numbers.get(name)
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def write_table(plan: Plan, folder: Path, rows: Sequence[Row]) -> Path:
    """Write ``ensemble.csv``."""
    varied = list(plan.members[0].varied)
    names = columns(plan, rows)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", *varied, *names, "wall_s", "attempts", "state", "reason"])
    for row in rows:
        cells = [_cell(row.member.varied[key]) for key in varied]
        cells += [_cell(row.numbers.get(name)) for name in (*names, "wall_s")]
        tries = str(len(row.attempts))
        writer.writerow([row.member.name, *cells, tries, row.state, row.reason])
    file = folder / "ensemble.csv"
    write_whole(file, text.getvalue().encode())
    return file


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(value)


# --- statistics -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Statistics:
    """Statistics of one number over the members of a group.

    Attributes:
        count: number of members that have the number.
        standard_deviation: of the sample (count - 1 in the denominator); None for one member.
        interval: 95 % confidence interval of the mean, by Student's t; None for fewer than three
            members.
    """

    count: int
    mean: float
    standard_deviation: float | None
    interval: tuple[float, float] | None
    smallest: float
    largest: float

    @property
    def half_interval(self) -> float | None:
        """Half of the interval's length."""
        return None if self.interval is None else self.interval[1] - self.mean


def statistics(values: Sequence[float]) -> Statistics | None:
    """Mean, standard deviation and confidence interval; None without a value."""
    count = len(values)
    if not count:
        return None
    mean = math.fsum(values) / count
    low, high = float(min(values)), float(max(values))
    if count == 1:
        return Statistics(count, mean, None, None, low, high)
    deviation = float(np.std(values, ddof=1))
    if count < FEWEST:
        return Statistics(count, mean, deviation, None, low, high)
    from scipy.stats import t

    half = float(t.ppf(0.5 + CONFIDENCE / 2, count - 1)) * deviation / math.sqrt(count)
    return Statistics(count, mean, deviation, (mean - half, mean + half), low, high)


def groups(rows: Sequence[Row]) -> dict[tuple[tuple[str, Any], ...], list[Row]]:
    """The rows by group: those of a group differ in their seed only."""
    found: dict[tuple[tuple[str, Any], ...], list[Row]] = {}
    for row in rows:
        key = tuple((name, _hashable(value)) for name, value in row.member.group)
        found.setdefault(key, []).append(row)
    return found


def _hashable(value: Any) -> Any:
    return tuple(_hashable(item) for item in value) if isinstance(value, list) else value


def numbers_of(rows: Sequence[Row], name: str) -> list[float]:
    """The values of a number, of the rows that have it."""
    return [float(row.numbers[name]) for row in rows if _is_number(row, name)]


def write_statistics(plan: Plan, folder: Path, rows: Sequence[Row]) -> Path:
    """Write ``ensemble.json``: state, statistics by group, attempts that went wrong."""
    names = columns(plan, rows)
    content = {
        "version": __version__,
        "sha256": plan.hash,
        "asked": dict(plan.asked),
        "members": len(rows),
        "finished": sum(row.state == FINISHED for row in rows),
        "groups": [
            {
                "varied": dict(key),
                "members": len(group),
                "finished": sum(row.state == FINISHED for row in group),
                "statistics": {
                    name: asdict(found) | ({"interval": None} if name == "wall_s" else {})
                    for name in (*names, "wall_s")
                    if (found := statistics(numbers_of(group, name))) is not None
                },
            }
            for key, group in groups(rows).items()
        ],
        "not_finished": {
            row.member.name: {"state": row.state, "reason": row.reason}
            for row in rows
            if row.state != FINISHED
        },
        "attempts_not_finished": [
            asdict(outcome) for row in rows for outcome in row.attempts if outcome.state != FINISHED
        ],
    }
    file = folder / "ensemble.json"
    write_whole(file, (json.dumps(content, indent=2) + "\n").encode())
    return file
