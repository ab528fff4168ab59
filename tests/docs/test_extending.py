"""The examples of docs/extending.md, as a newcomer would add them: to a copy of the package."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "extending.md"

BLOCKS = re.findall(
    r"^```python\n# (\S+?\.py)(: [^\n]*)?\n(.*?)^```", PAGE.read_text(), re.M | re.S
)
"""(file of the package, "" or where in it, text) of the page's examples, in their order."""


def _block(file: str) -> str:
    (text,) = (text for name, _, text in BLOCKS if name == file)
    return text


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A folder with a copy of the package."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "taichi_ldem", tmp_path / "taichi_ldem", ignore=ignored)
    return tmp_path


def _add(copy: Path, file: str) -> None:
    """Write an example into the copy; its folder must be one of the package."""
    path = copy / file
    assert not path.exists()
    path.write_text(_block(file), encoding="utf-8")


def _scene(copy: Path, *changes: tuple[str, str]) -> Path:
    """The scene of the examples for 50 us, with lines replaced."""
    text = (ROOT / "examples" / "plate.toml").read_text(encoding="utf-8")
    for old, new in (("duration = 3e-4", "duration = 5e-5"), *changes):
        assert old in text
        text = text.replace(old, new)
    scene = copy / "scene.toml"
    scene.write_text(text, encoding="utf-8")
    return scene


def _ldem(copy: Path, *words: str | Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "taichi_ldem.cli", *map(str, words)],
        cwd=copy,
        env=os.environ | {"PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


def _summary(run: Path) -> dict[str, float]:
    """The run's numbers; its energies have closed, as those of shipped examples do."""
    numbers: dict[str, float] = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    assert numbers["energy_error_of_plate"] < 0.02  # docs/stability.md: the guard stops at 0.1
    return numbers


@pytest.mark.slow
def test_a_softening_law_is_one_file(copy: Path) -> None:
    _add(copy, "taichi_ldem/solver/laws/parabolic.py")
    scene = _scene(copy, ("failure_factor = 31.45", 'failure_factor = 31.45\nlaw = "parabolic"'))
    _ldem(copy, "impact", scene, "--out", copy / "run", "--quiet")
    assert _summary(copy / "run")["broken_bars"] > 0


@pytest.mark.slow
def test_a_nose_of_the_striker_is_one_file(copy: Path) -> None:
    _add(copy, "taichi_ldem/solver/contact/noses/punch.py")
    scene = _scene(copy, ("diameter = 0.006\n", 'diameter = 0.006\nshape = "punch"\n'))
    _ldem(copy, "impact", scene, "--out", copy / "run", "--quiet")
    assert _summary(copy / "run")["peak_load_n"] > 0


@pytest.mark.slow
def test_a_scenario_is_one_file_and_a_line_in_the_registry(copy: Path) -> None:
    registry = copy / "taichi_ldem/scenarios/registry.py"
    text = registry.read_text(encoding="utf-8")
    _add(copy, "taichi_ldem/scenarios/rebound.py")
    entry = _block("taichi_ldem/scenarios/registry.py")
    assert text.count("_ENTRIES = (\n") == 1
    registry.write_text(text.replace("_ENTRIES = (\n", f"_ENTRIES = (\n{entry}"), encoding="utf-8")
    scene = _scene(
        copy,
        ('scenario = "impact"', 'scenario = "rebound"'),
        ("mass = 0.04", "mass = 1e-5"),  # light and slow: it bounces, and nothing breaks
        ("velocity = 5.0", "velocity = 1.0"),
    )
    run = copy / "run"
    _ldem(copy, "rebound", scene, "--out", run, "--quiet")
    numbers = _summary(run)
    assert 0 < numbers["restitution"] < 1  # some of the energy stays in the plate
    assert numbers["largest_force_n"] > 0
    assert (run / "force.png").is_file()
    _ldem(copy, "report", run)
    assert "Rebound" in (run / "report.html").read_text(encoding="utf-8")
