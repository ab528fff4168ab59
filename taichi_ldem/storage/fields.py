"""Fields over time and broken bars of a run, `fields.vtkhdf`: mesh, writer and readers.

The file is a VTKHDF unstructured grid (format 2.2), which ParaView and PyVista open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as part
from pathlib import Path
from types import MappingProxyType
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.model.cell import HEXAHEDRON, MODULE, UnitCell
from taichi_ldem.storage.arrays import Arrays, reading
from taichi_ldem.storage.durable import created, patched

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]

_VTK_HEXAHEDRON = 12
_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}

_FIELDS = ("PointData/displacement_m", "PointData/velocity_m_s", "CellData/broken_fraction")


@dataclass(frozen=True)
class Quantity:
    """What a file may hold of every module: its name there, and components and kind of a value."""

    name: str
    width: tuple[int, ...] = ()
    kind: type = np.float32

    @property
    def dataset(self) -> str:
        """Its place in the group /VTKHDF."""
        return f"CellData/{self.name}"


QUANTITIES = {
    # VTK's order of a symmetric tensor: xx, yy, zz, xy, yz, xz
    "strain": Quantity("strain", (6,)),
    "stress": Quantity("stress_pa", (6,)),
    "principal_stress": Quantity("principal_stress_pa"),
    "damage": Quantity("damage"),
    "fragment": Quantity("fragment", kind=np.int32),
}
"""Quantities that a file holds where a scene asks for them, by the name that the scene gives."""


def widths(names: Sequence[str]) -> int:
    """Numbers of a module in all of some quantities."""
    return sum(int(np.prod(QUANTITIES[name].width, dtype=np.int64)) for name in names)


FARTHEST = 1e20
"""Largest coordinate of a broken bar, m; sides of plates are smaller."""


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
    for dx, dy, dz in HEXAHEDRON:
        used[dz : nz + dz, dy : ny + dy, dx : nx + dx] |= mask
    number = np.cumsum(used.ravel(), dtype=np.int64).reshape(used.shape) - 1
    corners = [number[dz : nz + dz, dy : ny + dy, dx : nx + dx][mask] for dx, dy, dz in HEXAHEDRON]
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
        quantities: Sequence[str] = (),
    ) -> None:
        """points: (P, 3) reference positions [m]; hexahedra: (C, 8) point numbers, VTK's order.

        quantities: names in QUANTITIES of what is stored in addition.

        attributes: of the file, by name; readers of VTKHDF pass over them.
        cell: whose bars the broken bars are.
        written: go on with the file of an earlier process after so many steps and broken bars.
        Raises SceneError if that does not hold them.
        """
        self._path, self._numbering = Path(path), cell.numbering
        self._points, self._cells = len(points), len(hexahedra)
        self._more = {name: QUANTITIES[name] for name in quantities}
        if written is None:
            self._create(points, hexahedra, attributes or {})
        else:
            self._cut(*written)

    def _cut(self, steps: int, broken: int) -> None:
        """Forget what was written after a checkpoint."""
        with reading(self._path) as file:
            enough = len(_times(file)) >= steps
            for name in ("time_s", "position_m", "bar"):
                enough &= len(file.item(f"BrokenBars/{name}")) >= broken
            for field, rows in zip(_FIELDS, (self._points, self._points, self._cells), strict=True):
                enough &= len(file.item(f"VTKHDF/{field}")) >= steps * rows
            for more in self._more.values():
                enough &= len(file.item(f"VTKHDF/{more.dataset}")) >= steps * self._cells
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
            for more in self._more.values():
                _growing(root, more.dataset, (self._cells, *more.width), more.kind, packed=True)
                _growing(root["Steps"], _offsets_of(more.dataset), (256,), np.int64)
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
        quantities: Mapping[str, NDArray[Any]] = MappingProxyType({}),
    ) -> None:
        """Add the fields at one time, stored in single precision.

        displacement, velocity: (P, 3) [m], [m/s]; broken_fraction: (C,), share of a module's bars
        that have failed; quantities: (C, ...) those that the file was made for.  Raises ValueError
        on another shape, KeyError where one is missing.
        """
        named = {more.dataset: quantities[name] for name, more in self._more.items()}
        arrays = dict(zip(_FIELDS, (displacement, velocity, broken_fraction), strict=True)) | named
        shapes = [(self._points, 3), (self._points, 3), (self._cells,)]
        shapes += [(self._cells, *more.width) for more in self._more.values()]
        for (name, array), shape in zip(arrays.items(), shapes, strict=True):
            if array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}, the mesh needs {shape}")
        with patched(self._path) as file:
            root, steps = file["VTKHDF"], file["VTKHDF/Steps"]
            step = int(steps.attrs["NSteps"])
            for field, array in arrays.items():
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
    velocity (P, 3) [m/s], broken_fraction (C,), time [s] of this step, times (S,) [s] of all;
    quantities (C, ...) by their names in QUANTITIES, those that were asked for.
    """

    points: NDArray[np.float64]
    hexahedra: NDArray[np.int64]
    displacement: NDArray[np.float32]
    velocity: NDArray[np.float32]
    broken_fraction: NDArray[np.float32]
    time: float
    times: NDArray[np.float64]
    quantities: Mapping[str, NDArray[Any]] = part(default_factory=dict)

    @property
    def fault(self) -> str:
        """What no run writes unless it is stopped, in words; empty where all values are sound.

        A run that the guard stops may end with values that are not finite.
        """
        for name in ("displacement", "velocity", "broken_fraction"):
            values = getattr(self, name)
            odd = int((~np.isfinite(values)).sum())
            if odd:
                return f"{odd} of {values.size} values of {name} are not finite"
        if not ((self.broken_fraction >= 0) & (self.broken_fraction <= 1)).all():
            return "shares of broken bars lie outside of 0 to 1"
        return ""


@dataclass(frozen=True)
class BrokenBars:
    """Failed bars: time_s (n,) [s], position_m (n, 3) [m], reference; bar (n,), its number.

    fault: what is wrong with them, in words; rows that are not whole are left out.
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    bar: NDArray[np.uint8]
    fault: str = ""


def read_times(path: Path) -> NDArray[np.float64]:
    """Times (S,) [s] of the stored steps.  Raises DamagedFile if the file is unreadable."""
    with reading(path) as file:
        return _times(file)


def read_quantities(path: Path) -> list[str]:
    """Names in QUANTITIES of what a file holds.  Raises DamagedFile if it is unreadable."""
    with reading(path) as file:
        return [name for name, q in QUANTITIES.items() if file.has(f"VTKHDF/{q.dataset}")]


def read_fields(path: Path, step: int = -1, quantities: Sequence[str] = ()) -> Fields:
    """The fields of one step; a negative step counts from the end.

    quantities: names in QUANTITIES of what is read in addition.
    Raises DamagedFile if the file is unreadable, SceneError if it has no such step or quantity.
    """
    if missing := [name for name in quantities if name not in read_quantities(path)]:
        why = "its scene did not ask for it (output.fields, output.fragments)"
        raise SceneError(f"'{path}' holds no {missing[0]}: {why}")
    with reading(path) as file:
        times = _times(file)
        if not -len(times) <= step < len(times):
            raise SceneError(f"'{path}' has {len(times)} field steps, there is no step {step}")
        step %= len(times)
        points = file.take("VTKHDF/Points", (3,))
        flat = file.take("VTKHDF/Connectivity", (), kinds="iu")
        if len(flat) % 8 or len(points) == 0 or len(flat) == 0:
            raise ValueError("VTKHDF/Connectivity has no whole modules")
        if flat.min() < 0 or flat.max() >= len(points) or not np.isfinite(points).all():
            raise ValueError("VTKHDF/Connectivity and Points do not fit")

        def rows(field: str, count: int, width: tuple[int, ...], kinds: str = "f") -> Any:
            offsets = file.take(f"VTKHDF/Steps/{_offsets_of(field)}", (), kinds="iu")
            start = int(offsets[step]) if step < len(offsets) else -1
            return file.take(f"VTKHDF/{field}", width, kinds=kinds, start=start, count=count)

        return Fields(
            points=points,
            hexahedra=flat.reshape(-1, 8),
            displacement=rows("PointData/displacement_m", len(points), (3,)),
            velocity=rows("PointData/velocity_m_s", len(points), (3,)),
            broken_fraction=rows("CellData/broken_fraction", len(flat) // 8, ()),
            time=float(times[step]),
            times=times,
            quantities={
                name: rows(q.dataset, len(flat) // 8, q.width, np.dtype(q.kind).kind)
                for name, q in QUANTITIES.items()
                if name in quantities
            },
        )


def read_broken_bars(path: Path) -> BrokenBars:
    """All bars that failed, in order of writing.  Raises DamagedFile if the file is unreadable."""
    with reading(path) as file:
        time = file.take("BrokenBars/time_s", ())
        position = file.take("BrokenBars/position_m", (3,))
        bar = file.take("BrokenBars/bar", (), kinds="iu")
    count = min(len(time), len(position), len(bar))
    faults = []
    if not len(time) == len(position) == len(bar):
        faults.append(f"its lists of broken bars have {len(time)}, {len(position)} and {len(bar)}")
    time, position, bar = time[:count], position[:count], bar[:count]
    sound = np.isfinite(time) & (time >= 0) & (np.abs(position) <= FARTHEST).all(axis=1)
    sound &= (bar >= 0) & (bar < 14)
    if not sound.all():
        faults.append(f"{count - int(sound.sum())} of {count} broken bars have impossible values")
    return BrokenBars(time[sound], position[sound], bar[sound], "; ".join(faults))


def fault_of(path: Path) -> str:
    """What is wrong with fields that can be read, in words; empty where nothing is.

    Only the last step is looked at. Raises DamagedFile if the file is unreadable.
    """
    bars, found = read_broken_bars(path), []
    if len(read_times(path)):
        fields = read_fields(path)
        low, high = fields.points.min(axis=0), fields.points.max(axis=0)
        near = 0.01 * (high - low).max()  # rounding
        outside = ((bars.position_m < low - near) | (bars.position_m > high + near)).any(axis=1)
        if outside.any():
            found.append(f"{int(outside.sum())} broken bars lie outside of the plate")
        found.append(fields.fault)
    return "; ".join(filter(None, [bars.fault, *found]))


def _times(file: Arrays) -> NDArray[np.float64]:
    group = file.item("VTKHDF/Steps")
    count = group.attrs["NSteps"]
    if not isinstance(count, np.integer):
        raise ValueError("VTKHDF/Steps has no number of steps")
    times: NDArray[np.float64] = file.take("VTKHDF/Steps/Values", (), count=int(count))
    if not (np.isfinite(times).all() and (np.diff(times) > 0).all() and (times >= 0).all()):
        raise ValueError("the times of its steps do not increase")
    return times
