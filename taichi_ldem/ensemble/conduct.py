"""Runs an ensemble: hands attempts to a pool, decides on retries, tells how far it has come."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

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
    read_attempts,
    stop_file,
    write_outcome,
)
from taichi_ldem.ensemble.plan import MEMBERS, Member, Plan
from taichi_ldem.ensemble.pools import Pool
from taichi_ldem.storage.store import RunFolder

RETRIES = 1
"""How often a member that did not finish is tried again. The only place that does."""
STATUS_INTERVAL = 60.0
"""Seconds between two lines about the progress where there is no terminal."""
REFUSED = 2
"""Exit code of a resume that is refused, as when all checkpoints are damaged."""
UNFINISHED = 5
"""Exit code of an ensemble some of whose members did not finish."""


class Conductor:
    """Takes every member to its end, or to the end of its retries.

    Args:
        commands: what a child executes. timeout: s of one attempt.
        ended: called after each attempt that ended, with the outcome.
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
        self.timeout, self.ended = timeout, ended
        self.console = console or Console(quiet=True)
        self.tries: dict[str, int] = {}
        self.open: set[str] = set()
        self.failed: list[Outcome] = []
        self.signal: int | None = None

    def run(self) -> int:
        """Run what is not finished; 0, 5 where a member did not finish, 130 or 143 on a signal."""
        stop_file(self.folder).unlink(missing_ok=True)
        waiting = [m for m in self.plan.members if not is_finished(self.folder / MEMBERS / m.name)]
        told = len(self.plan.members) - len(waiting)
        self.console.print(
            f"{len(self.plan.members)} members, {told} finished already; {self.pool.describe()}"
        )
        for member in waiting:
            self._submit(member.name)
        with self._listening(), self._progress() as tell:
            while self.open:
                for outcome in self.pool.ended(1.0):
                    tell(self._take(outcome))
                tell(None)
        if self.signal is not None:
            return 128 + self.signal
        return UNFINISHED if self.failed else 0

    def _submit(self, name: str) -> None:
        earlier = read_attempts(self.folder, name)
        number = earlier[-1].number + 1 if earlier else 1
        refused = bool(earlier) and (earlier[-1].how, earlier[-1].exit_code) == ("resumed", REFUSED)
        self.tries[name] = self.tries.get(name, 0) + 1
        self.open.add(name)
        self.pool.submit(Task(str(self.folder), name, number, self.commands, self.timeout, refused))

    def _take(self, outcome: Outcome) -> str:
        """Note an outcome, try again where that is due; a line on it."""
        name = outcome.name
        self.open.discard(name)
        if outcome.state in (LOST, FAILED):  # what the attempt itself could not record
            outcome = self._recorded(outcome)
        self.ended(outcome)
        if outcome.state == FINISHED:
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
        if known is not None:  # where it had been begun
            told = {"begun": known.begun, "host": known.host, "process": known.process}
            outcome = Outcome(**{**vars(outcome), **told})
        write_outcome(self.folder, outcome)
        return outcome

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        """SIGINT and SIGTERM end the children cleanly, a second one at once."""

        def note(number: int, _frame: Any) -> None:
            again = self.signal is not None
            self.signal = self.signal or number
            self.pool.stop(now=again)

        if threading.current_thread() is not threading.main_thread():
            yield
            return
        old = {n: signal.signal(n, note) for n in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in old.items():
                signal.signal(number, handler)

    # --- progress ---------------------------------------------------------------------------------

    @contextlib.contextmanager
    def _progress(self) -> Iterator[Callable[[str | None], None]]:
        """A function that prints a line on an outcome and keeps the state up to date."""
        begun, first = time.monotonic(), self.done_share()
        if self.console.is_terminal and not self.console.quiet:
            columns = (TextColumn("{task.description}"), BarColumn())
            with Progress(*columns, console=self.console) as bar:
                task = bar.add_task(self._text(begun, first), total=1.0)
                yield lambda line: self._tell_bar(bar, task, line, begun, first)
            return
        told = begun

        def tell(line: str | None) -> None:
            nonlocal told
            if line is None and time.monotonic() - told < STATUS_INTERVAL:
                return
            told = time.monotonic()
            text = self._text(begun, first)
            self.console.print(text if line is None else f"{line} ({text})")

        yield tell

    def _tell_bar(
        self, bar: Progress, task: TaskID, line: str | None, begun: float, first: float
    ) -> None:
        if line is not None:
            self.console.print(line)
        bar.update(task, description=self._text(begun, first), completed=self.done_share())

    def _text(self, begun: float, first: float) -> str:
        share = [self._share(member) for member in self.plan.members]
        whole, gone = sum(share) / len(share), time.monotonic() - begun
        done = sum(part == 1.0 for part in share)
        text = f"{done} of {len(share)} done, {len(self.failed)} failed"
        if self.signal is not None:
            return f"{text}, stopping"
        if self.open and whole > first:
            text += f", ETA {duration(gone * (1 - whole) / (whole - first))}"
        return text

    def done_share(self) -> float:
        """How much of all members' simulated time is done, 0 to 1."""
        members = self.plan.members
        return sum(self._share(member) for member in members) / len(members)

    def _share(self, member: Member) -> float:
        folder = self.folder / MEMBERS / member.name
        if is_finished(folder):
            return 1.0
        reached = reached_time(RunFolder(folder).history_file)
        return min(0.999, reached / member.scene.solver.duration)


def reached_time(history_file: Path) -> float:
    """Time of the last whole row of a history, s; 0 without one."""
    with contextlib.suppress(OSError, ValueError):
        with open(history_file, "rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - 4096))
            lines = file.read().split(b"\n")[:-1]
        return float(lines[-1].split(b",")[0])
    return 0.0


def duration(seconds: float) -> str:
    """A time as a person says it."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60:02d} min"
