"""A held folder is reached wherever it is renamed to, and never its successor of the same name."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.fields import FieldWriter, hexahedral_mesh, read_times
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter
from taichi_ldem.storage.place import current

POINTS, CELLS, _ = hexahedral_mesh(np.ones((1, 1, 1), dtype=bool), 1e-3, (0.0, 0.0, 0.0))


def _renamed(run: Path) -> Path:
    """Give a run's folder another name and its own to a successor; the new name."""
    moved = run.rename(run.with_name("moved"))
    run.mkdir()
    return moved


def _link_pointed_elsewhere(run: Path) -> Path:
    """Replace the folder by a link, as if it had been one all the time."""
    moved, other = run.rename(run.with_name("moved")), run.with_name("other")
    other.mkdir()
    run.symlink_to(other)
    return moved


@pytest.mark.parametrize("move", [_renamed, _link_pointed_elsewhere])
def test_every_file_goes_to_the_folder_that_was_held(
    tmp_path: Path, move: Callable[[Path], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    with RunFolder.held(run):
        folder = RunFolder.create(run, force=False)
        history = HistoryWriter(folder.history_file, ["time_s"])
        fields = FieldWriter(folder.fields_file, POINTS, CELLS)
        folder.write_scene("begun")
        moved = move(run)
        history.append([1.0])
        for step in range(2):
            fields.append(step, np.zeros((8, 3)), np.zeros((8, 3)), np.zeros(1))
        folder.write_scene("after")
        folder.write_summary({"steps": 1})
        found = folder.now()
        write_whole(found.path / "force.png", b"picture")
        history.close()
    assert found.path == moved
    assert f"this run is in '{moved}'" in capsys.readouterr().err
    assert list(run.iterdir()) == []
    assert (moved / "scene.toml").read_text() == "after"
    assert list(read_times(moved / "fields.vtkhdf")) == [0.0, 1.0]
    assert RunFolder.open(moved).read_history()["time_s"] == [1.0]
    assert RunFolder.open(moved).read_summary() == {"steps": 1}


def test_a_link_that_is_pointed_elsewhere_while_a_run_goes_on(tmp_path: Path) -> None:
    first, second, link = tmp_path / "first", tmp_path / "second", tmp_path / "link"
    first.mkdir()
    second.mkdir()
    link.symlink_to(first)
    with RunFolder.held(link):
        link.unlink()
        link.symlink_to(second)
        RunFolder(link).write_scene("first")
        assert current(link) == first
    assert (first / "scene.toml").read_text() == "first"
    assert list(second.iterdir()) == []


def test_a_folder_that_was_removed_is_not_made_again(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with RunFolder.held(run):
        shutil.rmtree(run)
        run.mkdir()
        with pytest.raises(FileNotFoundError, match=str(run)):
            RunFolder(run).write_scene("lost")
        with pytest.raises(FileNotFoundError, match="removed or replaced"):
            RunFolder(run).now()
    assert list(run.iterdir()) == []


def test_a_relative_folder_stays_the_same_where_the_working_directory_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    with RunFolder.held(Path("run")):
        os.chdir("elsewhere")
        RunFolder(Path("run")).write_scene("here")
        assert current(Path("run")) == tmp_path / "run"
    assert (tmp_path / "run" / "scene.toml").read_text() == "here"


def test_a_folder_that_is_held_is_refused_to_another(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with RunFolder.held(run):
        with pytest.raises(SceneError) as error, RunFolder.held(run):
            pass
        assert "is in use by process" in one_line(error)
