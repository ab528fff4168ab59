"""Fields over time and broken bars of a run, `fields.vtkhdf`: mesh, writer and readers.

The file is a VTKHDF unstructured grid (format 2.2), which ParaView and PyVista open.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.model.cell import MODULE, UnitCell
from taichi_ldem.storage.durable import created, patched

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]

# The eight corners of a module as (dx, dy, dz), in VTK_HEXAHEDRON's order.
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_VTK_HEXAHEDRON = 12
_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}

_FIELDS = ("PointData/displacement_m", "PointData/velocity_m_s", "CellData/broken_fraction")


def hexahedral_mesh(
    mask: NDArray[np.bool_], spacing: float, origin: Sequence[float]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Modules as hexahedra on their corner nodes.

    mask: (nz, ny, nx), which modules exist.  spacing: edge L of a module [m].
    origin: (x, y, z) of corner site (0, 0, 0) [m].

    Returns the points (P, 3) [m], corners of existing modules only, in the order of their sites;
    the hexahedra (C, 8) as point numbers in VTK's order, cells in the order of
    `np.argwhere(mask)`; and the site (k, j, i) of each point (P, 3), unpadded.
    """
    nz, ny, nx = mask.shape
    used = np.zeros((nz + 1, ny + 1, nx + 1), dtype=bool)
    for dx, dy, dz in _CORNERS:
        used[dz : nz + dz, dy : ny + dy, dx : nx + dx] |= mask
    number = np.cumsum(used.ravel(), dtype=np.int64).reshape(used.shape) - 1
    corners = [number[dz : nz + dz, dy : ny + dy, dx : nx + dx][mask] for dx, dy, dz in _CORNERS]
    sites = np.argwhere(used)
    points = np.asarray(origin, dtype=np.float64) + spacing * sites[:, ::-1]
    return points, np.stack(corners, axis=1), sites


class FieldWriter:
    """Appends fields to a temporal VTKHDF unstructured grid (VTKHDF file format 2.2).

    The mesh is written once and every step's offsets into it are zero; only the fields grow.  The
    file is opened and closed in each call, with HDF5's default library version and without SWMR,
    and its bytes are written in an order (`durable.Patch`) that leaves a file that opens after a
    kill at any moment.
    """

    def __init__(
        self,
        path: Path,
        points: FloatArray,
        hexahedra: IntArray,
        written: tuple[int, int] | None = None,
        attributes: Mapping[str, str] | None = None,
        cell: UnitCell = MODULE,
    ) -> None:
        """points: (P, 3) reference positions [m]; hexahedra: (C, 8) point numbers, VTK's order.

        attributes: of the file, by name; readers of VTKHDF pass over them.
        cell: whose bars the broken bars are.
        written: go on with the file of an earlier process after so many steps and broken bars.
        Raises SceneError if that does not hold them.
        """
        self._path, self._numbering = Path(path), cell.numbering
        self._points, self._cells = len(points), len(hexahedra)
        if written is None:
            self._create(points, hexahedra, attributes or {})
        else:
            self._cut(*written)

    def _cut(self, steps: int, broken: int) -> None:
        """Forget what was written after a checkpoint."""
        with _reading(self._path) as file:
            root, group = file["VTKHDF"], file["BrokenBars"]
            enough = int(root["Steps"].attrs["NSteps"]) >= steps
            enough &= len(group["time_s"]) >= broken
            for field, rows in zip(_FIELDS, (self._points, self._points, self._cells), strict=True):
                enough &= len(root[field]) >= steps * rows
        if not enough:
            raise SceneError(
                f"'{self._path}' holds fewer fields or broken bars than the checkpoint records"
            )
        with patched(self._path) as file:
            file["VTKHDF/Steps"].attrs.modify("NSteps", np.int64(steps))
        with patched(self._path) as file:
            for name in ("time_s", "position_m", "bar"):
                file["BrokenBars"][name].resize(broken, axis=0)

    def _create(
        self, points: FloatArray, hexahedra: IntArray, attributes: Mapping[str, str]
    ) -> None:
        with created(self._path) as file:
            file.attrs.update(attributes)
            root = _write_mesh(file, points, hexahedra)
            _write_steps(root)
            shapes = ((self._points, 3), (self._points, 3), (self._cells,))
            for field, shape in zip(_FIELDS, shapes, strict=True):
                _growing(root, field, shape, np.float32, packed=True)
            broken = file.create_group("BrokenBars")
            broken.attrs["about"] = "bars that failed, in order of writing; reference positions"
            _growing(broken, "time_s", (16384,), np.float64)
            _growing(broken, "position_m", (16384, 3), np.float64)
            _growing(broken, "bar", (16384,), np.uint8).attrs["numbering"] = self._numbering

    def append(
        self,
        time_s: float,
        displacement: FloatArray,
        velocity: FloatArray,
        broken_fraction: FloatArray,
    ) -> None:
        """Add the fields at one time, stored in single precision.

        displacement, velocity: (P, 3) [m], [m/s]; broken_fraction: (C,), share of a module's bars
        that have failed.  Raises ValueError on another shape.
        """
        for name, array, shape in (
            ("displacement", displacement, (self._points, 3)),
            ("velocity", velocity, (self._points, 3)),
            ("broken_fraction", broken_fraction, (self._cells,)),
        ):
            if array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}, the mesh needs {shape}")
        with patched(self._path) as file:
            root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
            step = int(steps.attrs["NSteps"])
            arrays = (displacement, velocity, broken_fraction)
            for field, array in zip(_FIELDS, arrays, strict=True):
                # By step, not by length: what an interrupted append left behind is overwritten.
                _put(root[field], step * len(array), array)
                _put(steps[_offsets_of(field)], step, [step * len(array)])
            for name in ("PartOffsets", "PointOffsets"):
                _put(steps[name], step, [0])
            for name in ("CellOffsets", "ConnectivityIdOffsets"):
                _put(steps[name], step, [[0]])
            _put(steps["NumberOfParts"], step, [1])
            _put(steps["Values"], step, [time_s])
        with patched(self._path) as file:  # last of all: only now is the step there
            file["VTKHDF/Steps"].attrs.modify("NSteps", np.int64(step + 1))

    def append_broken(self, time_s: FloatArray, position: FloatArray, bar: IntArray) -> None:
        """Add bars that have failed.

        time_s: (n,) [s]; position: (n, 3), middle of the bar in the reference configuration [m];
        bar: (n,), its number (`UnitCell.numbering`).
        """
        if not len(time_s) == len(position) == len(bar):
            raise ValueError("time_s, position and bar differ in length")
        if not len(time_s):
            return
        with patched(self._path) as file:
            group = file["BrokenBars"]
            start = len(group["time_s"])
            for name, array in (("time_s", time_s), ("position_m", position), ("bar", bar)):
                _put(group[name], start, array)


def write_vectors(
    path: Path, points: FloatArray, hexahedra: IntArray, vectors: dict[str, FloatArray]
) -> None:
    """Write named vectors at the points, without time, as a VTKHDF unstructured grid.

    points: (P, 3) [m]; hexahedra: (C, 8) point numbers, VTK's order; vectors: (P, 3) each, stored
    in single precision.
    """
    with created(path) as file:
        fields = _write_mesh(file, points, hexahedra).create_group("PointData")
        for name, values in vectors.items():
            fields.create_dataset(name, data=np.asarray(values, dtype=np.float32), **_PACKED)


def _write_mesh(file: h5py.File, points: FloatArray, hexahedra: IntArray) -> h5py.Group:
    """The group /VTKHDF with its mesh."""
    root = file.create_group("VTKHDF")
    # VTK reads the type only as a fixed-length ASCII string.
    kind = b"UnstructuredGrid"
    root.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
    # 2.2 is the first version that admits groups beside /VTKHDF.
    root.attrs.create("Version", np.array([2, 2], dtype=np.int64))
    cells = len(hexahedra)
    connectivity = np.asarray(hexahedra, dtype=np.int64).ravel()
    for name, count in (("Points", len(points)), ("Cells", cells), ("ConnectivityIds", 8 * cells)):
        root.create_dataset(f"NumberOf{name}", data=np.array([count], dtype=np.int64))
    root.create_dataset("Points", data=np.asarray(points, dtype=np.float64), **_PACKED)
    root.create_dataset("Connectivity", data=connectivity, **_PACKED)
    root.create_dataset("Offsets", data=8 * np.arange(cells + 1, dtype=np.int64), **_PACKED)
    root.create_dataset("Types", data=np.full(cells, _VTK_HEXAHEDRON, dtype=np.uint8), **_PACKED)
    return root


def _write_steps(root: h5py.Group) -> None:
    steps = root.create_group("Steps")
    steps.attrs.create("NSteps", np.int64(0))
    _growing(steps, "Values", (256,), np.float64)
    for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
        _growing(steps, name, (256,), np.int64)
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        _growing(steps, name, (256, 1), np.int64)
    for field in _FIELDS:
        _growing(steps, _offsets_of(field), (256,), np.int64)


def _offsets_of(field: str) -> str:
    return field.replace("Data/", "DataOffsets/")


def _growing(
    group: h5py.Group,
    name: str,
    chunk: tuple[int, ...],
    dtype: type,
    *,
    packed: bool = False,
) -> h5py.Dataset:
    """An empty dataset that grows along its first axis.

    A field's chunk is one whole step, so an append never rewrites bytes of an earlier step. Tables
    whose last chunk is written again and again are not packed: packed chunks move when they grow,
    and a kill might find the old place used and the new one not known yet.
    """
    return group.create_dataset(
        name,
        shape=(0, *chunk[1:]),
        maxshape=(None, *chunk[1:]),
        chunks=chunk,
        dtype=dtype,
        **(_PACKED if packed else {}),
    )


def _put(dataset: h5py.Dataset, start: int, rows: ArrayLike) -> None:
    rows = np.asarray(rows)
    dataset.resize(start + len(rows), axis=0)
    dataset[start:] = rows


@dataclass(frozen=True)
class Fields:
    """The fields of one step.

    points (P, 3) [m] in the reference configuration, hexahedra (C, 8), displacement (P, 3) [m],
    velocity (P, 3) [m/s], broken_fraction (C,), time [s] of this step, times (S,) [s] of all.
    """

    points: NDArray[np.float64]
    hexahedra: NDArray[np.int64]
    displacement: NDArray[np.float32]
    velocity: NDArray[np.float32]
    broken_fraction: NDArray[np.float32]
    time: float
    times: NDArray[np.float64]


@dataclass(frozen=True)
class BrokenBars:
    """Failed bars: time_s (n,) [s], position_m (n, 3) [m], reference; bar (n,), its number."""

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    bar: NDArray[np.uint8]


def read_times(path: Path) -> NDArray[np.float64]:
    """Times (S,) [s] of the stored steps.  Raises SceneError if the file is unreadable."""
    with _reading(path) as file:
        return _times(file)


def read_fields(path: Path, step: int = -1) -> Fields:
    """The fields of one step; a negative step counts from the end.

    Raises SceneError if the file is unreadable or has no such step.
    """
    with _reading(path) as file:
        root, times = file["VTKHDF"], _times(file)
        if not -len(times) <= step < len(times):
            raise SceneError(f"'{path}' has {len(times)} field steps, there is no step {step}")
        step %= len(times)
        points, hexahedra = root["Points"][:], root["Connectivity"][:].reshape(-1, 8)

        def rows(field: str, count: int) -> Any:
            start = int(root["Steps"][_offsets_of(field)][step])
            return root[field][start : start + count]

        return Fields(
            points=points,
            hexahedra=hexahedra,
            displacement=rows("PointData/displacement_m", len(points)),
            velocity=rows("PointData/velocity_m_s", len(points)),
            broken_fraction=rows("CellData/broken_fraction", len(hexahedra)),
            time=float(times[step]),
            times=times,
        )


def read_broken_bars(path: Path) -> BrokenBars:
    """All bars that failed, in order of writing.  Raises SceneError if the file is unreadable."""
    with _reading(path) as file:
        group = file["BrokenBars"]
        return BrokenBars(group["time_s"][:], group["position_m"][:], group["bar"][:])


def _times(file: h5py.File) -> NDArray[np.float64]:
    steps = file["VTKHDF/Steps"]
    times: NDArray[np.float64] = steps["Values"][: int(steps.attrs["NSteps"])]
    return times


@contextmanager
def _reading(path: Path) -> Iterator[h5py.File]:
    """`h5py.File` for reading; what fails, inside the block too, becomes a one-line SceneError."""
    try:
        # Without HDF5's lock a viewer never stops a run from writing, nor the other way.
        with h5py.File(path, "r", locking=False) as file:
            yield file
    except (OSError, KeyError) as error:
        reason = str(error.args[-1]) if Path(path).exists() else "there is no such file"
        raise SceneError(f"cannot read fields from '{path}': {reason}") from None
