"""Members that finish, fail, are killed, hang or are stopped."""

import io
import os
import signal
import threading
import time

from rich.console import Console
from support.members import runs, states

from taichi_ldem.ensemble import attempt as attempts
from taichi_ldem.ensemble.attempt import Task, attempt, read_attempts
from taichi_ldem.ensemble.conduct import duration, reached_time
from taichi_ldem.ensemble.plan import (
    MEMBERS,
)


def test_all_finish_and_what_has_finished_is_not_run_again(conduct, fake):
    code, _ = conduct(fake())
    assert code == 0
    code, conductor = conduct(fake())
    assert code == 0
    assert conductor.tries == {}
    for name in ("velocity2", "velocity2.5", "velocity3"):
        assert runs(conduct.folder, name) == ["begin"]
        assert states(conduct.folder, name) == ["finished"]


def test_a_member_that_fails_is_tried_once_more_and_takes_nobody_with_it(conduct, fake):
    code, conductor = conduct(fake(velocity2=["fail"], **{"velocity2.5": ["fail", "fail"]}))
    assert code == 5
    assert [outcome.name for outcome in conductor.failed] == ["velocity2.5"]
    assert states(conduct.folder, "velocity2") == ["failed", "finished"]
    assert states(conduct.folder, "velocity2.5") == ["failed", "failed"]
    assert states(conduct.folder, "velocity3") == ["finished"]
    last = read_attempts(conduct.folder, "velocity2.5")[-1]
    assert (last.exit_code, last.last_error) == (7, "error: the plate is velocity2.5")
    assert last.reason == last.last_error
    # asked to go on, it is tried twice again at most, and only it
    code, _ = conduct(fake())
    assert code == 0
    assert states(conduct.folder, "velocity2.5") == ["failed", "failed", "finished"]
    assert runs(conduct.folder, "velocity3") == ["begin"]


def test_a_checkpoint_is_gone_on_from_unless_it_was_refused(conduct, fake):
    asked = fake(velocity2=["checkpoint"], velocity3=["checkpoint", "refused"])
    code, _ = conduct(asked)
    assert code == 5
    assert runs(conduct.folder, "velocity2") == ["begin", "resume"]
    assert runs(conduct.folder, "velocity3") == ["begin", "resume"]
    code, _ = conduct(asked)
    assert code == 0
    assert runs(conduct.folder, "velocity3") == ["begin", "resume", "begin"]


def test_a_child_that_is_killed_or_takes_too_long(conduct, fake):
    code, _ = conduct(fake(velocity2=["die"], velocity3=["hang"]), timeout=2.5)
    assert code == 0
    killed, slow = (read_attempts(conduct.folder, name)[0] for name in ("velocity2", "velocity3"))
    assert (killed.state, killed.reason, killed.exit_code) == ("killed", "ended by SIGKILL", -9)
    assert (slow.state, slow.reason) == ("timed out", "took longer than 2.5 s")
    assert slow.exit_code == -signal.SIGTERM


def test_stopping_ends_children_cleanly_and_begins_none(conduct, fake):
    started = time.monotonic()
    asked = fake(velocity2=["hang"], **{"velocity2.5": ["hang"]})
    ended = []

    def interrupt() -> None:
        hanging = [conduct.folder / MEMBERS / n / "runs" for n in ("velocity2", "velocity2.5")]
        while not all(file.is_file() for file in hanging):
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    code, _ = conduct(asked, ended=ended.append)
    thread.join()
    assert code == 130
    assert time.monotonic() - started < 30
    assert {outcome.state for outcome in ended} == {"stopped"}
    assert not (conduct.folder / MEMBERS / "velocity3").exists()
    code, _ = conduct(fake())
    assert code == 0
    assert states(conduct.folder, "velocity2") == ["stopped", "finished"]


def test_an_attempt_that_raises_takes_nobody_with_it(conduct, fake, monkeypatch):
    from taichi_ldem.ensemble import pools

    def broken(task: Task, stop, standing) -> attempts.Outcome:
        if task.name == "velocity2":
            raise RuntimeError("out of\nluck")
        return attempt(task, stop, standing)

    monkeypatch.setattr(pools, "attempt", broken)
    code, conductor = conduct(fake())
    assert code == 5
    assert [o.reason for o in conductor.failed] == ["RuntimeError: out of luck"]
    assert states(conduct.folder, "velocity2") == ["failed", "failed"]
    assert states(conduct.folder, "velocity3") == ["finished"]


def test_progress_on_a_terminal(conduct, fake):
    text = io.StringIO()
    console = Console(file=text, force_terminal=True, width=100)
    code, _ = conduct(fake(), console=console)
    assert code == 0
    assert "velocity3: finished" in text.getvalue()
    assert "3 of 3 done, 0 failed" in text.getvalue()


def test_share_of_a_run_from_its_history(tmp_path):
    file = tmp_path / "history.csv"
    assert reached_time(file) == 0.0
    file.write_text("time_s,force\n")
    assert reached_time(file) == 0.0
    file.write_text("time_s,force\n0.0,1\n1e-3,2\n2e-3")
    assert reached_time(file) == 1e-3
    assert [duration(s) for s in (61, 600, 9000)] == ["61 s", "10 min", "2 h 30 min"]
