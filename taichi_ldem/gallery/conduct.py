"""Carries out the runs of the gallery, each in a process of its own; what is finished stays."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from taichi_ldem.errors import SceneError
from taichi_ldem.gallery.problem import Run
from taichi_ldem.scenarios.child import tied
from taichi_ldem.scenarios.registry import entry_of
from taichi_ldem.scene import Scene, scene_to_toml
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.provenance import WITHOUT_EFFECT, unequal


@dataclass(frozen=True)
class Task:
    """A run and its folder."""

    run: Run
    folder: Path
    scene: Scene

    @property
    def begun(self) -> bool:
        """Whether the folder holds a run of this scene, on any number of threads."""
        folder = RunFolder(self.folder)
        if not folder.scene_file.is_file():
            return False
        try:
            return not any(unequal(self.scene, folder.read_scene(), WITHOUT_EFFECT))
        except SceneError:  # damaged, or no longer a scene
            return False

    @property
    def finished(self) -> bool:
        """Whether that run has come to its end."""
        return RunFolder(self.folder).summary_file.is_file() and self.begun


def tasks_of(
    runs: Sequence[Run], out: Path, *, quick: bool, threads: int | None = None
) -> list[Task]:
    """The runs of a problem with their folders below its own."""
    return [Task(run, out / run.name, run.resolved(quick=quick, threads=threads)) for run in runs]


def shares(workers: int, tasks: int) -> tuple[int, int]:
    """Processes at a time and threads of each, so that all cores are busy once.

    Args:
        workers: processes that are asked for; 0: as many as there are cores.
    """
    cores = os.cpu_count() or 1
    processes = max(1, min(workers or cores, tasks))
    return processes, max(1, cores // processes)


def conduct(tasks: Sequence[Task], processes: int, tell: Callable[[str], None]) -> dict[str, str]:
    """Carry out the runs that are not finished.

    Returns:
        The runs without a result, "problem/run", each with the last line that it printed.
    """
    missing = [task for task in tasks if not task.finished]
    with ThreadPoolExecutor(processes) as pool:
        reasons = list(pool.map(lambda task: _carry_out(task, tell), missing))
    names = [f"{task.folder.parent.name}/{task.folder.name}" for task in missing]
    return {name: reason for name, reason in zip(names, reasons, strict=True) if reason}


def _carry_out(task: Task, tell: Callable[[str], None]) -> str:
    """Run a scene in a process; why it has no result, or nothing."""
    folder, name = task.folder, f"{task.folder.parent.name}/{task.folder.name}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    file = folder.with_name(f"{folder.name}.toml")
    write_whole(file, scene_to_toml(task.scene).encode())
    entry = entry_of(task.scene)
    command = [sys.executable, "-m", "taichi_ldem.cli", entry.command, str(file)]
    command += ["--out", str(folder), "--quiet", "--no-figures"]
    goes_on = entry.resumable and RunFolder(folder).can_go_on and task.begun
    command.append("--resume" if goes_on else "--force")
    started = time.perf_counter()
    tell(f"{name}: {'goes on' if goes_on else 'begins'}")
    # the run writes a checkpoint and ends where this process does
    ended = subprocess.run(tied(command), capture_output=True, text=True)
    if ended.returncode:
        lines = (ended.stderr.strip() or ended.stdout.strip()).splitlines()
        return f"exit code {ended.returncode}: {(lines or [''])[-1]}"
    tell(f"{name}: done in {time.perf_counter() - started:.0f} s")
    return ""
