"""An ensemble of three members that are small scripts, where the solver is not the point."""

import json

import pytest
from support.members import FAKE, SCENE, SPEEDS

from taichi_ldem.ensemble import attempt as attempts
from taichi_ldem.ensemble.attempt import FOLDER, PYTHON, Commands
from taichi_ldem.ensemble.conduct import Conductor
from taichi_ldem.ensemble.plan import (
    Plan,
    make_plan,
    write_plan,
)
from taichi_ldem.ensemble.pools import LocalPool


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(attempts, "POLL", 0.02)
    monkeypatch.setattr(attempts, "STOP_POLL", 0.02)


@pytest.fixture
def fake(tmp_path):
    """Commands of members that do what is asked of their first, second ... run."""
    script = tmp_path / "fake.py"
    script.write_text(FAKE)

    def commands(**asked: list[str]) -> Commands:
        words = (PYTHON, "-I", "-S", str(script), FOLDER, json.dumps(asked))
        return Commands((*words, "begin"), (*words, "resume"))

    return commands


@pytest.fixture
def plan() -> Plan:
    return make_plan(SCENE, vary=[SPEEDS])


@pytest.fixture
def conduct(plan, tmp_path):
    """Runs the three members with given commands; exit code and the conductor."""
    folder = tmp_path / "ensemble"
    folder.mkdir()
    write_plan(plan, folder, 1)

    def go(commands: Commands, **options) -> tuple[int, Conductor]:
        pool = LocalPool(2)
        conductor = Conductor(plan, folder, pool, commands, **options)
        code = conductor.run()
        pool.close()
        return code, conductor

    go.folder = folder
    return go
