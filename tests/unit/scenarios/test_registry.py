"""A scenario of one's own: one file and one entry of the registry, run through the command line."""

import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from support.command import SCENE, WITHOUT_VULKAN

from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scene import SCENARIOS as RULES

MODULE = '''
"""A struck plate that vibrates: the size of its history."""


def summary(simulation, history, folder):
    return {"rows": len(history), "kept_in": folder.path.name, "steps": simulation.steps}
'''

PROGRAM = """
import sys
from taichi_ldem.scenarios import registry
registry.register(registry.Scenario("ring", "Let a struck plate ring", "Ringing", "ringing",
                                    figures=("energy",), pictures=False))
from taichi_ldem.cli import main
sys.exit(main(sys.argv[1:]))
"""


def _run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The command line with the new scenario, whose module lies in a folder."""
    environment = WITHOUT_VULKAN | {"PYTHONPATH": ":".join([str(folder), *sys.path])}
    command = [sys.executable, "-c", PROGRAM, *words]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.slow  # tests/docs/test_extending.py adds a scenario by file and entry, too
def test_a_new_scenario_takes_one_file_and_one_entry(tmp_path: Path) -> None:
    (tmp_path / "ringing.py").write_text(MODULE)
    free = SCENE[: SCENE.index("[clamp]")] + SCENE[SCENE.index("[solver]") :]
    scene = free.replace('"impact"', '"ring"').replace("duration = 8e-5", "duration = 1e-5")
    (tmp_path / "plate.toml").write_text(scene)
    shown = _run(tmp_path, "--help")
    assert "Let a struck plate ring" in shown.stdout
    done = _run(tmp_path, "ring", "plate.toml", "--threads", "1")
    assert done.returncode == 0, done.stderr
    run = tmp_path / "outputs" / "plate"
    summary = json.loads((run / "summary.json").read_text())
    assert summary["kept_in"] == "plate"
    assert summary["rows"] == len((run / "history.csv").read_text().splitlines()) - 1
    assert summary["broken_bars"] == 0
    assert (run / "energy.png").is_file()
    # resume knows it too, and another scenario's command refuses its scene
    done = _run(tmp_path, "resume", str(run), "--extend", "1e-6", "--quiet")
    assert done.returncode == 0, done.stderr
    longer = json.loads((run / "summary.json").read_text())
    assert longer["steps"] > summary["steps"]
    refused = _run(tmp_path, "impact", "plate.toml", "--out", "other")
    assert refused.returncode == 2
    assert "run it with `ldem ring`" in refused.stderr


def test_scenes_know_the_scenarios_of_the_registry() -> None:
    assert list(RULES) == list(SCENARIOS)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_entry_has_what_the_program_needs(name: str) -> None:
    entry = SCENARIOS[name]
    assert entry.command == name
    assert entry.help
    assert entry.title
    assert len(set(entry.figures)) == len(entry.figures) > 0
    module = entry.load()
    assert hasattr(module, "summary") or hasattr(module, "run")
    if entry.resumable:
        assert hasattr(module, "summary")
    for option in entry.options:
        assert bool(option.key) != bool(option.runs)
        if option.runs:
            place, _, function = option.runs.partition(":")
            assert callable(getattr(import_module(place), function))
