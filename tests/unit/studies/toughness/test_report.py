"""The table of a toughness study and its number for bias."""

from pathlib import Path

import pytest
from support.paths import CONFIGS

from taichi_ldem.scene import load_scene
from taichi_ldem.studies.toughness.plan import Strip
from taichi_ldem.studies.toughness.report import bias, report, table
from taichi_ldem.studies.toughness.strip import Reading

SCENE = load_scene(CONFIGS / "tension_strip.toml")
EDGE = SCENE.plate.spacing


def test_bias_is_half_the_range_over_the_mean() -> None:
    places = {(EDGE, 0.0): [Reading(run=3.0)], (EDGE, 45.0): [Reading(run=1.0), Reading(run=1.0)]}
    assert bias(places, EDGE) == pytest.approx(0.5)
    assert bias({(EDGE, 0.0): [Reading(run=3.0)]}, EDGE) is None
    assert bias({(EDGE, 0.0): [Reading()], (EDGE, 45.0): [Reading(run=1.0)]}, EDGE) is None


def test_the_table_has_means_and_scatter_and_leaves_out_what_did_not_run() -> None:
    places = {(EDGE, 0.0): [Reading(run=3.0, bars=1.0), Reading(run=2.0, bars=1.0), Reading()]}
    text = table(SCENE, places)
    assert "| 0 | 2 of 3 |  | 2.50 ± 0.71 | 1.00 ± 0.00 | 1.50 ± 0.71 |" in text


def test_all_files_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = {
        Strip(angle, factor, 0): Reading(start=2.0, run=3.0, bars=1.5, deviation=1.0)
        for angle in (0.0, 45.0)
        for factor in (1, 2)
    }
    report(SCENE, found, tmp_path)
    assert "Bias of direction: ± 0 %" in capsys.readouterr().out
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"toughness.md", "toughness.csv", "toughness.png"}
