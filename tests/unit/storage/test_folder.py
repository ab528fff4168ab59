"""The run folder and its summary: what goes in comes out, and foreign files stay."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.refusals import one_line

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.storage.folder import RunFolder


def test_a_new_folder_is_made_with_its_parents(tmp_path):
    folder = RunFolder.create(tmp_path / "outputs" / "impact", force=False)
    assert folder.path.is_dir()
    assert folder.history_file == tmp_path / "outputs" / "impact" / "history.csv"


def test_checking_makes_nothing(tmp_path):
    RunFolder.check(tmp_path / "outputs" / "impact", force=False)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_anything_in_it_is_refused_and_left_alone(tmp_path):
    (tmp_path / "history.csv").write_text("old\n")
    with pytest.raises(SceneError) as error:
        RunFolder.create(tmp_path, force=False)
    assert "--force" in one_line(error)
    assert (tmp_path / "history.csv").read_text() == "old\n"


def test_force_removes_what_a_run_writes_and_nothing_else(tmp_path):
    own = ["scene.toml", "history.csv", "fields.vtkhdf", "summary.json", "force.png"]
    own += ["crack_map.png", "crack_7.5ms_below.png", "shot_1.4ms.png"]
    own += ["shot_1.4ms_above_x0.png", "shot_2ms_cut_az25_el-35_z1e-05_energy.png"]
    foreign = ["shot_1.4ms_mine.png", "notes.md", "photo.png", "crack_photo.png", "scene.toml.bak"]
    for name in (*own, *foreign):
        (tmp_path / name).write_text("x")
    (tmp_path / "sub").mkdir()
    RunFolder.create(tmp_path, force=True)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*foreign, "sub"])


@pytest.mark.parametrize("force", [False, True])
def test_a_file_in_the_folders_place_is_refused(tmp_path, force):
    (tmp_path / "run").write_text("precious")
    for path in (tmp_path / "run", tmp_path / "run" / "deeper"):
        with pytest.raises(SceneError) as error:
            RunFolder.create(path, force=force)
        assert str(path) in one_line(error)
    assert (tmp_path / "run").read_text() == "precious"


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs Linux's unwritable /proc")
def test_a_place_where_nothing_can_be_written_is_refused():
    with pytest.raises(SceneError) as error:
        RunFolder.create(Path("/proc/run"), force=False)
    assert "/proc/run" in one_line(error)


def test_opening_names_what_is_missing(tmp_path):
    with pytest.raises(SceneError) as error:
        RunFolder.open(tmp_path / "absent")
    assert "no such folder" in one_line(error)
    (tmp_path / "scene.toml").touch()
    with pytest.raises(SceneError) as error:
        RunFolder.open(tmp_path)
    assert "history.csv" in one_line(error)
    (tmp_path / "history.csv").touch()
    assert RunFolder.open(tmp_path).path == tmp_path


def test_summary_is_valid_json_without_nan(tmp_path):
    folder = RunFolder.create(tmp_path / "run", force=False)
    assert folder.read_summary() == {}
    values = {"a": np.float32(0.5), "b": np.int64(7), "c": float("nan"), "d": [np.inf, 1.5]}
    folder.write_summary({**values, "e": {"f": np.float64("nan")}, "g": None, "h": True})
    expected = {"a": 0.5, "b": 7, "c": None, "d": [None, 1.5], "e": {"f": None}, "g": None}
    assert folder.read_summary() == {**expected, "h": True}
    json.loads(folder.summary_file.read_text(), parse_constant=pytest.fail)
    assert [p.name for p in folder.path.iterdir()] == ["summary.json"]


def test_a_summary_that_cannot_be_written_leaves_the_old_one(tmp_path):
    folder = RunFolder.create(tmp_path / "run", force=False)
    folder.write_summary({"steps": 1})
    with pytest.raises(TypeError):
        folder.write_summary({"steps": object()})
    assert folder.read_summary() == {"steps": 1}


@pytest.mark.parametrize(
    ("key", "value", "fine"),
    [
        ("first_peak_force_n", 600, True),
        ("first_peak_force_n", None, True),
        ("first_peak_force_n", [600.0], False),
        ("first_peak_force_n", "600", False),
        ("first_peak_time_s", True, False),
        ("radial_cracks", {}, False),
        ("radial_centre_m", [0.0, 1e-3], True),
        ("radial_centre_m", None, True),
        ("radial_centre_m", 0.0, False),
        ("frequencies_hz", ["x"], False),
        ("names", ["(0, 1)"], True),
        ("what_a_later_version_adds", {"a": ["b"]}, True),
    ],
)
def test_a_summary_holds_numbers_where_a_run_writes_numbers(tmp_path, key, value, fine):
    folder = RunFolder(tmp_path)
    folder.summary_file.write_text(json.dumps({key: value}))
    if fine:
        assert folder.read_summary() == {key: value}
        return
    with pytest.raises(
        DamagedFile, match=rf"summary\.json': {key} is no (list of )?number"
    ) as error:
        folder.read_summary()
    one_line(error)
