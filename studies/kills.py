"""Compares a run that is cut off and resumed many times with one that is never stopped.

At random moments of set-up and stepping the run gets SIGKILL, SIGTERM or SIGHUP, loses whoever read
its output (a broken pipe), or has its folder renamed while another run's is put in its place. After
the last two it has to go on, and is stopped by SIGTERM a little later. At the end history, fields
and broken bars must equal those of the uninterrupted run to the last bit, and nothing may have been
written into the other run's folder:

    python -m studies.kills SCENE.toml outputs/kills --kills 24 --pipes 9 --renames 9
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from taichi_ldem.storage.compare import differences
from taichi_ldem.storage.folder import OF_EVERY_RUN, RunFolder

INTERVAL = 0.3
"""Seconds of wall time between two checkpoints."""

KILL, TERM, HANG_UP, PIPE, RENAME = "SIGKILL", "SIGTERM", "SIGHUP", "broken pipe", "rename"

EXPECTED = {
    KILL: {-signal.SIGKILL},
    TERM: {143, -signal.SIGTERM},
    HANG_UP: {129, -signal.SIGHUP},
    PIPE: {143, -signal.SIGTERM},
    RENAME: {143, -signal.SIGTERM},
}
"""Exit codes; during the set-up, before there is anything to keep, a signal ends the process."""

OTHERS = b"another run's"
"""What stands in the files of the folder that takes the place of a renamed one."""


@dataclass
class Tally:
    """Result of the study.

    Attributes:
        signals: (kind, last time of the history, s; exit code), in order.
        resumes: seconds from a command to its first step.
        runs: number of runs that were compared with the uninterrupted one.
        differences: a line for each difference.
    """

    signals: list[tuple[str, float, int]] = field(default_factory=list)
    resumes: list[float] = field(default_factory=list)
    runs: int = 0
    differences: list[str] = field(default_factory=list)


class Killer:
    """Starts a run, cuts it off and goes on with it, until it has been cut off often enough."""

    def __init__(self, scene: Path, out: Path, settings: Sequence[str], seed: int):
        self.command = [sys.executable, "-m", "taichi_ldem.cli"]
        interval = ("--set", f"output.checkpoint_interval={INTERVAL}")
        words = [word for text in settings for word in ("--set", text)]
        self.start = ["impact", str(scene), "--quiet", *words, *interval]
        self.whole, self.killed, self.moved = (out / name for name in ("whole", "killed", "moved"))
        self.rng = np.random.default_rng(seed)
        self.tally = Tally()

    def run(self, counts: dict[str, int]) -> Tally:
        """Cut the run off so many times in each way; where it has ended it is started again."""
        self._finish([*self.start, "--out", str(self.whole), "--force"])
        kinds = [kind for kind, count in counts.items() for _ in range(count)]
        self.rng.shuffle(kinds)
        begin = True
        for kind in kinds:
            begin = self._cut_off(begin, kind)
        if not begin:
            self._finish(self._next(begin))
            self._compare()
        return self.tally

    def _next(self, begin: bool) -> list[str]:
        how = "--force" if begin else "--resume"
        return [*self.start, "--out", str(self.killed), how]

    def _finish(self, words: Sequence[str]) -> None:
        done = subprocess.run([*self.command, *words], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{' '.join(words)}: {done.returncode}: {done.stderr[-2000:]}")

    def _cut_off(self, begin: bool, kind: str) -> bool:
        """Start or go on, cut off in one way; True where the run ended before or in spite of it."""
        words = self._next(begin)
        if kind == PIPE:  # there must be something to read
            words.remove("--quiet")
        before = _stamp(self.killed)
        with tempfile.TemporaryFile("w+") as errors:
            process = self._start(words, kind, errors)
            struck = self._wait(process, before, anywhere=kind != RENAME)
            if struck:
                self._strike(process, kind)
            code = process.wait()
            if struck and kind == RENAME:
                self._rename_back()
            errors.seek(0)
            said = errors.read()
        if struck:
            self.tally.signals.append((kind, _reached(self.killed), code))
        if "Traceback" in said or code not in (EXPECTED[kind] | {0}):
            self.tally.differences.append(f"{kind}, {' '.join(words)}: code {code}: {said[-500:]}")
        if code == 0:
            self._compare()
        return code == 0

    def _start(self, words: Sequence[str], kind: str, errors: IO[str]) -> "subprocess.Popen[bytes]":
        streams = {"stdout": subprocess.DEVNULL, "stderr": errors}
        if kind == PIPE:
            streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        return subprocess.Popen([*self.command, *words], **streams)

    def _wait(
        self, process: "subprocess.Popen[bytes]", before: tuple[int, int], *, anywhere: bool
    ) -> bool:
        """Wait for a random moment; False where the process has ended by then.

        Args:
            anywhere: also during the set-up, in which a new run has no folder yet.
        """
        started = time.monotonic()
        # one in five in the set-up, the others at a random moment of the stepping
        early = anywhere and self.rng.random() < 0.2
        wait = float(self.rng.uniform(0.0, 2.0)) if early else None
        while process.poll() is None:
            now = time.monotonic()
            if wait is not None and now - started > wait:
                return True
            if wait is None and _stamp(self.killed) != before:
                self.tally.resumes.append(now - started)
                wait = now - started + float(self.rng.uniform(0.0, 5 * INTERVAL))
            time.sleep(0.002)
        return False

    def _strike(self, process: "subprocess.Popen[bytes]", kind: str) -> None:
        """Cut a run off in one way."""
        if kind in (KILL, TERM, HANG_UP):
            process.send_signal(getattr(signal, kind))
            return
        if kind == PIPE and process.stdout is not None:
            process.stdout.close()
        elif kind == RENAME:
            self._rename()
        time.sleep(float(self.rng.uniform(0.0, 5 * INTERVAL)))  # it has to go on meanwhile
        process.terminate()

    def _rename(self) -> None:
        """Give the run's folder another name, and its own to a folder that looks like a run's."""
        self.killed.rename(self.moved)
        self.killed.mkdir()
        for name in OF_EVERY_RUN:
            (self.killed / name).write_bytes(OTHERS)

    def _rename_back(self) -> None:
        found = {path.name: path.read_bytes() for path in self.killed.iterdir()}
        if found != dict.fromkeys(OF_EVERY_RUN, OTHERS):
            self.tally.differences.append(f"written into another run's folder: {sorted(found)}")
        shutil.rmtree(self.killed)
        self.moved.rename(self.killed)

    def _compare(self) -> None:
        self.tally.runs += 1
        self.tally.differences += differences(self.whole, self.killed)


def _stamp(folder: Path) -> tuple[int, int]:
    """State of the history file, which changes when a run begins to step."""
    try:
        stat = os.stat(folder / "history.csv")
    except OSError:
        return 0, 0
    return stat.st_ino, stat.st_mtime_ns


def _reached(folder: Path) -> float:
    try:
        return float(RunFolder.open(folder).read_history()["time_s"][-1])
    except (ValueError, KeyError, IndexError):  # killed before the first row
        return 0.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study, print its numbers, return 1 where anything differed."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path)
    parser.add_argument("out", type=Path)
    options = (
        ("--kills", KILL, 24),
        ("--terms", TERM, 9),
        ("--hang-ups", HANG_UP, 9),
        ("--pipes", PIPE, 9),
        ("--renames", RENAME, 9),
    )
    for option, kind, count in options:
        parser.add_argument(option, type=int, default=count, dest=kind)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    given = parser.parse_args(arguments)
    killer = Killer(given.scene, given.out, given.settings, given.seed)
    tally = killer.run({kind: getattr(given, kind) for _, kind, _ in options})
    times = [at for _, at, _ in tally.signals]
    codes = sorted({(name, code) for name, _, code in tally.signals})
    print(f"{len(tally.signals)} signals, {tally.runs} runs compared; exit codes: {codes}")
    print(f"times at the signals: {[round(1e3 * at, 3) for at in times]} ms")
    if tally.resumes:
        low, middle, high = np.percentile(tally.resumes, (0, 50, 100))
        print(f"command to first step: {low:.1f} to {high:.1f} s, median {middle:.1f} s")
    print("differences:", json.dumps(tally.differences) if tally.differences else "none")
    return 1 if tally.differences or not tally.runs else 0


if __name__ == "__main__":
    sys.exit(main())
