"""A problem of the gallery from the command line to its page; `make gallery-quick` runs all."""

import json
from pathlib import Path

import pytest
from support.command import ldem


@pytest.mark.slow
def test_a_quick_problem_is_run_drawn_and_judged_and_not_run_again(tmp_path: Path) -> None:
    out = tmp_path / "gallery"
    words = ("gallery", "hertz", "--quick", "--out", str(out))
    done = ldem(*words)
    assert done.returncode == 0, done.stderr
    assert "hertz/coarse: begins" in done.stdout
    record = json.loads((out / "gallery.json").read_text())
    (problem,) = record["problems"].values()
    assert record["quick"]
    assert problem["failed"] == {}
    # the force at the largest of three depths, where the contact is widest, is Hertz's within 10 %
    assert problem["findings"][-1]["holds"]
    page = (out / "gallery.md").read_text()
    assert "[Hertz's contact](#hertzs-contact)" in page
    picture = out / "images" / "gallery" / "hertz.png"
    assert picture.stat().st_size > 10_000
    assert "images/gallery/hertz.png" in page
    again = ldem(*words)
    assert again.returncode == 0, again.stderr
    assert "begins" not in again.stdout
