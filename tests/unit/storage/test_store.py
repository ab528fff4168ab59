"""The run folder and its files: what goes in comes out, also after interruptions."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from taichi_ldem.errors import SceneError
from taichi_ldem.storage.fields import (
    FieldWriter,
    hexahedral_mesh,
    read_broken_bars,
    read_fields,
    read_times,
)
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter


def one_line(error: pytest.ExceptionInfo[SceneError]) -> str:
    message = str(error.value)
    assert message
    assert "\n" not in message
    return message


# --- run folder -----------------------------------------------------------------------------------


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


# --- summary and history --------------------------------------------------------------------------


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


def test_history_keeps_every_bit(tmp_path):
    folder = RunFolder.create(tmp_path / "run", force=False)
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.random(50))
    with HistoryWriter(folder.history_file, ("time_s", "force_n", "broken_bars")) as history:
        for n, time in enumerate(times):
            history.append((time, float(time) / 3.0, n))
            assert len(folder.read_history()["time_s"]) == n + 1  # on disk at once
    table = folder.read_history()
    assert list(table) == ["time_s", "force_n", "broken_bars"]
    np.testing.assert_array_equal(table["time_s"], times)
    np.testing.assert_array_equal(table["force_n"], times / 3.0)
    assert folder.history_file.read_text().splitlines()[1].endswith(",0")


def test_a_history_line_cut_off_by_a_kill_is_dropped(tmp_path):
    folder = RunFolder.create(tmp_path / "run", force=False)
    # 12.5 may have been 12.5678: a last line without its end is not to be trusted.
    folder.history_file.write_text("time_s,force_n\n0.0,1.0\n0.5,2.0\n1.0,12.5")
    np.testing.assert_array_equal(folder.read_history()["force_n"], [1.0, 2.0])
    folder.history_file.write_text("time_s,force_n\n")
    assert folder.read_history()["time_s"].shape == (0,)


@pytest.mark.parametrize("text", ["", "time_s,force_n\n1.0\n", "time_s\nabc\n", "a,b\n1,2\n3\n"])
def test_what_is_no_history_is_refused(tmp_path, text):
    folder = RunFolder.create(tmp_path / "run", force=False)
    folder.history_file.write_text(text)
    with pytest.raises(SceneError) as error:
        folder.read_history()
    assert "history.csv" in one_line(error)


def test_a_row_of_another_length_is_refused(tmp_path):
    with (
        HistoryWriter(tmp_path / "history.csv", ("time_s", "force_n")) as history,
        pytest.raises(ValueError, match="2"),
    ):
        history.append((1.0,))


# --- mesh -----------------------------------------------------------------------------------------


def test_one_module_is_vtks_hexahedron():
    points, hexahedra, sites = hexahedral_mesh(np.ones((1, 1, 1), dtype=bool), 0.5, (1.0, 2.0, 3.0))
    corners = points[hexahedra[0]]
    # VTK_HEXAHEDRON: bottom face counter-clockwise seen from above, then the top face.
    expected = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    expected += [(x, y, 1) for x, y, _ in expected]
    np.testing.assert_allclose(corners, (1.0, 2.0, 3.0) + 0.5 * np.array(expected), atol=1e-15)
    np.testing.assert_array_equal(sites[hexahedra[0]][:, ::-1], expected)


def test_mesh_has_the_corners_of_existing_modules_only():
    mask = np.zeros((2, 3, 4), dtype=bool)
    mask[0, 0, 0] = mask[1, 2, 3] = mask[1, 2, 2] = True
    points, hexahedra, sites = hexahedral_mesh(mask, 1.0, (0.0, 0.0, 0.0))
    assert len(points) == 8 + 12  # a single module, and two that share a face
    np.testing.assert_allclose(
        points[hexahedra].mean(axis=1), np.argwhere(mask)[:, ::-1] + 0.5, atol=1e-15
    )
    np.testing.assert_allclose(points, sites[:, ::-1], atol=0)
    assert len(np.unique(hexahedra)) == len(points)


# --- fields ---------------------------------------------------------------------------------------


def make_fields(path: Path, steps: int = 3):
    """A small grid with a hole and random fields; what went in."""
    rng = np.random.default_rng(2)
    mask = np.ones((2, 3, 4), dtype=bool)
    mask[1, 1, 1] = False
    points, hexahedra, _ = hexahedral_mesh(mask, 1e-3, (-2e-3, -1.5e-3, 0.0))
    writer = FieldWriter(path, points, hexahedra)
    stored = []
    for n in range(steps):
        displaced, velocity = rng.normal(size=(2, len(points), 3))
        stored.append((0.25 * n, displaced, velocity, rng.random(len(hexahedra))))
        writer.append(*stored[-1])
    return writer, points, hexahedra, stored


def test_vtk_reads_what_went_in_at_every_time(tmp_path):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
    from vtkmodules.vtkIOHDF import vtkHDFReader

    _, points, hexahedra, stored = make_fields(tmp_path / "fields.vtkhdf")
    reader = vtkHDFReader()
    reader.SetFileName(str(tmp_path / "fields.vtkhdf"))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert times == (0.0, 0.25, 0.5)
    for time, displaced, velocity, broken in reversed(stored):
        reader.UpdateTimeStep(time)
        grid = reader.GetOutputDataObject(0)
        np.testing.assert_array_equal(vtk_to_numpy(grid.GetPoints().GetData()), points)
        cells = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 8)
        np.testing.assert_array_equal(cells, hexahedra)
        assert {grid.GetCellType(n) for n in range(len(hexahedra))} == {12}  # VTK_HEXAHEDRON
        for name, array in (("displacement_m", displaced), ("velocity_m_s", velocity)):
            read = vtk_to_numpy(grid.GetPointData().GetArray(name))
            np.testing.assert_array_equal(read, array.astype(np.float32))
        read = vtk_to_numpy(grid.GetCellData().GetArray("broken_fraction"))
        np.testing.assert_array_equal(read, broken.astype(np.float32))


def test_readers_return_what_went_in_at_every_step(tmp_path):
    path = tmp_path / "fields.vtkhdf"
    _, points, hexahedra, stored = make_fields(path)
    np.testing.assert_array_equal(read_times(path), [0.0, 0.25, 0.5])
    for step, (time, displaced, velocity, broken) in enumerate(stored):
        fields = read_fields(path, step)
        assert fields.time == time
        np.testing.assert_array_equal(fields.points, points)
        np.testing.assert_array_equal(fields.hexahedra, hexahedra)
        np.testing.assert_array_equal(fields.displacement, displaced.astype(np.float32))
        np.testing.assert_array_equal(fields.velocity, velocity.astype(np.float32))
        np.testing.assert_array_equal(fields.broken_fraction, broken.astype(np.float32))
    assert read_fields(path).time == 0.5
    with pytest.raises(SceneError) as error:
        read_fields(path, 3)
    assert "3" in one_line(error)


def test_mesh_is_stored_once_and_the_type_is_fixed_length_ascii(tmp_path):
    _, points, hexahedra, _ = make_fields(tmp_path / "fields.vtkhdf")
    with h5py.File(tmp_path / "fields.vtkhdf") as file:
        root = file["VTKHDF"]
        kind = root.attrs.get_id("Type").get_type()
        assert not kind.is_variable_str()
        assert (kind.get_size(), kind.get_cset()) == (len("UnstructuredGrid"), h5py.h5t.CSET_ASCII)
        assert len(root["Points"]) == len(points)
        assert len(root["Offsets"]) == len(hexahedra) + 1
        assert not root["Steps/PointOffsets"][:].any()
        assert root["Steps/CellOffsets"].shape == (3, 1)
        displacement = root["PointData/displacement_m"]
        assert displacement.chunks == (len(points), 3)
        assert (displacement.compression, displacement.shuffle) == ("gzip", True)


def test_an_interrupted_append_is_not_seen_and_is_overwritten(tmp_path):
    path = tmp_path / "fields.vtkhdf"
    writer, points, hexahedra, stored = make_fields(path, steps=2)
    with h5py.File(path, "r+") as file:  # all of a step but its count, which is written last
        root = file["VTKHDF"]
        root["PointData/displacement_m"].resize(3 * len(points), axis=0)
        root["Steps/Values"].resize(3, axis=0)
        root["Steps/PointDataOffsets/displacement_m"].resize(3, axis=0)
    assert len(read_times(path)) == 2
    np.testing.assert_array_equal(read_fields(path).displacement, np.float32(stored[1][1]))
    writer.append(9.0, points, 2 * points, np.ones(len(hexahedra)))
    np.testing.assert_array_equal(read_times(path), [0.0, 0.25, 9.0])
    np.testing.assert_array_equal(read_fields(path).displacement, points.astype(np.float32))
    np.testing.assert_array_equal(read_fields(path, 1).velocity, np.float32(stored[1][2]))


def test_fields_open_after_a_kill_between_writes(tmp_path):
    code = (
        "import os, sys, signal, numpy as np\n"
        "from taichi_ldem.storage.fields import FieldWriter, hexahedral_mesh\n"
        "p, h, _ = hexahedral_mesh(np.ones((1, 2, 2), dtype=bool), 1.0, (0, 0, 0))\n"
        "w = FieldWriter(sys.argv[1], p, h)\n"
        "w.append(0.0, p, p, np.zeros(4)); w.append(1.0, 2 * p, p, np.ones(4))\n"
        "w.append_broken(np.ones(1), np.ones((1, 3)), np.ones(1, dtype=np.uint8))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    path = tmp_path / "fields.vtkhdf"
    done = subprocess.run([sys.executable, "-c", code, str(path)], timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    fields = read_fields(path)
    assert fields.time == 1.0
    np.testing.assert_array_equal(fields.displacement, 2 * fields.points)
    assert len(read_broken_bars(path).bar) == 1


def test_fields_of_another_shape_are_refused_before_anything_is_written(tmp_path):
    path = tmp_path / "fields.vtkhdf"
    writer, points, hexahedra, _ = make_fields(path, steps=1)
    with pytest.raises(ValueError, match="broken_fraction"):
        writer.append(1.0, points, points, np.zeros(len(hexahedra) + 1))
    assert len(read_times(path)) == 1


def test_broken_bars_accumulate_in_order(tmp_path):
    path = tmp_path / "fields.vtkhdf"
    writer, *_ = make_fields(path, steps=1)
    rng = np.random.default_rng(3)
    times, places = np.sort(rng.random(30)), rng.normal(size=(30, 3))
    bars = rng.integers(0, 14, 30).astype(np.uint8)
    for part in (slice(0, 10), slice(10, 10), slice(10, 30)):
        writer.append_broken(times[part], places[part], bars[part])
    read = read_broken_bars(path)
    np.testing.assert_array_equal(read.time_s, times)
    np.testing.assert_array_equal(read.position_m, places)
    np.testing.assert_array_equal(read.bar, bars)
    with h5py.File(path) as file:
        assert "diagonal" in file["BrokenBars/bar"].attrs["numbering"]


@pytest.mark.parametrize("content", [None, b"", b"no HDF5 at all"])
def test_unreadable_fields_are_one_line(tmp_path, content):
    path = tmp_path / "fields.vtkhdf"
    if content is not None:
        path.write_bytes(content)
    for read in (read_times, read_fields, read_broken_bars):
        with pytest.raises(SceneError) as error:
            read(path)
        assert "fields.vtkhdf" in one_line(error)


def test_another_hdf5_file_is_one_line(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["data"] = 1
    for read in (read_times, read_fields, read_broken_bars):
        with pytest.raises(SceneError) as error:
            read(tmp_path / "other.h5")
        assert "other.h5" in one_line(error)
