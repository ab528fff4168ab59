"""The folder of a toughness study: whose it is, and what is read from it."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest
from support.paths import CONFIGS

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import load_scene
from taichi_ldem.studies.toughness.strip import Reading
from taichi_ldem.studies.toughness.study import _claim, _read

SCENE = load_scene(CONFIGS / "tension_strip.toml")


def test_a_folder_of_another_scene_is_refused(tmp_path: Path) -> None:
    _claim(tmp_path / "a", SCENE)
    _claim(tmp_path / "a", SCENE)
    other = load_scene(CONFIGS / "tension_strip.toml", ["material.fracture_energy=900"])
    with pytest.raises(SceneError, match="holds the strips of another scene"):
        _claim(tmp_path / "a", other)


def test_a_line_that_was_cut_off_is_no_result(tmp_path: Path) -> None:
    file = tmp_path / "strips.jsonl"
    assert _read(file) == {}
    line = json.dumps({"name": "x1_a0_s0", **asdict(Reading(run=3.0))})
    file.write_text(f"{line}\n{line[:20]}")
    assert _read(file) == {"x1_a0_s0": Reading(run=3.0)}
