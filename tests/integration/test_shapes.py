"""A run of a plate from a file, with a hole and a notch that opens: its folder is enough."""

import signal
from pathlib import Path

import numpy as np
import pytest
from support.command import SCENE, cut_off, ldem

from taichi_ldem.storage.compare import differences
from taichi_ldem.storage.folder import RunFolder

SHAPES = """
[[hole]]
shape = "circle"
centre = [-0.003, 0.0025]
diameter = 0.0016

[[notch]]
points = [[0.001, 0.001, 0.0], [0.003, 0.002, 0.0], [0.001, 0.001, 0.0016]]
time = 3.05e-5
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shapes")
    body = np.ones((18, 18))
    body[:3, :3] = 0
    np.save(folder / "plate.npy", body)
    plate = '[plate]\nshape = "mask"\nmask = "plate.npy"\n'
    more = "field_interval = 1e-5\nfragments = true\n"
    text = SCENE.replace("[plate]\n", plate) + more + SHAPES
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml"


@pytest.mark.slow
def test_notches_open_alike_with_other_threads_and_after_a_kill(scene: Path) -> None:
    whole, other = scene.parent / "whole", scene.parent / "other"
    for out, threads in ((whole, "1"), (other, "2")):
        done = ldem("impact", str(scene), "--out", str(out), "--threads", threads, "--quiet")
        assert done.returncode == 0, done.stderr
    taken = RunFolder.open(whole).read_history()["notch_j"]
    assert taken[30] == 0 < taken[31] == taken[-1]
    assert (whole / "body.npy").read_bytes() == (scene.parent / "plate.npy").read_bytes()
    for rows in (10, 45):  # before and after the notch opens
        out = scene.parent / f"cut_{rows}"
        code, errors = cut_off(scene, out, rows, signal.SIGTERM)
        assert code == 143, errors
        moved = out.rename(scene.parent / f"moved_{rows}")
        done = ldem("resume", str(moved), "--quiet")
        assert done.returncode == 0, done.stderr
        assert differences(whole, moved) == []
    assert differences(whole, other) == []


@pytest.mark.slow
def test_a_run_is_resumed_without_the_file_that_it_was_given(scene: Path) -> None:
    out, file = scene.parent / "lone", scene.parent / "plate.npy"
    code, errors = cut_off(scene, out, 10, signal.SIGTERM)
    assert code == 143, errors
    kept = file.read_bytes()
    file.unlink()
    try:
        assert ldem("resume", str(out), "--quiet").returncode == 0
        (out / "body.npy").write_bytes(kept[:-8] + bytes(8))
        done = ldem("info", str(out / "scene.toml"))
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert "body.npy' has changed: its SHA-256 is " in line
    finally:
        file.write_bytes(kept)
