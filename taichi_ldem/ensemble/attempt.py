"""One attempt at one member: claims it, starts one child, watches it, and records how it ended.

A worker executes this in a thread here or on another machine, and needs only the ensemble's folder.
An attempt is claimed by creating its record, which only one process can do. A scheduler that starts
the attempt a second time, because a worker died, therefore does not run the member again: only
``conduct`` decides on retries.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Protocol

from taichi_ldem.ensemble.plan import ATTEMPTS, MEMBERS, SCENES
from taichi_ldem.ensemble.standing import Standing
from taichi_ldem.errors import SceneError
from taichi_ldem.reading import read_object
from taichi_ldem.scenarios.child import tied
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.storage.durable import refuse_locked, write_whole
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.place import identity

POLL = 0.2
"""Interval at which a child is checked, s."""
STOP_POLL = 1.0
"""Interval at which the order to stop is checked, s; it may lie on a network file system."""
GRACE = 90.0
"""Time that a child gets to write its checkpoint before it is killed, s."""
PATIENCE = 120.0
"""Time that an attempt waits for a run folder that another process still holds, s."""

FINISHED, FAILED, KILLED, TIMED_OUT, LOST, STOPPED, RUNNING = (
    "finished",
    "failed",
    "killed",
    "timed out",
    "lost",
    "stopped",
    "running",
)
GO_ON, STOP, STOP_NOW = 0, 1, 2
MOVED = "the ensemble's folder was renamed or replaced"

PYTHON, FOLDER, SCENE = "{python}", "{folder}", "{scene}"
"""Placeholders in a command for the worker's interpreter, the run folder and the scene."""


@dataclass(frozen=True)
class Commands:
    """The commands that a child executes; they contain the placeholders above.

    Attributes:
        begin: starts the run from its beginning.
        resume: resumes it from its checkpoint.
    """

    begin: tuple[str, ...]
    resume: tuple[str, ...]


LDEM = (PYTHON, "-m", "taichi_ldem.cli")
"""The beginning of a command that a standing process can execute."""


def solver_commands(scenario: str, *, figures: bool = False) -> Commands:
    """The commands of ``ldem`` for a scenario of the registry.

    Args:
        figures: whether each run draws its figures and pictures.
    """
    without = () if figures else ("--no-figures",)
    begin = (*LDEM, SCENARIOS[scenario].command, SCENE, "--out", FOLDER, "--force", *without)
    return Commands(begin, (*LDEM, "resume", FOLDER, *without))


@dataclass(frozen=True)
class Task:
    """An attempt to be made.

    Attributes:
        ensemble: the ensemble's folder, absolute.
        name: the member's name.
        number: the attempt's number, from 1.
        timeout: longest time, s; None: no limit.
        afresh: begin anew even where there is a checkpoint.
        identity: of the ensemble's folder, see ``place.identity``; None: it is not compared, as
            another machine may number its devices otherwise.
    """

    ensemble: str
    name: str
    number: int
    commands: Commands
    timeout: float | None = None
    afresh: bool = False
    identity: tuple[int, int] | None = None

    def moved(self) -> bool:
        """Whether another folder has taken the place of the ensemble's."""
        with contextlib.suppress(OSError):
            return self.identity not in (None, identity(Path(self.ensemble)))
        return self.identity is not None

    @property
    def folder(self) -> Path:
        """The run folder."""
        return Path(self.ensemble, MEMBERS, self.name)

    def record_file(self, ending: str = "json") -> Path:
        """The attempt's record; with "out" and "err" the output of its child."""
        return record_file(Path(self.ensemble), self.name, self.number, ending)


@dataclass(frozen=True)
class Outcome:
    """How an attempt ended, or that it is running.

    Attributes:
        reason: one line, empty where the member finished.
        how: "begun" or "resumed", or empty where no child was started.
        exit_code: the child's; if negative, the number of the signal that ended it.
        last_error: the last line that the child wrote to stderr.
        seconds: duration of the attempt, s.
    """

    name: str
    number: int
    state: str
    reason: str = ""
    how: str = ""
    exit_code: int | None = None
    last_error: str = ""
    begun: str = ""
    seconds: float = 0.0
    host: str = ""
    process: int = 0


Stop = Callable[[], int]
"""Returns GO_ON, STOP (end the child cleanly) or STOP_NOW (kill it)."""


def is_finished(folder: Path) -> bool:
    """Whether a run folder holds a finished run."""
    return RunFolder(folder).summary_file.is_file()


def record_file(ensemble: Path, name: str, number: int, ending: str = "json") -> Path:
    """The record of an attempt; with "out" and "err" the output of its child."""
    return Path(ensemble, ATTEMPTS, f"{name}.{number}.{ending}")


def next_number(ensemble: Path, name: str) -> int:
    """The number of the next attempt at a member."""
    return next(n for n in itertools.count(1) if not record_file(ensemble, name, n).exists())


def read_attempts(ensemble: Path, name: str) -> list[Outcome]:
    """The recorded attempts at a member, in order; a record that cannot be read is left out."""
    found = []
    for number in range(1, next_number(ensemble, name)):
        with contextlib.suppress(SceneError):
            outcome = _outcome(read_object(record_file(ensemble, name, number)))
            if outcome is not None and (outcome.name, outcome.number) == (name, number):
                found.append(outcome)
    return found


_KINDS: dict[str, tuple[type, ...]] = {
    "name": (str,),
    "number": (int,),
    "state": (str,),
    "reason": (str,),
    "how": (str,),
    "exit_code": (int, type(None)),
    "last_error": (str,),
    "begun": (str,),
    "seconds": (int, float),
    "host": (str,),
    "process": (int,),
}
"""Types of an outcome's values in its record."""


def _outcome(record: dict[str, Any]) -> Outcome | None:
    """The outcome that a record holds; None where something else stands there."""
    whole = {"name", "number", "state"} <= record.keys() <= _KINDS.keys()
    if whole and all(type(value) in _KINDS[key] for key, value in record.items()):
        return Outcome(**record)
    return None


def write_outcome(ensemble: Path, outcome: Outcome) -> None:
    """Record how an attempt ended."""
    file = record_file(ensemble, outcome.name, outcome.number)
    file.parent.mkdir(exist_ok=True)  # an attempt may have failed before it made the folder
    write_whole(file, (json.dumps(asdict(outcome), indent=2) + "\n").encode())


def stop_file(ensemble: Path) -> Path:
    """The file that orders workers on other machines to stop."""
    return Path(ensemble, "stop")


def ordered_by_file(ensemble: Path) -> Stop:
    """A function that reads the order in the stop file."""

    def stop() -> int:
        try:
            return STOP_NOW if "now" in stop_file(ensemble).read_text() else STOP
        except OSError:
            return GO_ON

    return stop


def attempt(task: Task, stop: Stop | None = None, standing: Standing | None = None) -> Outcome:
    """Make an attempt. Whatever the member does, no exception is raised.

    Args:
        task: the attempt to make.
        stop: called once a second; by default it reads the ensemble's stop file.
        standing: the worker's process for all its attempts; None: a child for each.
    """
    begun = time.monotonic()
    stop = stop or ordered_by_file(Path(task.ensemble))
    running = _running(task)
    if task.moved():
        return _end(running, begun, FAILED, MOVED)
    if is_finished(task.folder):
        return _end(running, begun, FINISHED)
    if not Path(task.ensemble).is_dir():
        why = f"'{task.ensemble}' is not there on {running.host}: workers need the same files"
        return _end(running, begun, FAILED, why)
    try:
        if stop():
            return _end(running, begun, STOPPED, "not started")
        if not _claim(task, running):
            return _end(running, begun, LOST, "its worker ended")
        outcome = _run(task, stop, running, begun, standing)
        if task.moved():  # the record would go to another ensemble
            return _end(running, begun, FAILED, MOVED)
        write_outcome(Path(task.ensemble), outcome)
    except OSError as error:
        return _end(running, begun, FAILED, str(error))
    return outcome


def _running(task: Task) -> Outcome:
    now = datetime.now(timezone.utc).isoformat(timespec="seconds")
    host, process = socket.gethostname(), os.getpid()
    return Outcome(task.name, task.number, RUNNING, begun=now, host=host, process=process)


def _end(running: Outcome, begun: float, state: str, reason: str = "", **more: Any) -> Outcome:
    ended = {"state": state, "reason": reason, "seconds": round(time.monotonic() - begun, 3)}
    return Outcome(**{**asdict(running), **ended, **more})


def _claim(task: Task, running: Outcome) -> bool:
    """Create the attempt's record; False where it exists already."""
    task.record_file().parent.mkdir(exist_ok=True)
    try:
        with open(task.record_file(), "x", encoding="utf-8") as file:
            file.write(json.dumps(asdict(running), indent=2) + "\n")
    except FileExistsError:
        return False
    return True


def _run(
    task: Task, stop: Stop, running: Outcome, begun: float, standing: Standing | None
) -> Outcome:
    held = _wait_until_free(task, stop)
    if is_finished(task.folder):
        return _end(running, begun, FINISHED)
    if held:
        return _end(running, begun, STOPPED if stop() else FAILED, held)
    task.folder.mkdir(parents=True, exist_ok=True)
    how = "resumed" if RunFolder(task.folder).has_checkpoint and not task.afresh else "begun"
    command = task.commands.resume if how == "resumed" else task.commands.begin
    child = _start(command, task, standing)
    try:
        cut = _watch(child, task, stop)
    except BaseException:
        _signal(child, signal.SIGKILL)
        raise
    code = child.returncode
    last = _last_line(task.record_file("err"))
    child_end: dict[str, Any] = {"how": how, "exit_code": code, "last_error": last}
    if is_finished(task.folder):
        return _end(running, begun, FINISHED, **child_end)
    if cut:
        return _end(running, begun, *cut, **child_end)
    if code < 0:
        return _end(running, begun, KILLED, f"ended by {signal.Signals(-code).name}", **child_end)
    if code == 0:
        return _end(running, begun, FAILED, "wrote no summary.json", **child_end)
    return _end(running, begun, FAILED, last or f"exit code {code}", **child_end)


def _wait_until_free(task: Task, stop: Stop) -> str:
    """Wait until no process holds the run folder; returns why it is still held, or nothing."""
    until = time.monotonic() + PATIENCE
    while True:
        try:
            refuse_locked(task.folder)
        except SceneError as error:
            if stop() or time.monotonic() > until or is_finished(task.folder):
                return str(error)
            time.sleep(POLL)
        else:
            return ""


def _filled(command: Sequence[str], task: Task) -> list[str]:
    scene = Path(task.ensemble, SCENES, f"{task.name}.toml")
    words = {PYTHON: sys.executable, FOLDER: str(task.folder), SCENE: str(scene)}
    return [words.get(word, word) for word in command]


class Child(Protocol):
    """A command that is being executed, as ``subprocess.Popen`` has it."""

    returncode: Any

    @property
    def pid(self) -> int:
        """Number of its process, which leads a group of its own."""

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end."""

    def send_signal(self, number: int) -> None:
        """Send a signal to it."""


def _start(command: tuple[str, ...], task: Task, standing: Standing | None) -> Child:
    """Have a command executed, by the standing process where there is one and it can."""
    words = _filled(command, task)
    files = task.record_file("out"), task.record_file("err")
    for file in files:
        file.write_bytes(b"")
    if standing is not None and command[: len(LDEM)] == LDEM:
        return standing.order(words[len(LDEM) :], *files)
    with open(files[0], "wb") as out, open(files[1], "wb") as errors:
        # in a process group of its own, so that Ctrl-C in a terminal spares it
        return subprocess.Popen(
            tied(words),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=errors,
            start_new_session=True,
        )


def _watch(child: Child, task: Task, stop: Stop) -> tuple[str, str] | None:
    """Wait for a child's end. Where it has to be stopped, return the state and the reason."""
    begun = looked = time.monotonic()
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(POLL)
            return None
        now = time.monotonic()
        if task.timeout is not None and now - begun > task.timeout:
            _end_child(child, stop)
            return TIMED_OUT, f"took longer than {task.timeout:g} s"
        if now - looked >= STOP_POLL:
            looked = now
            if stop():
                _end_child(child, stop)
                return STOPPED, "the ensemble was stopped"


def _end_child(child: Child, stop: Stop) -> None:
    """Let a child write a checkpoint and end; kill it where it does not, or on STOP_NOW."""
    _signal(child, signal.SIGTERM)
    until = time.monotonic() + GRACE
    while time.monotonic() < until and stop() < STOP_NOW:
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(POLL)
            return
    _signal(child, signal.SIGKILL)
    child.wait()


def _signal(child: Child, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(child.pid, number)
        else:
            child.send_signal(number)


def _last_line(file: Path) -> str:
    with contextlib.suppress(OSError):
        with open(file, "rb") as text:
            text.seek(max(0, os.fstat(text.fileno()).st_size - 4096))
            lines = text.read().decode("utf-8", "replace").split("\n")
        kept = [line.strip() for line in lines if line.strip()]
        return kept[-1][:400] if kept else ""
    return ""
