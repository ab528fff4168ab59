"""Compares a run that is killed and resumed many times with one that is never stopped.

Signals come at random moments of set-up and stepping. At the end history, fields and broken bars
must equal those of the uninterrupted run to the last bit:

    python -m studies.kills SCENE.toml outputs/kills --kills 50 --terms 10
"""

import json
import os
import signal
import subprocess
import sys
import time
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from taichi_ldem.storage.compare import differences
from taichi_ldem.storage.folder import RunFolder

INTERVAL = 0.3
"""Seconds of wall time between two checkpoints."""


@dataclass
class Tally:
    """Result of the study.

    Attributes:
        signals: (signal, last time of the history, s; exit code), in order.
        resumes: seconds from a command to its first step.
        runs: number of runs that were compared with the uninterrupted one.
        differences: a line for each difference.
    """

    signals: list[tuple[str, float, int]] = field(default_factory=list)
    resumes: list[float] = field(default_factory=list)
    runs: int = 0
    differences: list[str] = field(default_factory=list)


class Killer:
    """Starts a run, sends it signals and resumes it, until all signals have been sent."""

    def __init__(self, scene: Path, out: Path, settings: Sequence[str], seed: int):
        self.command = [sys.executable, "-m", "taichi_ldem.cli"]
        interval = ("--set", f"output.checkpoint_interval={INTERVAL}")
        words = [word for text in settings for word in ("--set", text)]
        self.start = ["impact", str(scene), "--quiet", *words, *interval]
        self.whole, self.killed = out / "whole", out / "killed"
        self.rng = np.random.default_rng(seed)
        self.tally = Tally()

    def run(self, kills: int, terms: int) -> Tally:
        """Send numbers of SIGKILL and SIGTERM; runs that end in the meantime are started again."""
        self._finish([*self.start, "--out", str(self.whole), "--force"])
        numbers = [signal.SIGKILL] * kills + [signal.SIGTERM] * terms
        self.rng.shuffle(numbers)
        begin = True
        for number in numbers:
            begin = self._interrupt(begin, signal.Signals(number))
        if not begin:
            self._finish(self._next(begin))
            self._compare()
        return self.tally

    def _next(self, begin: bool) -> list[str]:
        if not begin and list(self.killed.glob("checkpoint*.h5")):
            return ["resume", str(self.killed), "--quiet"]
        return [*self.start, "--out", str(self.killed), "--force"]

    def _finish(self, words: Sequence[str]) -> None:
        done = subprocess.run([*self.command, *words], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{' '.join(words)}: {done.returncode}: {done.stderr[-2000:]}")

    def _interrupt(self, begin: bool, number: signal.Signals) -> bool:
        """Start or resume, send one signal; True where the run ended before it came."""
        words = self._next(begin)
        before = _stamp(self.killed)
        started = time.monotonic()
        process = subprocess.Popen(
            [*self.command, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        # one in five anywhere in the set-up, the others at a random moment of the stepping
        wait = float(self.rng.uniform(0.0, 2.0)) if self.rng.random() < 0.2 else None
        while process.poll() is None:
            now = time.monotonic()
            if wait is not None and now - started > wait:
                process.send_signal(number)
                break
            if wait is None and _stamp(self.killed) != before:
                self.tally.resumes.append(now - started)
                wait = now - started + float(self.rng.uniform(0.0, 5 * INTERVAL))
            time.sleep(0.002)
        _, errors = process.communicate()
        code = process.returncode
        if code == 0:
            self._compare()
            return True
        self.tally.signals.append((number.name, _reached(self.killed), code))
        expected = {-signal.SIGKILL, -signal.SIGTERM, 143}
        if code not in expected or "Traceback" in errors:
            self.tally.differences.append(f"{' '.join(words)}: exit code {code}: {errors[-500:]}")
        return False

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
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--terms", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    given = parser.parse_args(arguments)
    killer = Killer(given.scene, given.out, given.settings, given.seed)
    tally = killer.run(given.kills, given.terms)
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
