"""Does a number's scatter depend on the module size? Two resolutions of random specimens.

    python -m studies.size_effect ENSEMBLE [--number strength] [--over-homogeneous]

Reads an ensemble that varies ``plate.modules_through_thickness`` and seeds (and anything else) and
prints two tables for a number of the summary:

- for each group, mean and CV with 95 % confidence intervals (Student's t; chi squared);
- for each pair of resolutions of otherwise equal groups, tests of equal means (Welch's t test, and
  seed by seed, as a seed gives the same field at any resolution if there is a correlation length)
  and of equal spreads (Brown and Forsythe's test: Levene's about the medians).

With ``--over-homogeneous``, numbers are divided by that of the homogeneous specimen of the same
modules, which depends on the modules if there is a notch or an edge.
"""

import argparse
import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.ensemble.plan import read_plan
from taichi_ldem.ensemble.results import Row, groups, numbers_of, read_rows, statistics
from taichi_ldem.ensemble.table3 import label
from taichi_ldem.errors import SceneError

MODULES = "plate.modules_through_thickness"


def line(name: str, values: Sequence[float], scale: float) -> str:
    """Count, mean and CV of a group with their intervals, a line of Markdown."""
    found = statistics(values)
    if found is None or found.standard_deviation is None or found.half_interval is None:
        return f"| {name} | {len(values)} | - | - |"
    half = found.half_interval
    low, high = deviation_interval(found.standard_deviation, found.count)
    cv = [100 * s / found.mean for s in (found.standard_deviation, low, high)]
    return (
        f"| {name} | {found.count} | {found.mean / scale:.4g} ± {half / scale:.2g} "
        f"| {cv[0]:.2f} ({cv[1]:.2f} to {cv[2]:.2f}) |"
    )


def deviation_interval(deviation: float, count: int) -> tuple[float, float]:
    """95 % confidence interval of a normal sample's standard deviation."""
    from scipy.stats import chi2

    free = count - 1
    low, high = (deviation * math.sqrt(free / float(chi2.ppf(p, free))) for p in (0.975, 0.025))
    return low, high


def compared(first: Sequence[float], second: Sequence[float]) -> tuple[float, float, float]:
    """Ratio of the second mean to the first, and p of equal means and of equal spreads."""
    from scipy.stats import levene, ttest_ind

    means = ttest_ind(first, second, equal_var=False).pvalue
    spreads = levene(first, second, center="median").pvalue
    return float(np.mean(second) / np.mean(first)), float(means), float(spreads)


def seed_by_seed(first: Sequence[float], second: Sequence[float]) -> str:
    """Second less first, in pairs, over the first's mean, with 95 % interval and p (Student)."""
    from scipy.stats import ttest_rel

    if len(first) != len(second):
        return "-"
    test, mean = ttest_rel(second, first), float(np.mean(first))
    interval = test.confidence_interval()
    middle, half = 0.5 * (interval.low + interval.high), 0.5 * (interval.high - interval.low)
    return f"{100 * middle / mean:+.1f} ± {100 * half / mean:.1f} % (p = {test.pvalue:.2g})"


def over_homogeneous(rows: Sequence[Row], number: str) -> list[Row]:
    """The random specimens' rows, their number over that of the homogeneous one of their modules.

    Raises:
        SceneError: there is no homogeneous specimen with so many modules.
    """
    base = {
        row.member.scene.plate.modules_through_thickness: value
        for row in rows
        if row.member.scene.disorder is None
        for value in numbers_of([row], number)
    }
    scaled = []
    for row in rows:
        modules = row.member.scene.plate.modules_through_thickness
        if row.member.scene.disorder is None or not numbers_of([row], number):
            continue
        if modules not in base:
            raise SceneError(f"no finished homogeneous specimen has {modules} modules")
        scaled.append(replace(row, numbers={number: row.numbers[number] / base[modules]}))
    return scaled


def report(rows: Sequence[Row], number: str, scale: float) -> str:
    """Both tables, Markdown.

    Raises:
        SceneError: no finished member has the number.
    """
    found = {key: numbers_of(group, number) for key, group in groups(rows).items()}
    if not any(found.values()):
        raise SceneError(f"--number {number}: no finished member has it")
    lines = [f"| specimens | runs | {number} | CV [%] |", "|---|---|---|---|"]
    lines += [line(label(key), values, scale) for key, values in found.items()]
    heads = ("specimens", "modules", "ratio of means", "p, means", "p, spreads", "seed by seed")
    lines += ["", f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for (key, first), (other, second) in itertools.combinations(found.items(), 2):
        mine, theirs = dict(key), dict(other)
        pair = (mine.pop(MODULES, None), theirs.pop(MODULES, None))
        if mine != theirs or pair[0] == pair[1] or min(len(first), len(second)) < 2:
            continue
        ratio, means, spreads = compared(first, second)
        same: tuple[tuple[str, Any], ...] = tuple(mine.items())
        cells = [label(same), f"{pair[0]}, {pair[1]}", f"{ratio:.3f}", f"{means:.2g}"]
        cells += [f"{spreads:.2g}", seed_by_seed(first, second)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables of an ensemble."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("ensemble", type=Path)
    parser.add_argument("--number", default="strength", help="of the summaries")
    parser.add_argument("--scale", type=float, default=1.0, help="numbers are shown over it")
    parser.add_argument("--over-homogeneous", action="store_true", help="see the module")
    given = parser.parse_args(arguments)
    try:
        rows = read_rows(read_plan(given.ensemble), given.ensemble)
        if given.over_homogeneous:
            rows = over_homogeneous(rows, given.number)
        print(report(rows, given.number, given.scale))
    except SceneError as error:
        print(error)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
