"""The study of readings: what it runs again, and what its table says."""

import json
import subprocess
from pathlib import Path

import pytest
from support.paths import CONFIGS

from studies import readings
from taichi_ldem.scene import load_scene


@pytest.mark.parametrize("reading", readings.READINGS, ids=lambda reading: reading.name)
def test_every_reading_is_a_valid_scene(reading: readings.Reading) -> None:
    scene = load_scene(CONFIGS / "impact.toml", reading.overrides)
    assert (scene.solver.duration == 2.5e-3) == reading.early  # EARLY's, in readings.py


def test_shipped_scenes_are_two_of_the_readings() -> None:
    by_name = {reading.name: reading for reading in readings.READINGS}
    for file, name in (("measured_strength", "full-measured"), ("as_printed", "as-printed")):
        shipped = load_scene(CONFIGS / f"impact_{file}.toml")
        reading = load_scene(CONFIGS / "impact.toml", by_name[name].overrides)
        assert shipped.plate == reading.plate
        assert shipped.material == reading.material


def test_a_finished_reading_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[list[str]] = []

    def record(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        ran.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "run", record)
    first, second = readings.READINGS[:2]
    (tmp_path / first.name).mkdir()
    (tmp_path / first.name / "summary.json").write_text("{}")
    for reading in (first, second):
        readings.run(reading, CONFIGS / "impact.toml", tmp_path, [])
    assert [command[command.index("--out") + 1] for command in ran] == [str(tmp_path / second.name)]
    for setting in second.overrides:
        assert setting in ran[0]


def test_the_table_leaves_open_what_an_early_end_hides(tmp_path: Path) -> None:
    values = {key: 0.002 for _, key, *_ in readings.COLUMNS} | {"first_peak_force_n": None}
    for name in ("derived", "early"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(json.dumps(values))
    lines = readings.table(tmp_path).splitlines()
    assert lines[2] == "| derived defaults | 2.00 | - | 2.00 | 0 | 2.00 | 0.002 | 0.002 | 0.20 |"
    assert lines[3] == "| derived defaults, larger step | 2.00 | - | 2.00 | - | - | - | - | - |"
    assert len(lines) == 4
