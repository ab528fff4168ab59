"""The benchmark's arithmetic; nothing is timed here."""

import json
from pathlib import Path

import check
import layout
import pytest
import report
from support.paths import CONFIGS

from taichi_ldem.scene import load_scene
from taichi_ldem.solver.lanes import Lanes

SCENE = CONFIGS / "impact.toml"


def test_step_bytes_of_a_plate_counted_by_hand():
    # 2 x 1 x 1 modules: sites (4, 4, 5), one lane. All 4 x 4 rows of 3 + 4 columns are read, six
    # numbers each; inside lie 2 x 2 rows of 3 sites, each with velocity in and out, the other
    # displacement fetched and out, and a byte and a flag.
    read = 4 * 4 * 7 * 6 * 8
    inner = 2 * 2 * 3
    moved = inner * 4 * 6 * 8
    assert layout.step_bytes((4, 4, 5), Lanes(5), 8, True) == read + moved + 2 * inner
    assert layout.step_bytes((4, 4, 5), Lanes(5), 8, False) == read + moved + inner


def test_step_bytes_tend_to_five_passes_over_six_numbers():
    # far from faces and halos: displacement, velocity twice, other displacement twice
    lanes = Lanes.fitting(100_003, 4)
    sites = (1003, 1003, 100_003)
    moved = layout.step_bytes(sites, lanes, 4, True)
    assert moved / (1000 * 1000 * 100_000) == pytest.approx(5 * 6 * 4 + 1.25, rel=0.01)


@pytest.mark.parametrize("modules", layout.SIZES)
def test_scaled_scenes_are_valid_and_keep_their_proportions(modules):
    paper = load_scene(SCENE, [])
    scene = load_scene(SCENE, layout.scaled(paper, modules))
    assert scene.plate.modules == (modules, modules, 6)
    assert scene.plate.spacing == pytest.approx(paper.plate.spacing)
    for share in (
        lambda s: s.clamp.inner_diameter / s.plate.size[0],
        lambda s: s.clamp.outer_diameter / s.plate.size[0],
        lambda s: s.striker.diameter / s.plate.size[0],
    ):
        assert share(scene) == pytest.approx(share(paper), rel=1e-6)


def _run(ms):
    return {"ms": ms, "bars": 2_000_000, "step_bytes": 50_000_000, "field_bytes": 60_000_000}


def test_size_row_takes_the_median_and_divides():
    row = report.size_row([_run(9.0), _run(5.0), _run(4.0)], "f64", 2, 20.0)
    assert row["ms"] == 5.0
    assert row["mbar_s"] == pytest.approx(400)  # 2e6 bars in 5 ms
    assert row["ns_per_bar"] == pytest.approx(2.5)
    assert row["gb_s"] == pytest.approx(10)  # 50 MB in 5 ms
    assert row["copy_share"] == pytest.approx(0.5)
    assert row["bytes_per_bar"] == pytest.approx(30)


def test_table_has_a_line_a_row_and_blanks():
    row = report.size_row([_run(5.0)], "f32", 1, None)
    lines = report.table([row], report.COLUMNS).splitlines()
    assert lines[0].startswith("| bars | precision | threads | Mbar/s | ms/step |")
    assert lines[2] == "| 2,000,000 | f32 | 1 | 400 | 5.000 | 2.50 | 50.00 | 10.0 |  | 30 |"
    assert len({line.count("|") for line in lines}) == 1


def test_csv_keeps_rows_that_are_not_measured_again(tmp_path):
    path = tmp_path / "sizes.csv"
    first, other = (report.size_row([_run(5.0)], p, 1, None) for p in ("f64", "f32"))
    report.write_csv(path, report.merged(path, [first, other]))
    again = report.size_row([_run(4.0)], "f64", 1, 20.0)
    assert report.merged(path, [again]) == [other, again]


def test_ratios_compare_medians_at_the_same_precision():
    rates = {
        "ldem f64": [100.0, 300.0, 200.0],
        "ldem f32": [400.0],
        "C two-pass f64": [100.0],
        "C two-pass f32": [800.0],
        "LAMMPS bpm/spring f64": [50.0],
    }
    assert report.ratios(rates) == {
        "ldem f64 / C two-pass f64": 2.0,
        "ldem f64 / LAMMPS bpm/spring f64": 4.0,
        "ldem f32 / C two-pass f32": 0.5,
        "ldem f32 / LAMMPS bpm/spring f64": 8.0,
    }
    assert report.ratios(rates, max)["ldem f64 / C two-pass f64"] == 3.0
    rates["ldem f32"], rates["C two-pass f32"] = [400.0, 500.0, 300.0], [800.0] * 3
    rates["C two-pass f64"], rates["LAMMPS bpm/spring f64"] = [100.0] * 3, [50.0] * 3
    told = "- ldem f64 / C two-pass f64: 2.00 (single rounds 1.00 to 3.00)"
    assert told in report.peers_table(rates)


STORED = {"a processor": {"f64": 1.0, "f32": 2.0}}


@pytest.mark.parametrize(
    ("f64", "f32", "code"),
    [(1.0, 2.0, 0), (0.86, 1.71, 0), (0.84, 2.0, 1), (1.5, 1.69, 1)],
)
def test_check_fails_when_a_ratio_has_fallen_by_fifteen_percent(f64, f32, code):
    line, found = check.verdict({"f64": f64, "f32": f32}, STORED, "a processor")
    assert found == code
    assert "\n" not in line
    assert line.startswith("slower: " if code else "as fast")


def test_check_of_an_unknown_processor_says_so():
    line, code = check.verdict({"f64": 0.1}, STORED, "another")
    assert code == 0
    assert "no ratios stored for another" in line


def test_stored_baseline_can_be_read():
    stored = json.loads((Path(check.__file__).parent / "baseline.json").read_text())
    assert all(set(ratios) == {"f64", "f32"} for ratios in stored.values())
    assert all(ratio > 0 for ratios in stored.values() for ratio in ratios.values())


def test_figure_is_drawn(tmp_path):
    rows = [report.size_row([_run(5.0)], p, t, None) for p in ("f64", "f32") for t in (1, 2)]
    report.figure(tmp_path / "cost.png", rows, "a machine")
    assert (tmp_path / "cost.png").stat().st_size > 10_000
