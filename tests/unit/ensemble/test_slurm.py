"""Members as jobs of SLURM, with a stand-in for SLURM that starts a job's script at once."""

import os
import shutil
import sys
from pathlib import Path

import pytest
from support.members import SCENE, SPEEDS, runs, states

from taichi_ldem.cli import main
from taichi_ldem.ensemble.run import How, run

SBATCH = """#!/bin/sh
n=$(ls {jobs} | wc -l); mkdir {jobs}/$n; cp "$1" {jobs}/$n/script
setsid bash "$1" > {jobs}/$n/out 2>&1 &
echo $! > {jobs}/$n/process
echo "Submitted batch job $n"
"""
SCANCEL = """#!/bin/sh
for n in "$@"; do kill -TERM -$(cat {jobs}/$n/process); done
"""


@pytest.fixture
def jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a folder for each job; ``sbatch`` and ``scancel`` are on the path."""
    pytest.importorskip("dask_jobqueue")
    folder, programs = tmp_path / "jobs", tmp_path / "bin"
    for made in (folder, programs):
        made.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (programs / name).write_text(text.format(jobs=folder))
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    return folder


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("setsid") is None, reason="the stand-in needs setsid")
def test_members_run_as_jobs(plan, tmp_path, fake, jobs, monkeypatch) -> None:
    """Slow: a scheduler and two workers in processes of their own."""
    out = tmp_path / "out"
    monkeypatch.setattr("taichi_ldem.ensemble.report.report", lambda _: [])  # fakes have no history
    asked = fake(velocity3=["fail"])
    assert run(plan, out, How(slurm=2, threads=3), commands=asked) == 0
    assert states(out, "velocity2") == ["finished"]
    assert states(out, "velocity3") == ["failed", "finished"]
    assert runs(out, "velocity3") == ["begin", "begin"]
    scripts = [(job / "script").read_text() for job in jobs.iterdir()]
    assert scripts  # the second job may still be waiting for its submission
    for script in scripts:
        assert "#SBATCH --cpus-per-task=3" in script
        assert "tls://" in script
        assert sys.executable in script


def test_without_slurm_one_line_says_so(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    arguments = ["ensemble", str(SCENE), "--vary", SPEEDS, "--out", str(tmp_path / "out")]
    assert main([*arguments, "--slurm", "2"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "sbatch" in error or "dask-jobqueue" in error
    assert main([*arguments, "--slurm", "2", "--local", "1"]) == 2
