"""`ldem study toughness` in its quick form: what a crack costs along an axis and a diagonal."""

import csv
from pathlib import Path

import pytest
from support.command import ldem
from support.paths import CONFIGS

SCENE = CONFIGS / "tension_strip.toml"


@pytest.mark.slow
def test_the_quick_study_finds_the_costs_of_the_docs(tmp_path: Path) -> None:
    """The rows of 0.533 mm at 0 and 45 degrees in docs/tension.md, within the scatter of places."""
    command = ["study", "toughness", str(SCENE), "--quick", "--out", str(tmp_path)]
    assert ldem(*command).returncode == 0
    with (tmp_path / "toughness.csv").open() as stream:
        rows = {float(row["angle_deg"]): row for row in csv.DictReader(stream)}
    assert float(rows[0.0]["run"]) == pytest.approx(3.23, rel=0.1)
    assert float(rows[45.0]["run"]) == pytest.approx(2.79, rel=0.1)
    assert all(float(row["energy_error"]) < 0.01 for row in rows.values())
    # what has been run is not run again
    (tmp_path / "toughness.md").unlink()
    assert "2 of 2 strips" in ldem(*command).stdout
    assert (tmp_path / "toughness.md").exists()
    assert len((tmp_path / "strips.jsonl").read_text().splitlines()) == 2


def test_what_is_no_strip_is_refused_in_one_line(tmp_path: Path) -> None:
    done = ldem("study", "toughness", str(CONFIGS / "impact_small.toml"), "--out", str(tmp_path))
    assert done.returncode == 2
    assert done.stderr.strip().endswith(
        'a strip needs scenario = "tension" and one [[notch]] with normal = "x"'
    )
    assert "Traceback" not in done.stderr
