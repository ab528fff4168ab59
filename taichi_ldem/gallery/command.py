"""``ldem gallery``: runs the problems and writes their page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from taichi_ldem.errors import ExitCode
from taichi_ldem.gallery.conduct import Task, conduct, shares, tasks_of
from taichi_ldem.gallery.page import Outcome, judged, write
from taichi_ldem.gallery.registry import NAMES, chosen, problem_of
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.storage.folder import RunFolder


def listed() -> list[str]:
    """A line for each problem: its name and title."""
    width = max(map(len, NAMES))
    return [f"{name:{width}}  {problem_of(name).title}" for name in NAMES]


def run(
    names: Sequence[str],
    out: Path,
    *,
    quick: bool = False,
    workers: int = 0,
    tell: Callable[[str], None] = print,
) -> int:
    """Run problems and write ``gallery.md``; a gallery that was cut continues.

    Args:
        names: of the problems; none: all.
        quick: coarser lattices and fewer runs. They belong into a folder of their own.
        workers: processes at a time; 0: as many as there are cores.
        tell: is called with a line on each run and each problem.

    Returns:
        An exit code: whether all runs have a result. A number that misses its reference is a
        result.

    Raises:
        SceneError: there is no problem of a name.
    """
    problems = {name: problem_of(name) for name in chosen(names)}
    count = sum(len(problem.wanted(quick=quick)) for problem in problems.values())
    processes, threads = shares(workers, count)
    with RunFolder.held(out):
        tasks = {
            name: tasks_of(problem.wanted(quick=quick), out / name, quick=quick, threads=threads)
            for name, problem in problems.items()
        }
        failed = conduct([task for some in tasks.values() for task in some], processes, tell)
        outcomes = [_outcome(name, problem_tasks, failed) for name, problem_tasks in tasks.items()]
        page = write(outcomes, out, quick=quick)
    width = max(map(len, problems))
    for outcome in outcomes:
        tell(f"{outcome.name:{width}}  {outcome.verdict}")
    tell(str(page))
    return ExitCode.MEMBERS_MISSING if failed else ExitCode.DONE


def _outcome(name: str, tasks: Sequence[Task], failed: dict[str, str]) -> Outcome:
    own = {key: why for key, why in failed.items() if key.startswith(f"{name}/")}
    runs = {
        task.run.name: LoadedRun.read(RunFolder(task.folder))
        for task in tasks
        if f"{name}/{task.folder.name}" not in own
    }
    return judged(name, problem_of(name), runs, own)
