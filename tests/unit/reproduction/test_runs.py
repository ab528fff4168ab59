"""The runs of the reproduction: their commands, and how they are resumed."""

import itertools
import json
from pathlib import Path

import pytest
from support.paths import ROOT

from taichi_ldem.cli import app as cli
from taichi_ldem.reproduction import runs
from taichi_ldem.reproduction.items import ITEMS
from taichi_ldem.reproduction.runs import NEEDS, Need, conduct
from taichi_ldem.scene import load_scene
from taichi_ldem.storage.folder import RunFolder


def test_every_item_s_runs_are_known_and_their_commands_parse() -> None:
    import typer

    group = typer.main.get_command(cli.app)
    assert {name for item in ITEMS for name in item.needs} == set(NEEDS)
    for need in NEEDS.values():
        for quick, again in itertools.product((False, True), repeat=2):
            words = need.command(Path("outputs/x"), quick=quick, again=again and bool(need.resume))
            _, module, command, *rest = words
            if module != "taichi_ldem.cli":
                continue
            group.commands[command].make_context(command, list(rest)).close()
            given = [b for a, b in itertools.pairwise(rest) if a == "--set"]
            for scene in (word for word in rest if word.endswith(".toml")):
                load_scene(ROOT / scene, given)


def test_a_quick_run_is_another_command() -> None:
    need, folder = NEEDS["ensemble"], Path("x")
    words = need.command(folder, quick=True, again=True)
    assert "configs/impact_small.toml" in words
    assert [word for word in words if word.endswith(".toml")] == [words[3]]
    assert words.count("f32") == 1
    assert NEEDS["impact"].command(folder, quick=True, again=True)[2:4] == ["resume", "x"]


SCRIPT = """
import pathlib, sys
folder = pathlib.Path(sys.argv[1]); folder.mkdir(parents=True, exist_ok=True)
if len(sys.argv) == 2:
    (folder / "checkpoint.h5").touch(); sys.exit("cut off")
(folder / "summary.json").write_text(repr(sys.argv[2:]).replace("'", '"'))
"""


def test_runs_are_resumed_and_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "run.py"
    script.write_text(SCRIPT)
    resume = (str(script), "{out}", "resumed")
    need = Need("impact", (str(script), "{out}"), (), resume=resume)
    monkeypatch.setitem(NEEDS, "impact", need)
    lines: list[str] = []
    failed = conduct(["impact"], tmp_path, quick=False, resume=False, tell=lines.append)
    assert failed == {"impact": "ended with exit code 1: cut off"}
    assert conduct(["impact"], tmp_path, quick=False, resume=True, tell=lines.append) == {}
    summary = tmp_path / "runs/impact/summary.json"
    assert json.loads(summary.read_text()) == ["resumed"]
    assert conduct(["impact"], tmp_path, quick=False, resume=True, tell=lines.append) == {}
    assert lines[-1] == "impact: finished already"


def test_an_ensemble_that_was_cut_off_is_not_whole(tmp_path: Path) -> None:
    folder = tmp_path / "runs/ensemble"
    folder.mkdir(parents=True)
    for finished, whole in ((2, False), (13, True)):
        (folder / "ensemble.json").write_text(json.dumps({"finished": finished, "members": 13}))
        assert runs._is_whole(NEEDS["ensemble"], folder) is whole


def test_a_folder_that_is_renamed_gets_no_further_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They would go into a folder that has taken its place."""
    out, moved = tmp_path / "paper", tmp_path / "moved"

    def rename(*_: object, **__: object) -> int:
        out.rename(moved)
        out.mkdir()
        return 0

    monkeypatch.setattr(runs, "run_child", rename)
    with RunFolder.held(out), pytest.raises(OSError, match="was renamed or replaced"):
        conduct(["impact", "tension"], out, quick=False, resume=False, tell=lambda _: None)
    assert list(out.iterdir()) == []
