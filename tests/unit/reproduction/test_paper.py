"""``ldem paper``: input that is refused."""

from pathlib import Path

import pytest
from support.paths import ROOT

from taichi_ldem.cli import main
from taichi_ldem.errors import SceneError
from taichi_ldem.reproduction.paper import reproduce


def test_bad_input_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["paper", "--only", "fig99"]) == 2
    assert "--only fig99: must be one of fig2" in capsys.readouterr().err
    (tmp_path / "paper.json").write_text('{"quick": true}')
    monkeypatch.chdir(ROOT)
    with pytest.raises(SceneError, match="--resume goes on"):
        reproduce(tmp_path, only="fig2")
    with pytest.raises(SceneError, match="was begun with --quick"):
        reproduce(tmp_path, only="fig2", resume=True)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError, match="in a checkout"):
        reproduce(tmp_path / "new", only="fig2")
