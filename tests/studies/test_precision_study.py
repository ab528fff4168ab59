import json
from pathlib import Path

import pytest

from studies.precision import main, table


def _folder(path: Path, **values: float | None) -> Path:
    path.mkdir()
    (path / "summary.json").write_text(json.dumps(values))
    return path


def test_a_difference_stands_beside_the_spread(tmp_path: Path) -> None:
    double = _folder(tmp_path / "d", failure_time_s=6.4e-3, first_peak_force_n=440.0)
    single = _folder(tmp_path / "s", failure_time_s=6.5e-3, first_peak_force_n=None)
    # deviation of 6, 7, 8 ms: 1 ms
    seeds = [_folder(tmp_path / f"{n}", failure_time_s=n * 1e-3) for n in (6, 7, 8)]
    text = table(double, single, seeds)
    assert "| failure time t2 [ms] | 6.4 | 6.5 | +0.1 | 1 (3 runs) | 0.10 |" in text
    assert "| first peak force P1 [N] | - | - | - | - | - |" in text


def test_a_folder_without_a_run_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    double = _folder(tmp_path / "d")
    assert main(["--double", str(double), "--single", str(tmp_path / "none")]) == 2
    assert capsys.readouterr().err.startswith("error: ")
