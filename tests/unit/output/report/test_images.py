"""Images inside a page: snapshots and plain maps."""

from pathlib import Path

import pytest
from support.synthetic import synthetic_run

from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.output.render import snapshots as render
from taichi_ldem.output.report.images import plain_maps, snapshots


def test_pictures_say_what_a_gap_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = synthetic_run(tmp_path / "run")
    monkeypatch.setattr(render, "render_shot", lambda *_: [])
    shots, note = snapshots(LoadedRun.read(folder), 2)
    assert [s.view for s in shots] == ["below", "above"]
    assert note == ""
    assert all("40 % or more of their bars broken; they are still" in s.note for s in shots)
    assert plain_maps(folder, [0]).note == ""  # which show all modules
