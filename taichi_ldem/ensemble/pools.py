"""Where attempts are made: threads of this process that wait for children, or a Dask cluster."""

from __future__ import annotations

import os
import re
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from taichi_ldem.ensemble.attempt import (
    FAILED,
    GO_ON,
    LOST,
    STOP,
    STOP_NOW,
    STOPPED,
    Outcome,
    Task,
    attempt,
    stop_file,
)
from taichi_ldem.ensemble.standing import Standing
from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene
from taichi_ldem.solver.memory import available_bytes, needed_bytes
from taichi_ldem.storage.durable import write_whole


class Pool(Protocol):
    """Makes attempts; retries are decided elsewhere.

    Attributes:
        local: whether attempts are made on this machine.
    """

    local: bool

    def submit(self, task: Task) -> None:
        """Put an attempt into the queue."""

    def ended(self, seconds: float) -> list[Outcome]:
        """Attempts that ended since the last call; waits up to so many seconds for the first."""

    def stop(self, *, now: bool) -> None:
        """End the children, cleanly or at once; attempts in the queue are not begun."""

    def describe(self) -> str:
        """One line that says where the attempts are made."""

    def close(self) -> None:
        """Release the workers."""


class _Ended:
    """Futures that have ended, each of them handed out once, whatever their number."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Any] = SimpleQueue()

    def watch(self, future: Any) -> None:
        """Hand out a future when it has ended."""
        future.add_done_callback(lambda _: self._queue.put(future))

    def take(self, seconds: float) -> list[Any]:
        """Those that ended since the last call; waits up to so many seconds for the first."""
        found = []
        try:
            found.append(self._queue.get(timeout=seconds))
            while True:
                found.append(self._queue.get_nowait())
        except Empty:
            return found


class LocalPool:
    """Children of this process, one for each of ``workers``, which take attempt after attempt."""

    local = True

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._order = GO_ON
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="member")
        self._tasks: dict[Future[Outcome], Task] = {}
        self._ended = _Ended()
        self._own = threading.local()
        self._standing: list[Standing] = []

    def submit(self, task: Task) -> None:  # noqa: D102
        future = self._threads.submit(self._attempt, task)
        self._tasks[future] = task
        self._ended.watch(future)

    def ended(self, seconds: float) -> list[Outcome]:  # noqa: D102
        done = self._ended.take(seconds)
        return [self._outcome(future, self._tasks.pop(future)) for future in done]

    def _attempt(self, task: Task) -> Outcome:
        """Make an attempt in the process of this thread, where the system can wait for a pipe."""
        if sys.platform == "win32":
            return attempt(task, lambda: self._order)
        if not hasattr(self._own, "standing"):
            self._own.standing = Standing()
            self._standing.append(self._own.standing)
        return attempt(task, lambda: self._order, self._own.standing)

    def _outcome(self, future: Future[Outcome], task: Task) -> Outcome:
        error = future.exception()
        return future.result() if error is None else _raised(task, error)

    def stop(self, *, now: bool) -> None:  # noqa: D102
        self._order = STOP_NOW if now else max(self._order, STOP)

    def describe(self) -> str:  # noqa: D102
        return f"{self.workers} at a time on this machine"

    def close(self) -> None:  # noqa: D102
        self._threads.shutdown(cancel_futures=True)
        for standing in self._standing:
            standing.close()


def _raised(task: Task, error: BaseException) -> Outcome:
    """The outcome of an attempt that could not be made."""
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return Outcome(task.name, task.number, FAILED, reason[:400])


def local_workers(wanted: int | None, threads: int, scenes: list[Scene]) -> int:
    """Number of members to run at a time: as many as cores and memory allow.

    Args:
        wanted: number asked for, or None.
        threads: CPU threads of each member.
        scenes: scenes of all members.

    Raises:
        SceneError: the number asked for does not fit into the memory.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    # for a moment a run holds its fields twice, in NumPy and in Taichi
    free, needed = available_bytes(), max(needed_bytes(scene) for scene in scenes)
    fit = len(scenes) if free is None else max(1, free // needed)
    if wanted is None:
        return int(max(1, min((cores or 1) // threads, fit, len(scenes))))
    if wanted > fit:
        raise SceneError(
            f"--local {wanted}: a member needs about {needed:,} bytes of memory, and {free:,} are "
            f"available: take at most {fit}"
        )
    return min(wanted, len(scenes))


_LOOPBACK = re.compile(r"^inproc://|//(127\.[0-9.]+|localhost|\[::1\])(:|/|$)")
"""Addresses that only programs on the same machine reach."""


class DaskPool:
    """Workers of any Dask scheduler.

    Dask starts a task again when a worker dies. The attempt's record then shows that it had been
    begun, and the task returns as lost. Tasks that Dask gives up are lost, too.
    """

    local = False

    def __init__(self, address: str, ensemble: Path, security: Any = None) -> None:
        """``security``: of Dask, what the scheduler asks for; None: as Dask is configured."""
        try:
            from distributed import Client
        except ImportError:
            raise SceneError("--scheduler needs Dask: pip install 'taichi-ldem[cluster]'") from None
        more = {} if security is None else {"security": security}
        try:
            connect: Any = Client
            where = {"scheduler_file" if Path(address).is_file() else "address": address}
            self._client: Any = connect(**where, **more, timeout=15, set_as_default=False)
            self._address = str(self._client.scheduler.address)
        except (OSError, ValueError, TypeError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise SceneError(f"--scheduler {address}: {reason}") from None
        self._ensemble = ensemble
        self._ended = _Ended()
        self._tasks: dict[Any, Task] = {}

    def submit(self, task: Task) -> None:  # noqa: D102
        # Dask must neither retry nor merge attempts: each is unique
        future = self._client.submit(attempt, task, pure=False, retries=0)
        self._tasks[future] = task
        self._ended.watch(future)

    def ended(self, seconds: float) -> list[Outcome]:  # noqa: D102
        done = self._ended.take(seconds)
        return [self._outcome(future, self._tasks.pop(future)) for future in done]

    def _outcome(self, future: Any, task: Task) -> Outcome:
        if future.status == "finished":
            outcome: Outcome = future.result()
            return outcome
        if future.cancelled():
            return Outcome(task.name, task.number, STOPPED, "the task was cancelled")
        error = future.exception()
        lost = type(error).__name__ == "KilledWorker"
        if lost:
            return Outcome(task.name, task.number, LOST, "its worker ended")
        return _raised(task, error)

    def stop(self, *, now: bool) -> None:  # noqa: D102
        write_whole(stop_file(self._ensemble), b"now\n" if now else b"stop\n")

    def describe(self) -> str:  # noqa: D102
        workers = self._client.nthreads()
        text = f"{len(workers)} workers with {sum(workers.values())} places at {self._address}"
        if not self._address.startswith("tls://") and not _LOOPBACK.search(self._address):
            text += ", without TLS: whoever can reach it can run any code there"
        if "dashboard" in self._client.scheduler_info().get("services", {}):
            text += f", dashboard: {self._client.dashboard_link}"
        return text

    def close(self) -> None:  # noqa: D102
        self._client.close()
