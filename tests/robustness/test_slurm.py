"""The job script of examples/ with a stand-in for Slurm, which signals only the script."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.command import SCENE, WITHOUT_VULKAN, ldem
from support.paths import ROOT

from taichi_ldem.storage.compare import differences

SCRIPT = ROOT / "examples" / "slurm.sh"
STAND_IN = """#!/bin/sh
mkdir -p "$4"
echo "$*" >> "$4/calls"
trap 'sleep 0.1; touch "$4/checkpoint"; exit 143' TERM
[ -f "$4/checkpoint" ] && exit 0
touch "$4/begun"
while :; do sleep 0.02; done
"""
"""Instead of `ldem`: takes a moment for its checkpoint, and finishes when started again."""

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="the script is bash's")


def _program(folder: Path, name: str, text: str) -> None:
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder of programs that come first, with a `scontrol` that notes what it is asked."""
    (tmp_path / "bin").mkdir()
    _program(tmp_path / "bin", "scontrol", f'#!/bin/sh\necho "$*" >> {tmp_path}/queue\n')
    return tmp_path / "bin"


def _submit(programs: Path, scene: Path, out: Path) -> "subprocess.Popen[bytes]":
    job = {"SLURM_JOB_ID": "17", "SLURM_CPUS_PER_TASK": "1"}
    path = {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    environment = {**WITHOUT_VULKAN, **job, **path}
    return subprocess.Popen(["bash", SCRIPT, scene, out], env=environment)


def _wait_for(file: Path, lines: int = 0) -> None:
    deadline = time.monotonic() + 300
    while time.monotonic() < deadline:
        if file.is_file() and file.read_bytes().count(b"\n") >= lines:
            return
        time.sleep(0.005)
    raise AssertionError(f"{file} never came")


@pytest.mark.parametrize(("number", "requeued"), [("SIGUSR1", True), ("SIGTERM", False)])
def test_the_script_passes_the_signal_on_and_waits_for_the_checkpoint(
    programs: Path, tmp_path: Path, number: str, requeued: bool
) -> None:
    _program(programs, "ldem", STAND_IN)
    out, scene = tmp_path / "run", tmp_path / "t.toml"
    job = _submit(programs, scene, out)
    _wait_for(out / "begun")
    job.send_signal(signal.Signals[number])
    assert job.wait(30) == 143
    assert (out / "checkpoint").exists()
    assert (tmp_path / "queue").exists() == requeued
    if requeued:
        assert (tmp_path / "queue").read_text() == "requeue 17\n"
    assert _submit(programs, scene, out).wait(30) == 0
    first, second = (out / "calls").read_text().splitlines()
    assert first == second == f"impact {scene} --out {out} --resume --quiet --threads 1"


@pytest.mark.slow
def test_a_job_that_is_requeued_gives_the_run_that_was_never_stopped(
    programs: Path, tmp_path: Path
) -> None:
    """Killed before there is a checkpoint, stopped at its time limit, then left alone."""
    _program(programs, "ldem", f'#!/bin/sh\nexec {sys.executable} -m taichi_ldem.cli "$@"\n')
    scene, out = tmp_path / "t.toml", tmp_path / "run"
    scene.write_text(SCENE.replace("8e-5", "4e-5"))
    assert ldem("impact", str(scene), "--out", str(tmp_path / "whole"), "--quiet").returncode == 0
    job = _submit(programs, scene, out)
    _wait_for(out / "history.csv", 5)
    holder = (out / "run.lock").read_text(errors="replace").split("process ")[1].split()[0]
    os.kill(int(holder), signal.SIGKILL)  # the node fails
    assert job.wait(60) == 137
    assert not list(out.glob("checkpoint*"))
    (out / "history.csv").unlink()
    job = _submit(programs, scene, out)
    _wait_for(out / "history.csv", 10)
    job.send_signal(signal.SIGUSR1)
    assert job.wait(60) == 143
    assert (out / "checkpoint.h5").exists()
    assert (tmp_path / "queue").read_text() == "requeue 17\n"
    assert _submit(programs, scene, out).wait(120) == 0
    assert differences(tmp_path / "whole", out) == []
    assert _submit(programs, scene, out).wait(60) == 0  # a finished run is left as it is
