"""A whole ensemble: the folder is prepared, members are run, tables and figures are written."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from taichi_ldem.ensemble import plan as plans
from taichi_ldem.ensemble.attempt import Commands, Outcome, solver_commands
from taichi_ldem.ensemble.conduct import Conductor
from taichi_ldem.ensemble.pace import Paced
from taichi_ldem.ensemble.plan import Plan
from taichi_ldem.ensemble.pools import DaskPool, LocalPool, Pool, local_workers
from taichi_ldem.ensemble.results import read_row, read_rows, write_tables
from taichi_ldem.errors import ExitCode, SceneError
from taichi_ldem.scenarios.interrupts import WORDS
from taichi_ldem.scenarios.progress import make_console
from taichi_ldem.scene import Scene
from taichi_ldem.solver.memory import needed_bytes
from taichi_ldem.storage.durable import LOCK
from taichi_ldem.storage.folder import RunFolder


@dataclass(frozen=True)
class How:
    """How members are run.

    Attributes:
        local: number of members at a time on this machine; None: as many as cores allow.
        scheduler: address of a Dask scheduler to use instead.
        slurm: number of SLURM jobs to use instead.
        threads: CPU threads of each member.
        timeout: longest time of an attempt, s; None: no limit.
        figures: whether each member draws its figures and pictures.
    """

    local: int | None = None
    scheduler: str | None = None
    slurm: int | None = None
    threads: int = 1
    timeout: float | None = None
    figures: bool = False


ENDED = (ExitCode.DONE, ExitCode.MEMBERS_MISSING)
"""Exit codes after which every member has finished or has been given up."""


def run(
    plan: Plan,
    folder: Path,
    how: How | None = None,
    *,
    resume: bool = False,
    quiet: bool = False,
    commands: Commands | None = None,
) -> int:
    """Run an ensemble into a folder.

    Args:
        plan: its members.
        folder: where it goes.
        how: how its members are run.
        resume: continue the ensemble in the folder, which must be the same.
        quiet: print nothing on success.
        commands: what a child executes; ``ldem`` by default.

    Returns:
        DONE, MEMBERS_MISSING, INTERRUPTED (Ctrl-C), TERMINATED (SIGTERM) or HUNG_UP (SIGHUP) of
        ``ExitCode``.

    Raises:
        SceneError: an option or the folder is refused; no member has been started then.
    """
    console = make_console(quiet)
    how = how or How()
    check(plan, folder, resume=resume)
    scenes = [member.scene for member in plan.members]
    elsewhere = how.scheduler or how.slurm
    workers = 0 if elsewhere else local_workers(how.local, how.threads, scenes)
    RunFolder.check(folder, force=True)
    with RunFolder.held(folder):
        pool = _pool(how, folder.absolute(), workers, scenes)
        try:
            plans.write_plan(plan, folder, how.threads)
            tables = Tables(plan, folder)
            conductor = Conductor(
                plan,
                folder,
                pool,
                commands or solver_commands(plan.members[0].scene.scenario, figures=how.figures),
                timeout=how.timeout,
                console=console,
                ended=tables.note,
            )
            code = conductor.run()
            tables.write()
        except BaseException:
            pool.stop(now=False)
            raise
        finally:
            pool.close()
        _tell_end(console, folder, conductor, code)
    return code


def _pool(how: How, folder: Path, workers: int, scenes: list[Scene]) -> Pool:
    """Where the members are run."""
    if how.scheduler:
        return DaskPool(how.scheduler, folder)
    if how.slurm:
        from taichi_ldem.ensemble.slurm import SlurmPool

        return SlurmPool(how.slurm, folder, how.threads, max(map(needed_bytes, scenes)))
    return LocalPool(workers)


class Tables:
    """The tables of an ensemble, kept up to date while its members run.

    Only the member whose attempt has ended is read again, so that the cost of an attempt does not
    grow with the number of members.
    """

    def __init__(self, plan: Plan, folder: Path) -> None:
        self._plan, self._folder = plan, folder
        self._members = {member.name: member for member in plan.members}
        self._rows = {row.member.name: row for row in read_rows(plan, folder)}
        self._write = Paced(self.write)
        self._write()

    def note(self, outcome: Outcome) -> None:
        """Take up how an attempt ended, and write the tables where they do not take too long."""
        member = self._members[outcome.name]
        self._rows[member.name] = read_row(member, self._folder)
        self._write()

    def write(self) -> None:
        """Write the tables."""
        write_tables(self._plan, self._folder, list(self._rows.values()))


def check(plan: Plan, folder: Path, *, resume: bool) -> None:
    """Check that ``run`` accepts the folder; nothing is changed.

    Raises:
        SceneError: it does not.
    """
    if resume:
        plans.refuse_other_plan(plan, folder)
        return
    if (folder / plans.RECORD).exists():
        raise SceneError(f"'{folder}' holds an ensemble already; --resume continues it")
    if folder.is_dir() and any(path.name != LOCK for path in folder.iterdir()):
        raise SceneError(f"'{folder}' is not empty; give another folder with --out")


def _tell_end(console: Console, folder: Path, conductor: Conductor, code: int) -> None:
    for outcome in conductor.failed:
        print(f"failed: {outcome.name}: {outcome.state}: {outcome.reason}", file=sys.stderr)
    if code not in ENDED:
        word = WORDS[ExitCode(code)]
        print(
            f"{word}; {folder} is kept; the same command with --resume continues", file=sys.stderr
        )
    else:
        console.print(f"results in {folder}")
        from taichi_ldem.ensemble.report import report

        for file in report(folder):
            console.print(f"wrote {file}")


def default_folder(scene_file: Path) -> Path:
    """The default folder of an ensemble of a scene."""
    return Path("outputs", f"{scene_file.stem}_ensemble")
