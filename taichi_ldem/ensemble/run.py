"""The command: an ensemble's folder made ready, its members run, its tables and figures written."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console

from taichi_ldem.ensemble import plan as plans
from taichi_ldem.ensemble.attempt import Commands, Outcome, solver_commands
from taichi_ldem.ensemble.conduct import Conductor
from taichi_ldem.ensemble.plan import Plan
from taichi_ldem.ensemble.pools import DaskPool, LocalPool, Pool, local_workers
from taichi_ldem.ensemble.results import read_rows, write_statistics, write_table
from taichi_ldem.errors import SceneError
from taichi_ldem.storage.durable import LOCK
from taichi_ldem.storage.store import RunFolder


def run(
    plan: Plan,
    folder: Path,
    *,
    resume: bool = False,
    local: int | None = None,
    scheduler: str | None = None,
    threads: int = 1,
    timeout: float | None = None,
    quiet: bool = False,
    commands: Commands | None = None,
) -> int:
    """Run an ensemble into a folder.

    Args:
        resume: go on with the ensemble in the folder, which must be the same.
        local: members at a time on this machine. scheduler: address of a Dask scheduler instead.
        threads: of each member. timeout: s of each attempt.
        commands: what a child executes; ``ldem`` by default.

    Returns:
        0; 5 where members did not finish; 130 after Ctrl-C and 143 after SIGTERM.

    Raises:
        SceneError: an option or the folder is refused; no member has been started then.
    """
    console = Console(quiet=quiet, highlight=False, markup=False, soft_wrap=True)
    check(plan, folder, resume=resume)
    workers = 0
    if scheduler is None:
        workers = local_workers(local, threads, [member.scene for member in plan.members])
    RunFolder.check(folder, force=True)
    with RunFolder.held(folder):
        pool: Pool
        pool = LocalPool(workers) if scheduler is None else DaskPool(scheduler, folder.absolute())
        try:
            plans.write_plan(plan, folder, threads)
            by_scenario = commands or solver_commands(plan.members[0].scene.scenario)

            def tables(_outcome: Outcome | None = None) -> None:
                rows = read_rows(plan, folder)
                write_table(plan, folder, rows)
                write_statistics(plan, folder, rows)

            tables()
            conductor = Conductor(
                plan, folder, pool, by_scenario, timeout=timeout, console=console, ended=tables
            )
            code = conductor.run()
        except BaseException:
            pool.stop(now=False)
            raise
        finally:
            pool.close()
        _tell_end(console, folder, conductor, code)
        if code in (0, 5):
            from taichi_ldem.ensemble.report import report

            for file in report(folder):
                console.print(f"wrote {file}")
    return code


def check(plan: Plan, folder: Path, *, resume: bool) -> None:
    """Raise SceneError where ``run`` would refuse the folder; changes nothing."""
    if resume:
        plans.refuse_other_plan(plan, folder)
        return
    if (folder / plans.RECORD).is_file():
        raise SceneError(f"'{folder}' holds an ensemble already; --resume goes on with it")
    if folder.is_dir() and any(path.name != LOCK for path in folder.iterdir()):
        raise SceneError(f"'{folder}' is not empty; give another folder with --out")


def _tell_end(console: Console, folder: Path, conductor: Conductor, code: int) -> None:
    for outcome in conductor.failed:
        print(f"failed: {outcome.name}: {outcome.state}: {outcome.reason}", file=sys.stderr)
    if code not in (0, 5):
        word = "interrupted" if code == 130 else "terminated"
        print(f"{word}; kept in {folder}; the same command with --resume goes on", file=sys.stderr)
    else:
        console.print(f"results in {folder}")


def default_folder(scene_file: Path) -> Path:
    """Where an ensemble of a scene goes."""
    return Path("outputs", f"{scene_file.stem}_ensemble")
