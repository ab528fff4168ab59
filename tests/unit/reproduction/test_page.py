"""The reproduction's report from run folders."""

import json
from pathlib import Path

from support.synthetic import synthetic_run

from taichi_ldem.reproduction.items import chosen
from taichi_ldem.reproduction.page import write
from taichi_ldem.reproduction.sections import Context


def test_the_report_compares_with_the_paper(tmp_path: Path) -> None:
    run = synthetic_run(tmp_path / "runs/impact")
    (run.path / "force.png").write_bytes(b"picture")
    failed = {"ensemble": "ended with exit code 5"}
    items = chosen("fig2,fig11,fig12,fig16")
    text = write(items, Context(tmp_path), failed).text
    # of the synthetic summary, the paper's text and its Table 1
    assert "| P1 [N] | 605 | 600 |  | +1 % from the paper |" in text
    t2 = "| t2 (force) [ms] | none | 7.50 | 6.40 to 9.40 |"
    summary = run.read_summary()
    t2 = t2.replace("none", f"{1e3 * summary['failure_time_s']:.2f}")
    assert t2 in text
    assert "| radial cracks | none | 5 | 6 to 9 |" in text
    assert "Bars hold E eps_p = 58.5 MPa where 75 MPa was measured: the plate cracks early." in text
    assert "| EA_d [N] | " in text
    assert "![Fig. 11: force and velocity, derived defaults: force](images/fig11.png)" in text
    assert (tmp_path / "images/fig11.png").read_bytes() == b"picture"
    assert (tmp_path / "images/fig2.png").stat().st_size > 10_000
    assert text.rstrip().count("Missing: ended with exit code 5.") == 1
    titles = [line for line in text.splitlines() if line.startswith("## ")]
    assert titles == [*(f"## {item.title}" for item in items), "## Cost"]


def test_table_2_averages_pairs(tmp_path: Path) -> None:
    folder = tmp_path / "runs/modes"
    folder.mkdir(parents=True)
    summary = {
        "names": ["(0, 0)", "(1, 0)", "(1, 0)", "outside"],
        "frequencies_hz": [1.7e3, 3.4e3, 3.6e3, 9.0],
    }
    (folder / "summary.json").write_text(json.dumps(summary))
    text = write(chosen("table2"), Context(tmp_path), {}).text
    assert "| mode (0, 0) [kHz] | 1.700 | 1.460 |  | +16 % from the paper |" in text
    assert "| mode (1, 0) [kHz] | 3.500 | 3.040 |" in text
    assert "| mode (0, 2) [kHz] | none | 11.850 |" in text


def test_runs_whose_files_do_not_fit_together_are_named(tmp_path: Path) -> None:
    folder = tmp_path / "runs/modes"
    folder.mkdir(parents=True)
    summary = {"names": ["(0, 0)"], "frequencies_hz": [1.7e3, 3.4e3]}
    (folder / "summary.json").write_text(json.dumps(summary))
    report = write(chosen("table2,fig10"), Context(tmp_path), {})
    assert f"Missing: files of '{folder}' do not fit together: ValueError" in report.text
    assert len(report.damaged) == 1
    (folder / "summary.json").write_text("{")
    report = write(chosen("table2"), Context(tmp_path), {})
    assert [text.split(": ")[0] for text in report.damaged] == [
        f"cannot read '{folder / 'summary.json'}'"
    ]
