"""Stored fields and broken bars, read back by VTK and by the package, also after a kill."""

import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.refusals import one_line

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.storage.fields import (
    QUANTITIES,
    FieldWriter,
    fault_of,
    hexahedral_mesh,
    read_broken_bars,
    read_fields,
    read_quantities,
    read_times,
)


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


def test_quantities_of_the_modules_are_read_by_vtk_and_by_name(tmp_path: Path) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    path = tmp_path / "fields.vtkhdf"
    points, hexahedra, _ = hexahedral_mesh(np.ones((1, 2, 3), dtype=bool), 1e-3, (0.0, 0.0, 0.0))
    writer = FieldWriter(path, points, hexahedra, quantities=list(QUANTITIES))
    rng, stored = np.random.default_rng(5), []
    for time in (0.0, 0.5, 1.0):
        values = {name: rng.normal(size=(6, *q.width)) for name, q in QUANTITIES.items()}
        values["fragment"] = rng.integers(0, 1 << 20, 6)
        stored.append({n: v.astype(QUANTITIES[n].kind) for n, v in values.items()})
        writer.append(time, np.zeros_like(points), np.zeros_like(points), np.zeros(6), stored[-1])
    assert read_quantities(path) == list(QUANTITIES)
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    for step, wanted in enumerate(stored):
        read = read_fields(path, step, list(QUANTITIES)).quantities
        reader.UpdateInformation()
        reader.UpdateTimeStep(0.5 * step)
        cells = reader.GetOutputDataObject(0).GetCellData()
        for name, values in wanted.items():
            np.testing.assert_array_equal(read[name], values)
            np.testing.assert_array_equal(
                vtk_to_numpy(cells.GetArray(QUANTITIES[name].name)), values
            )
    assert cells.GetArray("stress_pa").GetNumberOfComponents() == 6
    resumed = FieldWriter(path, points, hexahedra, (2, 0), quantities=list(QUANTITIES))
    resumed.append(1.0, np.zeros_like(points), np.zeros_like(points), np.zeros(6), stored[0])
    read = read_fields(path, 2, ["stress"]).quantities["stress"]
    np.testing.assert_array_equal(read, stored[0]["stress"])


def test_a_quantity_that_a_file_has_not_is_refused_by_name(tmp_path: Path) -> None:
    make_fields(tmp_path / "fields.vtkhdf")
    with pytest.raises(SceneError) as error:
        read_fields(tmp_path / "fields.vtkhdf", 0, ["stress"])
    assert "holds no stress: its scene did not ask for it" in one_line(error)


def test_scenes_name_the_quantities_that_files_can_hold() -> None:
    from typing import get_args

    from taichi_ldem.scene.tables import Quantity

    assert {*get_args(Quantity), "fragment"} == set(QUANTITIES)


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


def change(path: Path, name: str, make) -> None:
    """Replace a dataset by what is made of its values."""
    with h5py.File(path, "r+") as file:
        values = file[name][()]
        del file[name]
        made = make(values)
        if isinstance(made, np.ndarray):
            file.create_dataset(name, data=made, maxshape=(None, *made.shape[1:]))
        else:
            file[name] = made


def read_all(path: Path) -> str:
    read_fields(path)
    return fault_of(path)


@pytest.mark.parametrize(
    ("name", "make", "what"),
    [
        ("VTKHDF/Connectivity", lambda v: v + 10**6, "Connectivity and Points do not fit"),
        ("VTKHDF/Connectivity", lambda v: v[:-1], "Connectivity has no whole modules"),
        ("VTKHDF/Connectivity", lambda v: v.astype(float), "holds other values than it should"),
        ("VTKHDF/Points", lambda v: v.ravel(), "Points has another shape"),
        ("VTKHDF/PointData/velocity_m_s", lambda v: v[:-1], "velocity_m_s is too short"),
        ("VTKHDF/Steps/Values", lambda v: v[:1], "Steps/Values is too short"),
        ("VTKHDF/Steps/Values", lambda v: 0 * v, "the times of its steps do not increase"),
        ("VTKHDF/Steps/Values", lambda v: v + np.nan, "the times of its steps do not increase"),
        ("BrokenBars/bar", lambda v: h5py.SoftLink("/VTKHDF/Types"), "BrokenBars/bar is a link"),
        ("VTKHDF/Points", lambda v: h5py.ExternalLink("/dev/zero", "/"), "Points is a link"),
    ],
)
def test_fields_that_do_not_fit_together_are_refused(tmp_path, name, make, what):
    path = tmp_path / "fields.vtkhdf"
    make_fields(path)
    change(path, name, make)
    with pytest.raises(DamagedFile, match=f"fields.vtkhdf.*{what}"):
        read_all(path)


def test_an_array_that_is_larger_than_the_memory_is_not_allocated(tmp_path):
    path = tmp_path / "fields.vtkhdf"
    make_fields(path)
    with h5py.File(path, "r+") as file:
        del file["BrokenBars/time_s"]
        file.create_dataset("BrokenBars/time_s", shape=(10**14,), chunks=(1024,), dtype="f8")
    with pytest.raises(DamagedFile, match="800,000,000,008,192 bytes"):
        read_broken_bars(path)


def test_values_that_no_run_writes_are_named_and_the_rest_is_read(tmp_path):
    path = tmp_path / "fields.vtkhdf"
    writer, *_ = make_fields(path)
    place = np.array([[0.0, 0.0, 1e-3], [1e-3, 0.0, 0.0], [0.0, 1e-3, 1e-3]])
    writer.append_broken(np.array([0.1, 0.2, 0.3]), place, np.array([0, 3, 13]))
    assert fault_of(path) == ""
    change(path, "BrokenBars/bar", lambda v: v[:2])  # a kill may cut a write off there
    assert len(read_broken_bars(path).time_s) == 2
    assert fault_of(path) == "its lists of broken bars have 3, 3 and 2"
    change(path, "BrokenBars/bar", lambda v: np.array([0, 14, 1], dtype=np.uint8))
    change(path, "BrokenBars/position_m", lambda v: v + np.eye(3)[0])
    assert len(read_broken_bars(path).time_s) == 2
    assert fault_of(path) == (
        "1 of 3 broken bars have impossible values; 2 broken bars lie outside of the plate"
    )
    change(path, "VTKHDF/PointData/velocity_m_s", lambda v: v * np.float32("nan"))
    assert "values of velocity are not finite" in fault_of(path)
