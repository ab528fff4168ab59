"""The command of an ensemble: folders that are refused, tables, exit codes."""

import subprocess
import sys
import threading
import time

import pytest
from support.members import SCENE, states

from taichi_ldem.cli import main
from taichi_ldem.ensemble.plan import (
    ATTEMPTS,
    MEMBERS,
    write_plan,
)
from taichi_ldem.ensemble.run import How, check, run
from taichi_ldem.errors import SceneError
from taichi_ldem.storage.durable import locked


def test_folders_that_are_refused(plan, tmp_path):
    with pytest.raises(SceneError, match="holds no ensemble"):
        check(plan, tmp_path, resume=True)
    check(plan, tmp_path, resume=False)
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(SceneError, match="is not empty"):
        check(plan, tmp_path, resume=False)
    write_plan(plan, tmp_path, 1)
    with pytest.raises(SceneError, match="--resume continues it"):
        check(plan, tmp_path, resume=False)


def test_an_ensemble_that_cannot_write_its_table_ends_its_children(plan, tmp_path, fake):
    out = tmp_path / "out"
    asked = fake(velocity2=["hang"], velocity3=["hang"])

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("taichi_ldem.ensemble.conduct.Conductor._take", full)
        with pytest.raises(OSError, match="No space left"):
            run(plan, out, How(local=3), commands=asked)
    assert {states(out, name)[0] for name in ("velocity2", "velocity3")} == {"stopped"}


def test_an_ensemble_whose_folder_is_renamed_ends_and_spares_its_successor(plan, tmp_path, fake):
    out, moved = tmp_path / "out", tmp_path / "moved"

    def rename() -> None:
        while not list(out.glob(f"{MEMBERS}/*/runs")):
            time.sleep(0.01)
        out.rename(moved)
        out.mkdir()

    renaming = threading.Thread(target=rename)
    renaming.start()
    asked = fake(**{name: ["hang"] for name in ("velocity2", "velocity2.5", "velocity3")})
    with pytest.raises(OSError, match="was renamed or replaced; what was under way in it is ended"):
        run(plan, out, How(local=1), commands=asked)
    renaming.join()
    assert list(out.iterdir()) == []
    assert len(list(moved.glob(f"{MEMBERS}/*/runs"))) == 1


@pytest.mark.slow
def test_two_true_members_are_those_of_the_command_alone(tmp_path):
    """Slow: two runs in one process, which keeps its simulation, and one of its own."""
    words = ["--set", "solver.duration=1e-4", "--set", "output.image_times=[]"]
    speeds = "striker.velocity=4,5"
    out = tmp_path / "ensemble"
    assert (
        main(["ensemble", str(SCENE), "--vary", speeds, "--out", str(out), "--local", "1", *words])
        == 0
    )
    alone = tmp_path / "alone"
    command = [sys.executable, "-m", "taichi_ldem.cli", "impact", str(SCENE), "--out", str(alone)]
    subprocess.run([*command, *words], check=True, capture_output=True)
    member = out / MEMBERS / "velocity5" / "history.csv"
    assert member.read_bytes() == (alone / "history.csv").read_bytes()


def test_command_with_fake_members(plan, tmp_path, fake, capsys, monkeypatch):
    """The whole command but the solver: folder held, tables kept up to date, exit code."""
    monkeypatch.setattr("taichi_ldem.ensemble.report.report", lambda folder: [])
    out = tmp_path / "out"
    commands = fake(velocity3=["fail", "fail"])
    assert run(plan, out, How(local=2), commands=commands) == 5
    told = capsys.readouterr()
    assert "3 members, 0 finished already; 2 at a time on this machine" in told.out
    assert "velocity3: attempt 2 failed: error: the plate is velocity3; given up" in told.out
    assert told.err == "failed: velocity3: failed: error: the plate is velocity3\n"
    assert "finished" in (out / "ensemble.csv").read_text()
    assert len(list((out / ATTEMPTS).glob("*.json"))) == 4
    with locked(out), pytest.raises(SceneError, match="in use by process"):
        run(plan, out, resume=True, commands=commands)
    assert run(plan, out, resume=True, commands=commands, quiet=True) == 0
    assert capsys.readouterr().out == ""
