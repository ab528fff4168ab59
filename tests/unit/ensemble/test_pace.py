"""Ensembles of many members: what an attempt costs does not grow with their number."""

import os
import time
from pathlib import Path

import pytest
from support.members import SCENE

from taichi_ldem.ensemble import attempt, results
from taichi_ldem.ensemble.attempt import FINISHED, Outcome, write_outcome
from taichi_ldem.ensemble.axes import make_axes
from taichi_ldem.ensemble.conduct import Conductor
from taichi_ldem.ensemble.pace import Paced
from taichi_ldem.ensemble.plan import ATTEMPTS, MEMBERS, make_plan
from taichi_ldem.ensemble.pools import LocalPool
from taichi_ldem.ensemble.run import Tables
from taichi_ldem.scene import load
from taichi_ldem.storage.folder import RunFolder


def test_a_function_that_takes_long_is_called_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    now, calls = [0.0], []
    monkeypatch.setattr("taichi_ldem.ensemble.pace.time.monotonic", lambda: now[0])

    def work() -> None:
        calls.append(now[0])
        now[0] += 1.0

    paced = Paced(work, share=0.1)
    for _ in range(40):
        paced()
        now[0] += 0.5
    assert calls == [0.0, 10.0, 20.0]


def test_a_hundred_thousand_members_plan_without_reading_the_scene_for_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Before, 6000 took 51 s: the scene was read for each, and values were compared in pairs."""
    begun = time.process_time()
    (axis,) = make_axes(None, "0:20000", [])
    assert len({value.part for value in axis.values}) == 20000
    assert time.process_time() - begun < 4.0  # 0.3 s; by pairs, 10 s
    read: list[Path] = []
    real = load.read_file
    monkeypatch.setattr(load, "read_file", lambda path: read.append(path) or real(path))
    plan = make_plan(SCENE, cv="0.25", seeds="0:50")
    assert len({member.scene_sha256 for member in plan.members}) == 50
    assert len(read) == 1


def test_an_attempt_reads_its_own_member_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "fsync", lambda _: None)
    plan = make_plan(SCENE, cv="0.25", seeds="0:8")
    (tmp_path / ATTEMPTS).mkdir()
    tables = Tables(plan, tmp_path)
    read: list[str] = []
    real = results.read_attempts
    monkeypatch.setattr(results, "read_attempts", lambda *a: read.append(a[1]) or real(*a))
    for member in plan.members:
        (tmp_path / MEMBERS / member.name).mkdir(parents=True)
        RunFolder(tmp_path / MEMBERS / member.name).write_summary({"wall_s": 1.0})
        outcome = Outcome(member.name, 1, FINISHED)
        write_outcome(tmp_path, outcome)
        tables.note(outcome)
    tables.write()
    assert read == [member.name for member in plan.members]
    assert (tmp_path / "ensemble.csv").read_text().count(",finished,") == 8


def test_attempts_of_a_member_are_found_without_a_list_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / ATTEMPTS).mkdir()
    for number in (1, 2, 3):
        write_outcome(tmp_path, Outcome("a", number, "failed"))
    (tmp_path / ATTEMPTS / "a.2.json").write_text('{"name": "a", "number": "2", "state": []}')
    monkeypatch.setattr(Path, "glob", None)
    monkeypatch.setattr(Path, "iterdir", None)
    assert [o.number for o in attempt.read_attempts(tmp_path, "a")] == [1, 3]
    assert attempt.next_number(tmp_path, "a") == 4


def test_progress_looks_at_the_members_seldom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = make_plan(SCENE, cv="0.25", seeds="0:300")
    pool = LocalPool(1)
    conductor = Conductor(plan, tmp_path, pool, attempt.Commands((), ()))
    conductor.left = {member.name: member for member in plan.members}
    looked: list[str] = []

    def share(member) -> float:
        looked.append(member.name)
        time.sleep(1e-4)
        return 0.5

    monkeypatch.setattr(conductor, "_share", share)
    for _ in range(200):
        conductor._text(0.0, 0.0)
    assert len(looked) == 300
    assert conductor.done_share() == pytest.approx(0.5)
    pool.close()


def test_ended_attempts_are_handed_out_once_each() -> None:
    pool = LocalPool(2)
    broken = attempt.Task("/nowhere", "a", 1, attempt.Commands((), ()))
    for _ in range(50):
        pool.submit(broken)
    found: list[Outcome] = []
    while len(found) < 50:
        found += pool.ended(5.0)
    assert pool.ended(0.0) == []
    assert not pool._tasks
    pool.close()
