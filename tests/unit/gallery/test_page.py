"""The gallery's page."""

import json
from pathlib import Path

from matplotlib.figure import Figure

from taichi_ldem.gallery.page import judged, write
from taichi_ldem.gallery.problem import Finding, Problem, Runs, near


def problem(findings: list[Finding]) -> Problem:
    def draw(figure: Figure, runs: Runs) -> None:
        figure.subplots().plot([0, 1])

    return Problem("A bar: pulled", "It is pulled.", "Hooke 1678.", (), lambda runs: findings, draw)


def test_the_page_tells_hits_misses_and_failures(tmp_path: Path) -> None:
    findings = [near("E", "GPa", 3.3, 3.35, 0.05), near("nu", "", 0.3, 0.25, 0.05, run="x")]
    outcomes = [
        judged("bar", problem(findings), {}, {}),
        judged("lost", problem([]), {}, {"lost/run": "exit code 2: no"}),
    ]
    page = write(outcomes, tmp_path, quick=False).read_text()
    assert "| [A bar: pulled](#a-bar-pulled) | 1 of 2 hold | 0 |" in page
    assert "| E [GPa] | 3.35 ± 5 % | 3.3 | -1.5 % of the middle | holds |" in page
    assert "| x: nu | 0.25 ± 5 % | 0.3 | +14.3 % beyond its end | **misses** |" in page
    assert "Missing: lost/run: exit code 2: no." in page
    assert (tmp_path / "images/gallery/bar.png").stat().st_size > 1000
    assert not (tmp_path / "images/gallery/lost.png").exists()
    record = json.loads((tmp_path / "gallery.json").read_text())
    assert [f["holds"] for f in record["problems"]["bar"]["findings"]] == [True, False]
    assert record["problems"]["lost"]["failed"] == {"lost/run": "exit code 2: no"}
