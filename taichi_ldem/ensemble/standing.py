"""A child that makes one attempt after the other, so that only the first one pays for its start.

Members of an ensemble that differ in numbers only (seeds, speeds, material) need the same kernels.
Their process keeps its simulation and puts it back to t = 0 for the next one. A member that needs
other kernels gets a new process. A process that is killed takes nothing but its own member's time
since the last checkpoint with it.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from taichi_ldem.scenarios.child import tied

SERVER = (sys.executable, "-m", "taichi_ldem.cli.standing")
OTHER = "other"
"""The answer to an order that needs other kernels than those of the process."""

LOST = 1
"""Exit code of an order whose process ended without an answer and without an error."""

SIGNALLED = 128
"""Exit codes from here on mean that a signal has ended the command, and the process ends, too."""


class Standing:
    """The process of one worker, started when it is first needed."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def order(self, arguments: Sequence[str], out: Path, err: Path) -> Ordered:
        """Have the arguments of ``ldem`` executed; what it prints is appended to two files."""
        process = self._process
        if process is None or process.poll() is not None:
            process = self.renew(err)
        line = json.dumps({"arguments": list(arguments), "out": str(out), "err": str(err)})
        return Ordered(self, process, line.encode() + b"\n", err)

    def renew(self, err: Path) -> subprocess.Popen[bytes]:
        """A new process in place of the present one, if there is one.

        It has a group of its own, so that Ctrl-C in a terminal spares it.
        """
        self.close()
        with open(err, "ab") as errors:
            self._process = subprocess.Popen(
                tied(SERVER),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                start_new_session=True,
            )
        return self._process

    def close(self) -> None:
        """End the process, which executes nothing."""
        if self._process is None:
            return
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with contextlib.suppress(OSError):
                pipe.close()
        self._process.wait()
        self._process = None


class Ordered:
    """A command that a standing process executes; waited for as a ``subprocess.Popen`` is.

    Attributes:
        returncode: its exit code, once ``wait`` has returned; that of the process, where it ended.
    """

    def __init__(
        self, standing: Standing, process: subprocess.Popen[bytes], line: bytes, err: Path
    ) -> None:
        self._standing, self._process, self._line, self._err = standing, process, line, err
        self.returncode = 0
        self._send()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def send_signal(self, number: int) -> None:
        """Send a signal to the process."""
        self._process.send_signal(number)

    def wait(self, timeout: float | None = None) -> int:
        """The exit code.

        Raises:
            subprocess.TimeoutExpired: it has not ended within so many seconds.
        """
        until = None if timeout is None else time.monotonic() + timeout
        while True:
            answer = self._answer(None if until is None else max(0.0, until - time.monotonic()))
            if answer != OTHER:
                break
            self._process = self._standing.renew(self._err)
            self._send()
        if answer == "":  # it has ended, though not by itself
            self.returncode = self._process.wait() or LOST
        else:
            self.returncode = int(answer)
        if not 0 <= self.returncode < SIGNALLED or self.returncode == LOST:
            self._standing.close()  # it is about to end, and must not be given the next order
        return self.returncode

    def _send(self) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        with contextlib.suppress(OSError):  # it has ended; its answer will be none
            os.write(pipe.fileno(), self._line)

    def _answer(self, timeout: float | None) -> str:
        """The next answer; empty where the process has ended."""
        pipe = self._process.stdout
        assert pipe is not None
        if not select.select([pipe], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(self._process.args, timeout or 0.0)
        return pipe.readline().decode().strip()
