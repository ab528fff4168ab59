"""The matrix of extreme cases in its small form, and what becomes of a case that crashes."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from taichi_ldem.errors import SceneError
from taichi_ldem.studies.extremes import study
from taichi_ldem.studies.extremes.bench import Result
from taichi_ldem.studies.extremes.case import REFUSED, STABLE, STOPPED, Case
from taichi_ldem.studies.extremes.cases import CASES


def test_there_are_as_many_cases_as_promised_with_names_of_their_own() -> None:
    assert len({case.name for case in CASES}) == len(CASES) >= 40
    assert {case.predicted for case in CASES} == {STABLE, REFUSED, STOPPED}
    assert all(case.because for case in CASES)
    # a refusal or a stop is right only with the reason in its message
    assert all(case.says for case in CASES if case.predicted != STABLE)


@pytest.mark.slow  # compiles each of its cases
def test_the_small_form_ends_as_predicted(tmp_path: Path) -> None:
    assert study.run(tmp_path, quick=True, workers=1) == 0
    rows = (tmp_path / "extremes.csv").read_text().splitlines()
    assert len(rows) == 1 + sum(case.quick for case in CASES)
    assert (tmp_path / "extremes.png").stat().st_size > 0
    assert (
        "time step 1.01 | 1.01 | 100 | stopped | stopped" in (tmp_path / "extremes.md").read_text()
    )


def test_a_case_that_no_name_fits_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no such case"):
        study.run(tmp_path, only=["xyzzy"])


@pytest.mark.parametrize(
    ("outcome", "message", "agrees"),
    [
        (STOPPED, "the time step 2 s is above the critical one, 1 s", True),
        (STOPPED, "the energies are not finite", False),
        (STABLE, "", False),
        ("crashed", "", False),
    ],
)
def test_a_stop_counts_only_with_its_cause(outcome: str, message: str, agrees: bool) -> None:
    case = Case("c", "free", STOPPED, "theory", says="above the critical")
    assert case.agrees(Result(outcome, message)) is agrees


def test_a_crash_takes_one_case_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = [Case(name, "free", STABLE, "theory") for name in "abc"]

    def run(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        file, names = Path(command[4]), command[5:]
        with file.open("a") as stream:
            for name in names:
                print(json.dumps({"begun": name}), file=stream)
                if name == "b":
                    return subprocess.CompletedProcess(command, -11, "", "segmentation fault")
                print(json.dumps({"name": name, "outcome": STABLE}), file=stream)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(subprocess, "run", run)
    seen = {case.name: found for case, found in study._group("free", cases, tmp_path)}
    assert [seen[name].outcome for name in "abc"] == [STABLE, "crashed", STABLE]
    assert "-11" in seen["b"].message
    assert "fault" in seen["b"].message
