"""How the gallery's runs are carried out; no run is started here."""

import subprocess
from pathlib import Path
from typing import Any

import pytest

from taichi_ldem.gallery import conduct
from taichi_ldem.gallery.problem import Run
from taichi_ldem.scene import scene_to_toml

RUN = Run("bar", "strip.toml")


def test_a_finished_run_of_the_same_scene_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: pytest.fail("started a run"))
    (task,) = conduct.tasks_of([RUN], tmp_path / "strip", quick=False, threads=2)
    task.folder.mkdir(parents=True)
    other_threads = RUN.resolved(quick=False, threads=1)
    (task.folder / "scene.toml").write_text(scene_to_toml(other_threads))
    (task.folder / "summary.json").write_text("{}")
    assert conduct.conduct([task], 1, print) == {}
    (task.folder / "scene.toml").write_text(
        scene_to_toml(RUN.resolved(quick=False).changed("grips.velocity=0.5"))
    )
    assert not task.finished


def test_a_run_that_fails_is_named_with_its_last_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands: list[list[str]] = []

    def fail(command: list[str], **_: Any) -> Any:
        commands.append(command)
        return subprocess.CompletedProcess(command, 3, "", "noise\nstopped: not finite\n")

    monkeypatch.setattr(subprocess, "run", fail)
    tasks = conduct.tasks_of([RUN], tmp_path / "strip", quick=False, threads=1)
    lines: list[str] = []
    failed = conduct.conduct(tasks, 2, lines.append)
    assert failed == {"strip/bar": "exit code 3: stopped: not finite"}
    at = commands[0].index("tension")
    assert commands[0][at + 1] == str(tmp_path / "strip/bar.toml")
    assert lines == ["strip/bar: begins"]


def test_processes_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    assert conduct.shares(0, 20) == (8, 1)
    assert conduct.shares(0, 2) == (2, 4)
    assert conduct.shares(3, 20) == (3, 2)
