"""One attempt at a member: it runs once, waits for its folder and ends with its worker."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.members import runs, states, task

from taichi_ldem.ensemble import attempt as attempts
from taichi_ldem.ensemble.attempt import Task, attempt
from taichi_ldem.ensemble.plan import (
    MEMBERS,
)


def test_an_attempt_that_is_started_twice_runs_once(conduct, fake):
    """As a scheduler does that loses a worker, or the result that a worker had."""
    failing = task(conduct, fake(velocity2=["fail"]))
    assert attempt(failing).state == "failed"
    assert attempt(failing).state == "lost"
    assert runs(conduct.folder, "velocity2") == ["begin"]
    assert states(conduct.folder, "velocity2") == ["failed"]  # the record stands
    again = task(conduct, fake(), number=2)
    assert [attempt(again).state, attempt(again).state] == ["finished", "finished"]
    assert runs(conduct.folder, "velocity2") == ["begin", "begin"]


def test_a_run_folder_that_is_in_use_is_waited_for(conduct, fake, monkeypatch):
    folder = conduct.folder / MEMBERS / "velocity2"
    folder.mkdir(parents=True)
    monkeypatch.setattr(attempts, "PATIENCE", 0.1)
    holder = f"import time; from pathlib import Path\n\
from taichi_ldem.storage.durable import locked\n\
with locked(Path({str(folder)!r})):\n print('held', flush=True); time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", holder], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "held\n"
        outcome = attempt(task(conduct, fake()))
        assert outcome.state == "failed"
        assert f"in use by process {process.pid}" in outcome.reason
    finally:
        process.kill()
        process.communicate()
    assert attempt(task(conduct, fake(), number=2)).state == "finished"


def test_a_worker_without_the_files_says_so(conduct, fake, tmp_path):
    elsewhere = Task(str(tmp_path / "nowhere"), "velocity2", 1, fake())
    outcome = attempt(elsewhere)
    assert outcome.state == "failed"
    assert "workers need the same files" in outcome.reason


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux does it")
def test_a_child_ends_with_its_worker(conduct, fake):
    code = f"from taichi_ldem.ensemble.attempt import *\nattempt(Task({str(conduct.folder)!r}, \
'velocity2', 1, {fake(velocity2=['hang'])!r}), lambda: 0)"
    worker = subprocess.Popen([sys.executable, "-c", code])
    file = conduct.folder / MEMBERS / "velocity2" / "runs"
    until = time.monotonic() + 30
    while not file.is_file() and time.monotonic() < until:
        time.sleep(0.02)
    children = Path(f"/proc/{worker.pid}/task/{worker.pid}/children").read_text().split()
    assert len(children) == 1
    worker.kill()
    worker.wait()
    while Path("/proc", children[0]).exists() and time.monotonic() < until:
        time.sleep(0.02)
    assert not Path("/proc", children[0]).exists()
    assert states(conduct.folder, "velocity2") == ["running"]  # nobody was left to write
