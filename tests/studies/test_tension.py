"""The study of tension: what is finished is not run again, and every case is a scene."""

import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.command import ldem
from support.paths import CONFIGS

from studies import tension
from taichi_ldem.model import material as mat
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    pass
from taichi_ldem.scene import load_scene


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Half a dumb-bell, pulled until it has parted."""
    out = tmp_path_factory.mktemp("tension") / "run"
    words = [str(CONFIGS / "tension_quick.toml"), "--out", str(out), "--threads", "1", "--quiet"]
    done = ldem("tension", *words)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    return RunFolder.open(out)


@pytest.mark.slow
def test_the_study_tells_about_what_is_finished_and_does_not_run_it_again(
    finished: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[list[str]] = []

    def start(command: list[str], check: bool) -> subprocess.CompletedProcess[str]:
        started.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(tension.subprocess, "run", start)
    (tmp_path / "size-3").symlink_to(finished.path)
    cases = {case.name: case for case in tension.CASES}
    for name in ("size-3", "prism-45", "flat-6"):
        tension.run(cases[name], CONFIGS, tmp_path, [])
    plain, weak = started
    assert "plate.angle=45" in plain
    assert "--weak" not in plain
    assert weak[3] == "--weak"
    rows = [line for line in tension.tables(tmp_path).splitlines() if line.startswith("| 0.5 x")]
    strength = finished.read_summary()["strength"]
    assert len(rows) == 1
    assert f"| {1e-6 * strength:.1f} |" in rows[0]
    tension.figure(tmp_path, tmp_path / "tension.png")
    assert (tmp_path / "tension.png").stat().st_size > 10_000


def test_every_case_is_a_scene() -> None:
    assert len({case.name for case in tension.CASES}) == len(tension.CASES)
    for case in tension.CASES:
        mat.check(load_scene(CONFIGS / case.scene, case.overrides))
