"""Do groups of cracking specimens differ? Times, forces and energies with confidence intervals.

    python -m studies.specimens ENSEMBLE [ENSEMBLE ...]

Reads the members of ensembles of one specimen (``ldem ensemble``); those that differ in a seed or
in the striker's place only are one group. Prints means with 95 % confidence intervals (Student's t)
and the difference of every two groups (Welch's t test), in brackets where p >= 0.05, which does
not prove that they are equal. Forces are smoothed over a window that fits the specimen's
oscillations (``convergence.cracking.read``).
"""

import argparse
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from studies.bias import label
from taichi_ldem.ensemble.attempt import FINISHED
from taichi_ldem.ensemble.plan import MEMBERS, read_plan
from taichi_ldem.ensemble.results import read_rows
from taichi_ldem.errors import SceneError
from taichi_ldem.studies.convergence.cracking import mean_of, read

Array = npt.NDArray[np.float64]

QUANTITIES = {
    "onset": ("damage onset [ms]", 1e3, 3),
    "t1": ("t1 [ms]", 1e3, 3),
    "P1": ("P1 [N]", 1.0, 0),
    "t2": ("t2 (force) [ms]", 1e3, 3),
    "t2_energy": ("t2 (energy) [ms]", 1e3, 3),
    "fracture": ("fracture [mJ]", 1e3, 0),
}

Group = dict[str, Array]


def read_groups(ensembles: Sequence[Path], prefix: bool = False) -> dict[str, Group]:
    """Numbers of the finished members by the label of their group, SI units.

    Args:
        prefix: put the ensemble's folder before the label, to keep equal groups of two apart.

    Raises:
        SceneError: a folder holds no ensemble, or a file of it cannot be read.
    """
    found: dict[str, dict[str, list[float]]] = {}
    for ensemble in ensembles:
        for row in read_rows(read_plan(ensemble), ensemble):
            if row.state != FINISHED:
                continue
            numbers = read(ensemble / MEMBERS / row.member.name, row.member.scene)
            numbers["onset"] = row.numbers["damage_onset_time_s"]
            numbers["t2_energy"] = row.numbers["failure_time_energy_s"]
            name = f"{ensemble.name}: {label(row)}" if prefix else label(row)
            group = found.setdefault(name, {key: [] for key in QUANTITIES})
            for key, values in group.items():
                if numbers[key] is not None:
                    values.append(numbers[key])
    return {name: {k: np.array(v) for k, v in group.items()} for name, group in found.items()}


def difference(first: Array, second: Array) -> tuple[float, float, float]:
    """Relative difference of the first mean from the second, half its interval, and p (Welch)."""
    from scipy.stats import ttest_ind

    test = ttest_ind(first, second, equal_var=False)
    interval, mean = test.confidence_interval(), second.mean()
    half = 0.5 * (interval.high - interval.low) / mean
    return float(first.mean() / mean - 1), float(half), float(test.pvalue)


def report(groups: dict[str, Group]) -> str:
    """Means, and below them the differences of every two groups, Markdown."""
    heads = ["", "runs", *(title for title, *_ in QUANTITIES.values())]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name, group in groups.items():
        cells = [name, f"{max(map(len, group.values()))}"]
        for key, (_, scale, digits) in QUANTITIES.items():
            mean, half = mean_of(list(scale * group[key]))
            cells.append(f"{mean:.{digits}f} ± {half:.{digits}f}")
        lines.append(f"| {' | '.join(cells)} |")
    for (other, second), (name, first) in itertools.combinations(groups.items(), 2):
        cells = [f"{name} less {other}", ""]
        for key in QUANTITIES:
            if min(len(first[key]), len(second[key])) < 2:
                cells.append("-")
                continue
            value, half, p = difference(first[key], second[key])
            text = f"{100 * value:+.0f} ± {100 * half:.0f} %"
            cells.append(text if p < 0.05 else f"({text})")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table of ensembles."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("ensembles", type=Path, nargs="+")
    parser.add_argument("--apart", action="store_true", help="keep groups of two ensembles apart")
    given = parser.parse_args(arguments)
    try:
        print(report(read_groups(given.ensembles, given.apart)), end="")
    except SceneError as error:
        print(error)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
