"""The run folder and its summary: what goes in comes out, and foreign files stay."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.refusals import one_line

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.storage.folder import OF_EVERY_RUN, RunFolder


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


def test_force_removes_what_the_run_s_record_lists_and_nothing_else(tmp_path):
    folder = RunFolder.create(tmp_path, force=True, files=["force.png"])
    folder.claim(["crack_7.5ms_below.png", "shot_1.4ms.png", "movie.mp4"])
    own = ["scene.toml", "history.csv", "fields.vtkhdf", "summary.json", "force.png", "movie.mp4"]
    own += ["crack_7.5ms_below.png", "shot_1.4ms.png", "checkpoint.h5.tmp", "run.json.tmp"]
    foreign = ["shot_2ms.png", "notes.md", "crack_photo.png", "scene.toml.bak", "report.html"]
    foreign += ["movie.gif", "probes.csv"]
    for name in (*own, *foreign):
        (tmp_path / name).write_text("x")
    (tmp_path / "sub").mkdir()
    RunFolder.create(tmp_path, force=True, files=["force.png"])
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*foreign, "sub", "run.json"])


@pytest.mark.parametrize(
    "name", ["scene.toml", "history.csv", "probes.csv", "crack_7.5ms_below.png", "run.json"]
)
@pytest.mark.parametrize("begun", [False, True])
def test_force_refuses_files_that_no_run_has_written(tmp_path, name, begun):
    """Also those that only the end of the new run would replace."""
    if begun and name in OF_EVERY_RUN:
        pytest.skip("a run's record lists it")
    if begun:
        RunFolder.create(tmp_path, force=False)
    (tmp_path / name).write_text("precious")
    for refused in (RunFolder.check, RunFolder.create):
        with pytest.raises(SceneError) as error:
            refused(tmp_path, force=True, files=["probes.csv"])
        assert f"lists '{name}'" in one_line(error)
    assert (tmp_path / name).read_text() == "precious"


@pytest.mark.parametrize(
    "record",
    [
        '{"processes": [{"version": "0.1.0"}]}',
        '{"processes": [], "files": ["../precious"]}',
        '{"processes": [], "files": 3}',
        "[" * 100_000,
    ],
)
def test_a_record_without_a_list_or_with_a_bad_one_gives_nothing_away(tmp_path, record):
    """An earlier version kept no list; a list may come from anywhere."""
    (tmp_path / "precious").write_text("precious")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text(record)
    (tmp_path / "run" / "scene.toml").write_text("precious")
    with pytest.raises(SceneError):
        RunFolder.create(tmp_path / "run", force=True)
    assert (tmp_path / "precious").read_text() == "precious"
    assert (tmp_path / "run" / "scene.toml").read_text() == "precious"


@pytest.mark.parametrize("link", [False, True])
def test_the_scene_that_is_run_is_never_replaced(tmp_path, link):
    RunFolder.create(tmp_path / "run", force=False)
    scene = tmp_path / "run" / "scene.toml"
    scene.write_text("# the user's comments")
    source = tmp_path / "link.toml" if link else scene
    if link:
        source.symlink_to(scene)
    with pytest.raises(SceneError) as error:
        RunFolder.check(tmp_path / "run", force=True, source=source)
    assert f"holds the scene '{source}' itself" in one_line(error)
    RunFolder.check(tmp_path / "run", force=True, source=tmp_path / "other.toml")


def test_a_picture_of_somebody_else_is_not_drawn_over(tmp_path):
    folder = RunFolder.create(tmp_path, force=False)
    (tmp_path / "movie.mp4").write_text("precious")
    with pytest.raises(SceneError) as error:
        folder.claim(["movie.mp4"])
    assert "movie.mp4' is not this run's" in one_line(error)
    folder.claim(["movie.gif"])
    (tmp_path / "movie.gif").touch()
    folder.claim(["movie.gif"])


def test_a_record_keeps_its_list_when_a_process_is_added(tmp_path):
    folder = RunFolder.create(tmp_path, force=False)
    folder.claim(["report.html"])
    folder.write_provenance({"version": "0.1.0"})
    assert "report.html" in folder.own_files()
    assert folder.processes() == [{"version": "0.1.0"}]


def test_a_link_to_nothing_is_refused_before_the_set_up(tmp_path):
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "nowhere")
    for path in (link, link / "run"):
        with pytest.raises(SceneError) as error:
            RunFolder.check(path, force=True)
        assert f"'{link}' is a link to nothing" in one_line(error)


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
    assert sorted(p.name for p in folder.path.iterdir()) == ["run.json", "summary.json"]


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
