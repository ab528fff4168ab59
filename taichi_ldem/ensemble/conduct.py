"""Runs an ensemble: hands attempts to a pool, decides on retries, and reports progress."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from taichi_ldem.ensemble.attempt import (
    FAILED,
    FINISHED,
    LOST,
    RUNNING,
    STOPPED,
    Commands,
    Outcome,
    Task,
    is_finished,
    next_number,
    read_attempts,
    stop_file,
    write_outcome,
)
from taichi_ldem.ensemble.pace import Paced
from taichi_ldem.ensemble.plan import MEMBERS, Member, Plan
from taichi_ldem.ensemble.pools import Pool
from taichi_ldem.errors import ExitCode
from taichi_ldem.reading import refuse_special
from taichi_ldem.scenarios.interrupts import signals_call
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.place import identity, refuse_moved

RETRIES = 1
"""Number of further attempts at a member that did not finish. Nothing else retries."""
STATUS_INTERVAL = 60.0
"""Interval between two lines of progress where there is no terminal, s."""


class Conductor:
    """Runs every member until it has finished or has no retries left.

    Args:
        plan: the members.
        folder: the ensemble's folder.
        pool: where attempts are made.
        commands: what a child executes.
        timeout: longest time of one attempt, s; None: no limit.
        console: where progress is printed; None: nowhere.
        ended: called with the outcome of each attempt that has ended.
    """

    def __init__(
        self,
        plan: Plan,
        folder: Path,
        pool: Pool,
        commands: Commands,
        *,
        timeout: float | None = None,
        console: Console | None = None,
        ended: Callable[[Outcome], None] = lambda outcome: None,
    ) -> None:
        self.plan, self.folder, self.pool, self.commands = plan, folder.absolute(), pool, commands
        self.identity = identity(self.folder)
        self.timeout, self.ended = timeout, ended
        self.console = console or Console(quiet=True)
        self.tries: dict[str, int] = {}
        self.open: set[str] = set()
        self.failed: list[Outcome] = []
        self.signal: int | None = None
        self.left: dict[str, Member] = {}
        self._begun = 0.0
        self._look = Paced(self._add_up)

    def run(self) -> int:
        """Run what is not finished.

        Returns:
            DONE, MEMBERS_MISSING, INTERRUPTED, TERMINATED or HUNG_UP of ``ExitCode``.

        Raises:
            OSError: another folder has taken the place of the ensemble's. Members that are running
                have to be ended; they keep their own folders.
        """
        stop_file(self.folder).unlink(missing_ok=True)
        folders = self.folder / MEMBERS
        self.left = {m.name: m for m in self.plan.members if not is_finished(folders / m.name)}
        count = len(self.plan.members)
        done = count - len(self.left)
        self.console.print(f"{count} members, {done} finished already; {self.pool.describe()}")
        with signals_call(self._stop), self._progress() as show:
            for name in self.left:
                self._submit(name)
            while self.open:
                refuse_moved(self.folder)
                for outcome in self.pool.ended(1.0):
                    show(self._take(outcome))
                show(None)
        if self.signal is not None:
            return 128 + self.signal
        return ExitCode.MEMBERS_MISSING if self.failed else ExitCode.DONE

    def _submit(self, name: str) -> None:
        earlier = read_attempts(self.folder, name)
        number = next_number(self.folder, name)
        # a resume is refused e.g. where all checkpoints, or the scene, are damaged
        last = (earlier[-1].how, earlier[-1].exit_code) if earlier else ("", None)
        refused = last in (("resumed", ExitCode.BAD_INPUT), ("resumed", ExitCode.FILE_ERROR))
        self.tries[name] = self.tries.get(name, 0) + 1
        self.open.add(name)
        here = self.identity if self.pool.local else None
        task = Task(str(self.folder), name, number, self.commands, self.timeout, refused, here)
        self.pool.submit(task)

    def _take(self, outcome: Outcome) -> str:
        """Note an outcome and try again where that is due; returns a line about it."""
        name = outcome.name
        self.open.discard(name)
        if outcome.state in (LOST, FAILED):  # what the attempt itself could not record
            outcome = self._recorded(outcome)
        self.ended(outcome)
        if outcome.state == FINISHED:
            self.left.pop(name, None)
            return f"{name}: finished, {outcome.seconds:.0f} s"
        line = f"{name}: attempt {outcome.number} {outcome.state}: {outcome.reason}"
        if self.signal is not None:
            return line
        if self.tries[name] <= RETRIES and outcome.state != STOPPED:
            self._submit(name)
            return f"{line}; tried again"
        self.failed.append(outcome)
        return f"{line}; given up"

    def _recorded(self, outcome: Outcome) -> Outcome:
        written = {o.number: o for o in read_attempts(self.folder, outcome.name)}
        known = written.get(outcome.number)
        if known is not None and known.state != RUNNING:
            return known
        if known is not None:  # keep when and where it was begun
            begun = {"begun": known.begun, "host": known.host, "process": known.process}
            outcome = Outcome(**{**vars(outcome), **begun})
        write_outcome(self.folder, outcome)
        return outcome

    def _stop(self, number: int) -> None:
        """End the children on a signal, cleanly on the first and at once on a second."""
        again = self.signal is not None
        self.signal = self.signal or number
        self.pool.stop(now=again)

    # --- progress ---------------------------------------------------------------------------------

    @contextlib.contextmanager
    def _progress(self) -> Iterator[Callable[[str | None], None]]:
        """A function that prints a line about an outcome and updates the progress."""
        self._look()
        begun, first = time.monotonic(), self.done_share()
        if self.console.is_terminal and not self.console.quiet:
            columns = (TextColumn("{task.description}"), BarColumn())
            with Progress(*columns, console=self.console) as bar:
                task = bar.add_task(self._text(begun, first), total=1.0)
                yield lambda line: self._update_bar(bar, task, line, begun, first)
            return
        printed = begun

        def show(line: str | None) -> None:
            nonlocal printed
            if line is None and time.monotonic() - printed < STATUS_INTERVAL:
                return
            printed = time.monotonic()
            text = self._text(begun, first)
            self.console.print(text if line is None else f"{line} ({text})")

        yield show

    def _update_bar(
        self, bar: Progress, task: TaskID, line: str | None, begun: float, first: float
    ) -> None:
        if line is not None:
            self.console.print(line)
        bar.update(task, description=self._text(begun, first), completed=self.done_share())

    def _text(self, begun: float, first: float) -> str:
        self._look()
        whole, elapsed = self.done_share(), time.monotonic() - begun
        count = len(self.plan.members)
        text = f"{count - len(self.left)} of {count} done, {len(self.failed)} failed"
        if self.signal is not None:
            return f"{text}, stopping"
        if self.open and whole > first:
            text += f", ETA {duration(elapsed * (1 - whole) / (whole - first))}"
        return text

    def done_share(self) -> float:
        """Share of all members' simulated time that is done, 0 to 1, as far as it is known."""
        count = len(self.plan.members)
        return (count - len(self.left) + min(self._begun, len(self.left))) / count

    def _add_up(self) -> None:
        """Look at how far the members that have begun have come."""
        self._begun = sum(map(self._share, self.left.values()))

    def _share(self, member: Member) -> float:
        folder = self.folder / MEMBERS / member.name
        reached = reached_time(RunFolder(folder).history_file)
        return min(0.999, reached / member.scene.solver.duration)


def reached_time(history_file: Path) -> float:
    """Time of the last whole row of a history, s; 0 without one."""
    with contextlib.suppress(OSError, ValueError):
        refuse_special(history_file)
        with open(history_file, "rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - 4096))
            lines = file.read().split(b"\n")[:-1]
        return float(lines[-1].split(b",")[0])
    return 0.0


def duration(seconds: float) -> str:
    """A time in words, e.g. "10 min"."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60:02d} min"
