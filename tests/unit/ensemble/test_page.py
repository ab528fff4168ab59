"""The HTML page of an ensemble."""

import json
from pathlib import Path

import pytest

from taichi_ldem.ensemble import page
from taichi_ldem.errors import DamagedFile


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """The folder of an ensemble, of which only the tables are there."""
    many = tmp_path / "many"
    many.mkdir()
    (many / "ensemble.csv").write_text("name,failure_time_s,wall_s,state\na,0.0071234567,9,done\n")
    group = {
        "varied": {"seed": 1},
        "statistics": {
            "failure_time_s": {
                "count": 2,
                "mean": 7e-3,
                "standard_deviation": 1e-4,
                "interval": [6.9e-3, 7.1e-3],
                "smallest": 6.95e-3,
                "largest": 7.05e-3,
            }
        },
    }
    record = {
        "asked": {"scene": "a.toml", "seeds": "1:4", "set": ["a.b=1"]},
        "finished": 1,
        "groups": [group],
        "sha256": "cd34",
        "not_finished": {"b": {"state": "failed", "reason": "stopped: <NaN>"}},
    }
    (many / "ensemble.json").write_text(json.dumps(record))
    (many / "members" / "a").mkdir(parents=True)
    return many


def test_an_ensemble_has_a_page(many: Path) -> None:
    text = page.write_report(many).read_text(encoding="utf-8")
    assert '<a href="members/a">a</a>' in text
    assert text.count(">What was asked<") == 2  # the heading and the way to it
    assert "6.90 to 7.10" not in text  # no interval of two members, whatever the file says
    for part in (
        "1 of 1 members",
        "<td>7.12</td>",  # 0.0071234567 s
        "<th>failure t2 (force) [ms]</th>",
        "Seed 1; no confidence interval below 3 members",
        "&lt;NaN&gt;",
        "cd34",
        "ldem ensemble a.toml --seeds 1:4 --set a.b=1",
    ):
        assert part in text, part


def test_groups_with_cracks_measured_at_the_end_are_marked() -> None:
    broken = {"cv": 0.1, "radial_cracks": 3, "failure_time_energy_s": 7e-3}
    members = [broken, broken | {"cv": 0.2, "failure_time_energy_s": None}]
    marked = [page._starred({"varied": {"cv": cv}}, members) for cv in (0.1, 0.2)]
    assert marked == [False, True]
    numbers = dict.fromkeys(("mean", "smallest", "largest"), 5.0)
    group = {"statistics": {"radial_cracks": numbers | {"count": 3, "interval": [4.5, 5.5]}}}
    group["statistics"]["radial_cracks"]["standard_deviation"] = 0.2
    table = page._group(group, starred=True)
    assert table.rows == [("radial cracks*", "", "3", "5", "0.200", "4.50 to 5.50", "5 to 5")]
    assert "no failure by the strain energy" in table.caption


@pytest.mark.parametrize(
    ("name", "old", "new", "what"),
    [
        ("ensemble.json", '"mean"', '"men"', "does not hold the statistics of an ensemble"),
        ("ensemble.json", '"groups": [', '"groups": [3, ', "does not hold the statistics"),
        ("ensemble.json", '"asked": {', '"asked": 3, "x": {', "does not hold the statistics"),
        ("ensemble.csv", "name,", "nam,", "row 1 does not fit its header"),
        ("ensemble.csv", "name,", "name,x,", "row 1 does not fit its header"),
    ],
)
def test_a_damaged_record_is_named(many: Path, name: str, old: str, new: str, what: str) -> None:
    text = (many / name).read_text()
    assert old in text
    (many / name).write_text(text.replace(old, new, 1))
    with pytest.raises(DamagedFile) as error:
        page.write_report(many)
    assert name in str(error.value)
    assert what in str(error.value)
