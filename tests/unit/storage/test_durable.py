"""Files that survive: killed between two system calls, a full disk, a second process."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from taichi_ldem.errors import SceneError
from taichi_ldem.storage import durable
from taichi_ldem.storage.fields import (
    FieldWriter,
    hexahedral_mesh,
    read_broken_bars,
    read_fields,
    read_times,
)
from taichi_ldem.storage.history import HistoryWriter

PAGE = 4096  # a kill may cut a write at a page of the cache, not within one


class Killed(BaseException):
    """Stands for SIGKILL: no handler of the writer's must see it."""


class Recorder:
    """Counts written pages and stops the writer before page number ``limit``."""

    def __init__(self) -> None:
        self.limit = sys.maxsize
        self.pages = 0

    def __call__(self, file, content: bytes, at: int) -> None:
        start = 0
        while start < len(content):
            if self.pages == self.limit:
                raise Killed
            self.pages += 1
            stop = min(len(content), (at + start) // PAGE * PAGE + PAGE - at)
            file.seek(at + start)
            assert file.write(content[start:stop]) == stop - start
            start = stop


def _grow(writer: FieldWriter, points: np.ndarray, cells: int, first: int, last: int) -> None:
    """Frames and broken bars as a run adds them; their values follow from their numbers."""
    for n in range(first, last):
        noise = np.random.default_rng(n)
        bars = 40 * n
        writer.append_broken(
            np.full(bars, float(n)), noise.random((bars, 3)), noise.integers(0, 14, bars)
        )
        writer.append(float(n), noise.random(points.shape), points, noise.random(cells))


def _check(path: Path, least: int, most: int) -> None:
    """What the file says it has must be what was put in: at three steps, and the bars before."""
    times = read_times(path)
    assert least <= len(times) <= most
    np.testing.assert_array_equal(times, np.arange(len(times)))
    for n in {0, len(times) // 2, len(times) - 1}:
        noise = np.random.default_rng(n)
        noise.random((40 * n, 3))
        noise.integers(0, 14, 40 * n)
        fields = read_fields(path, n)
        expected = noise.random(fields.points.shape).astype(np.float32)
        np.testing.assert_array_equal(fields.displacement, expected)
    broken_at = np.repeat(np.arange(least), 40 * np.arange(least))
    np.testing.assert_array_equal(read_broken_bars(path).time_s[: len(broken_at)], broken_at)


@pytest.mark.parametrize("steps", [(2, 3), pytest.param((64, 65), marks=pytest.mark.slow)], ids=str)
def test_fields_open_after_a_kill_at_any_moment(tmp_path, monkeypatch, steps):
    """Every page that an append writes is the last one once; B-trees split at 64 entries."""
    points, hexahedra, _ = hexahedral_mesh(np.ones((1, 5, 5), dtype=bool), 1.0, (0.0, 0.0, 0.0))
    start, path = tmp_path / "start.vtkhdf", tmp_path / "fields.vtkhdf"
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    writer = FieldWriter(start, points, hexahedra)
    _grow(writer, points, len(hexahedra), 0, steps[0])
    recorder = Recorder()
    monkeypatch.setattr(durable, "_write_all", recorder)
    limit, killed = 0, True
    while killed:
        shutil.copy(start, path)
        writer._path = path
        recorder.limit, recorder.pages, killed = limit, 0, False
        try:
            _grow(writer, points, len(hexahedra), *steps)
        except Killed:
            killed = True
        _check(path, *steps)
        limit += 1
    assert limit > 10
    assert len(read_times(path)) == steps[1]


def test_what_came_after_a_checkpoint_is_cut_at_any_moment(tmp_path, monkeypatch):
    points, hexahedra, _ = hexahedral_mesh(np.ones((1, 5, 5), dtype=bool), 1.0, (0.0, 0.0, 0.0))
    start, path = tmp_path / "start.vtkhdf", tmp_path / "fields.vtkhdf"
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    _grow(FieldWriter(start, points, hexahedra), points, len(hexahedra), 0, 6)
    recorder = Recorder()
    monkeypatch.setattr(durable, "_write_all", recorder)
    limit, killed = 0, True
    while killed:
        shutil.copy(start, path)
        recorder.limit, recorder.pages, killed = limit, 0, False
        try:
            writer = FieldWriter(path, points, hexahedra, written=(4, 240))
            _grow(writer, points, len(hexahedra), 4, 5)
        except Killed:
            killed = True
        _check(path, 4, 6)
        limit += 1
    assert len(read_times(path)) == 5
    assert len(read_broken_bars(path).bar) == 240 + 160
    assert read_fields(path).displacement.shape == points.shape
    with pytest.raises(SceneError, match="holds fewer fields or broken bars than the checkpoint"):
        FieldWriter(path, points, hexahedra, written=(6, 240))


# --- whole files ----------------------------------------------------------------------------------


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "file"
    durable.write_whole(path, b"old")
    recorder = Recorder()
    monkeypatch.setattr(durable, "_write_all", recorder)
    content = bytes(3 * PAGE)
    for limit in range(4):
        recorder.limit, recorder.pages = limit, 0
        if limit < 3:
            with pytest.raises(Killed):
                durable.write_whole(path, content)
            assert path.read_bytes() == b"old"
        else:
            durable.write_whole(path, content)
    assert path.read_bytes() == content


def _full(file, content: bytes, at: int) -> None:
    file.seek(at)
    file.write(content[: len(content) // 2])
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch):
    points, hexahedra, _ = hexahedral_mesh(np.ones((1, 5, 5), dtype=bool), 1.0, (0.0, 0.0, 0.0))
    fields, history = tmp_path / "fields.vtkhdf", tmp_path / "history.csv"
    writer = FieldWriter(fields, points, hexahedra)
    _grow(writer, points, len(hexahedra), 0, 3)
    rows = HistoryWriter(history, ("time_s", "force_n"))
    rows.append((0.0, 1.0))
    with monkeypatch.context() as full:
        full.setattr(durable, "_write_all", _full)
        for attempt in (
            lambda: _grow(writer, points, len(hexahedra), 3, 4),
            lambda: rows.append((1.0, 2.0)),
            lambda: durable.write_whole(fields, b"x"),
        ):
            with pytest.raises(OSError, match=r"No space left on device: '.*(fields|history)"):
                attempt()
    _check(fields, 3, 3)
    assert history.read_text().splitlines()[:2] == ["time_s,force_n", "0.0,1.0"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fields.vtkhdf", "history.csv"]
    # there is room again: what the full disk had taken of the row is written over
    rows.append((1.0, 2.0))
    assert history.read_text() == "time_s,force_n\n0.0,1.0\n1.0,2.0\n"
    _grow(writer, points, len(hexahedra), 3, 4)
    _check(fields, 4, 4)


def test_a_removed_history_is_noticed(tmp_path):
    rows = HistoryWriter(tmp_path / "history.csv", ("time_s",))
    (tmp_path / "history.csv").unlink()
    with pytest.raises(FileNotFoundError, match=r"history\.csv"):
        rows.append((0.0,))


# --- lock -----------------------------------------------------------------------------------------

HOLD = """
import sys, time
from pathlib import Path
from taichi_ldem.storage.durable import locked
with locked(Path(sys.argv[1])):
    print("locked", flush=True)
    time.sleep(60)
"""


def test_a_second_process_is_refused_and_a_dead_one_leaves_no_lock(tmp_path):
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "locked\n"
    try:
        for attempt in (
            lambda: durable.locked(tmp_path).__enter__(),
            lambda: durable.refuse_locked(tmp_path),
        ):
            with pytest.raises(SceneError, match=f"in use by process {process.pid} on ") as error:
                attempt()
            assert "\n" not in str(error.value)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    durable.refuse_locked(tmp_path)
    with durable.locked(tmp_path):
        pass


def test_hdf5_reads_its_own_changes_before_they_are_written(tmp_path):
    path = tmp_path / "file.h5"
    with durable.created(path) as file:
        file.create_dataset("values", data=np.arange(10), chunks=(4,), maxshape=(None,))
    before = path.read_bytes()
    with durable.Patch(path) as patch, h5py.File(patch, "r+") as file:
        file["values"].resize(20, axis=0)
        file["values"][10:] = 7
        file.flush()
        np.testing.assert_array_equal(file["values"][:], [*range(10), *[7] * 10])
    assert path.read_bytes() == before
