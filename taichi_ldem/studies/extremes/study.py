"""Runs stiff and extreme cases, and compares each with what theory predicts.

A case ends stable, is refused with a message, or is stopped by the guard, which names the cause.
Any other end (a crash, a hang, a NaN without a message, energy that drifts) is a failure of the
program, and so is an end that theory did not predict. The cases of a group share a lattice and its
compiled kernels. Each group runs in processes of its own, so a crash ends one case only.
"""

import csv
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from taichi_ldem.errors import SceneError
from taichi_ldem.studies.extremes.bench import Result
from taichi_ldem.studies.extremes.case import REFUSED, STABLE, STOPPED, Case
from taichi_ldem.studies.extremes.cases import CASES

LIMIT = 1800.0
"""Seconds after which a group counts as hung."""

NOT_AS_PREDICTED = 1

Results = list[tuple[Case, Result]]


def run(out: Path, *, quick: bool = False, only: Sequence[str] = (), workers: int = 0) -> int:
    """Run the matrix and write ``extremes.csv``, ``extremes.md`` and ``extremes.png``.

    Args:
        quick: the small form: one group. only: names of cases, or parts of them.
        workers: groups at a time, each on one thread; 0: as many as there are cores.

    Returns:
        0 where every case ended as predicted, else 1.

    Raises:
        SceneError: ``only`` names no case.
    """
    cases = [case for case in CASES if case.quick or not quick]
    cases = [case for case in cases if not only or any(part in case.name for part in only)]
    if not cases:
        raise SceneError(f"--only {' '.join(only)}: no such case")
    out.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    groups = list(dict.fromkeys(case.group for case in cases))
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        parts = pool.map(lambda g: _group(g, [c for c in cases if c.group == g], out), groups)
        found = {case.name: result for part in parts for case, result in part}
    results = [(case, found[case.name]) for case in cases]
    _write_csv(results, out / "extremes.csv")
    (out / "extremes.md").write_text(table(results), encoding="utf-8")
    figure(results, out / "extremes.png")
    wrong = [case.name for case, result in results if not case.agrees(result)]
    took = time.monotonic() - started
    print(f"{len(results)} cases in {took:.0f} s, {len(wrong)} not as predicted; results in {out}")
    return NOT_AS_PREDICTED if wrong else 0


def _group(group: str, cases: list[Case], out: Path) -> Results:
    """Run a group's cases; where one ends its process, the others run in a new one."""
    file = out / f"{group}.jsonl"
    file.unlink(missing_ok=True)
    left = list(cases)
    found: dict[str, Result] = {}
    while left:
        names = [case.name for case in left]
        command = [sys.executable, "-m", "taichi_ldem.studies.extremes.worker", group, str(file)]
        ending = "ended early"
        try:
            done = subprocess.run(
                [*command, *names], capture_output=True, text=True, timeout=LIMIT, check=False
            )
            ending = f"crashed with exit code {done.returncode}: {done.stderr[-300:]}"
        except subprocess.TimeoutExpired:
            ending = f"hung for {LIMIT:.0f} s"
        begun = _read(file, found)
        left = [case for case in left if case.name not in found]
        if left:
            lost = begun if begun in {case.name for case in left} else left[0].name
            found[lost] = Result(ending.split()[0], " ".join(ending.split()))
            left = [case for case in left if case.name != lost]
        for case in cases:
            if case.name in names and case.name in found:
                _print_line(case, found[case.name])
    return [(case, found[case.name]) for case in cases]


def _read(file: Path, found: dict[str, Result]) -> str:
    """Add the finished cases of a group's file, and return the name of the last that was begun."""
    begun = ""
    if file.exists():
        for line in file.read_text(encoding="utf-8").splitlines():
            record = json.loads(line)
            begun = record.get("begun", begun)
            if "name" in record:
                name = record.pop("name")
                found[name] = Result(**record)
    return begun


def _print_line(case: Case, result: Result) -> None:
    mark = "as predicted" if case.agrees(result) else f"NOT as predicted ({case.predicted})"
    print(f"{case.group:11s}{case.name:50s}{result.outcome:10s}{mark}", flush=True)


def _write_csv(results: Results, file: Path) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        heads = ["case", "group", "predicted", "agrees", *asdict(Result()), "because"]
        writer.writerow(heads)
        for case, result in results:
            row = [case.name, case.group, case.predicted, case.agrees(result)]
            writer.writerow([*row, *asdict(result).values(), case.because])


def _number(value: float, form: str) -> str:
    return format(value, form) if value == value else ""


def table(results: Results) -> str:
    """Predicted against result, as Markdown."""
    heads = (
        "case | dt/critical | steps | predicted | seen | drift of the plate's energy | "
        "strains | broken | why, or what was said"
    )
    lines = [f"| {heads} |", "|---" * (heads.count("|") + 1) + "|"]
    for case, result in results:
        outcome = result.outcome if case.agrees(result) else f"**{result.outcome}**"
        strains = ""
        if result.outcome == STABLE and result.strain == result.strain:
            strains = f"{result.strain:.2g}, {-result.compression:.2g}"
        drift = _number(result.drift, ".1e") if result.outcome == STABLE else ""
        reason = case.because
        if result.message:
            message = result.message.removeprefix("error: ").removeprefix("scene.toml: ")
            reason += f"; *{message.split('likely cause: ')[-1]}*"
        cells = [
            case.name,
            _number(result.share, ".3g"),
            f"{result.steps:,}" if result.steps else "",
            case.predicted,
            outcome,
            drift,
            strains,
            f"{result.broken:,}" if result.broken else "",
            reason.replace("|", "/"),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def figure(results: Results, file: Path) -> None:
    """Draw the drift of every stable case, and how the others ended."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    colours = {STABLE: "tab:blue", REFUSED: "tab:gray", STOPPED: "tab:orange"}
    drawing = plt.figure(figsize=(9, 1.2 + 0.17 * len(results)), layout="constrained")
    axes = drawing.add_subplot()
    floor = 1e-12
    for row, (case, result) in enumerate(results):
        colour = colours.get(result.outcome, "tab:red")
        right = case.agrees(result)
        if result.outcome == STABLE:
            axes.plot(
                [floor, max(result.drift, floor)], [row, row], color=colour, lw=1.5, alpha=0.4
            )
            axes.plot(max(result.drift, floor), row, "o" if right else "X", color=colour, ms=4)
            axes.plot(case.drift, row, "|", color="black", ms=6)
        else:
            axes.text(2 * floor, row, result.outcome, color=colour, va="center", fontsize=6)
        if not right:
            axes.axhspan(row - 0.5, row + 0.5, color="tab:red", alpha=0.15, lw=0)
    axes.set_xscale("log")
    axes.set(xlim=(floor, 1), ylim=(len(results) - 0.5, -0.5))
    axes.set_yticks(range(len(results)), [case.name for case, _ in results], fontsize=6)
    axes.set_xlabel(
        "drift of the plate's energy over the most that it held (dots; bars: what is allowed)"
    )
    axes.grid(axis="x", alpha=0.3)
    good = sum(case.agrees(result) for case, result in results)
    axes.set_title(f"{good} of {len(results)} cases end as predicted", fontsize=10)
    drawing.savefig(file, dpi=130)
    plt.close(drawing)
