"""Checkpoints that no run wrote: refused before anything is allocated."""

import os
import time
from pathlib import Path

import h5py
import pytest
from support.scenes import GOOD

from taichi_ldem.scene import parse_scene_text
from taichi_ldem.storage import checkpoint as cp
from taichi_ldem.storage.durable import MemoryFile

SCENE = parse_scene_text(GOOD, "scene")


def content(**attributes: object) -> tuple[MemoryFile, dict[str, object]]:
    image = MemoryFile()
    given = {"format": cp.FORMAT, "version": cp.__version__, "scene": cp.scene_to_toml(SCENE)}
    counts = {"time": 0.0, "wall": 0.0, "field_steps": 0, "broken_bars": 0, "rows": 0}
    return image, given | counts | attributes


def refused(arrays: dict[str, tuple[int, ...]], **attributes: object) -> str:
    """The reason why a file of arrays that HDF5 has not allocated is refused."""
    image, given = content(**attributes)
    with image as file:
        file.attrs.update(given)
        for name, shape in arrays.items():
            file.create_dataset(name, shape=shape, dtype="f8")
    with pytest.raises(cp.CheckpointError) as error:
        cp.decode(cp._head(image.content) + image.content)
    return str(error.value)


def test_arrays_are_added_up_before_one_is_allocated(monkeypatch: pytest.MonkeyPatch) -> None:
    """20 000 of them took 94 s and ended in a MemoryError: each alone was below the limit."""
    monkeypatch.setattr(h5py.Dataset, "__getitem__", None)
    arrays = {f"state/{n:03d}": (500,) for n in range(300)}  # a third of the file in all would fit
    assert refused(arrays).startswith("is no checkpoint of this program: 'state/")


def test_there_are_no_more_arrays_than_a_run_has() -> None:
    begun = time.process_time()
    assert "'state/" in refused({f"state/{n:04d}": (0,) for n in range(cp.MOST_ARRAYS + 1)})
    assert time.process_time() - begun < 5.0


@pytest.mark.parametrize("rows", [10**18, 5])
def test_rows_that_no_column_has_are_not_made(rows: int) -> None:
    assert refused({"history/time_s": (0,)}, rows=rows).endswith("program: history")
    assert refused({}, rows=rows).endswith("program: history")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_a_pipe_in_a_checkpoints_place_does_not_hang(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / cp.LATEST)
    (tmp_path / cp.PREVIOUS).mkdir()
    assert list(cp.Checkpoints(tmp_path).usable(SCENE)) == []
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[-1] for line in lines] == [
        "is a pipe, a device or a folder, not a file"
    ] * 2
