"""The run folder: scene, history, fields and summary of one run, and their readers.

Everything is in SI units.  `history.csv` and `fields.vtkhdf` are appended to while the run goes
on and stay readable between writes; `summary.json` is written last, so its presence means a
finished run.
"""

from __future__ import annotations

import io
import json
import math
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.storage.durable import (
    LOCK,
    Appending,
    created,
    locked,
    patched,
    refuse_locked,
    write_whole,
)

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]

# What a run and its pictures leave in the folder: all that `--force` may remove.
_OWN_FILES = re.compile(
    r"(scene\.toml|history\.csv|fields\.vtkhdf|summary\.json|run\.json)(\.tmp)?"
    r"|checkpoint(\.previous|\.new)?\.h5(\.tmp)?"
    r"|(force|force_displacement|velocity|energy|stress_strain)\.png"
    r"|(crack_map|cracks|crack_growth)\.png"
    r"|(pulse|dispersion|anisotropy)\.png|(probes|profiles)\.csv"
    r"|modes\.(csv|md|png|vtkhdf)"
    r"|crack_[0-9.]+ms_(below|above|cut)\.png"
    r"|shot_[0-9.]+ms(_(below|above|cut)(_az[-+.e0-9]+)?(_el[-+.e0-9]+)?(_[xyz][-+.e0-9]+)?"
    r"(_velocity|_energy)?)?\.png"
    r"|movie\.(mp4|gif)|report\.html"
)

# The eight corners of a module as (dx, dy, dz), in VTK_HEXAHEDRON's order.
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_VTK_HEXAHEDRON = 12
_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}

_FIELDS = ("PointData/displacement_m", "PointData/velocity_m_s", "CellData/broken_fraction")

BAR_NUMBERING = (
    "bar of a site: 0-2 corner edges along x, y, z; 3-5 centre-to-centre bars along x, y, z; "
    "6 + 4 dz + 2 dy + dx diagonal from the centre to corner (dx, dy, dz) of its module"
)


@dataclass(frozen=True)
class RunFolder:
    """The folder of one run and the places of its files."""

    path: Path

    @classmethod
    def create(cls, path: Path, *, force: bool) -> RunFolder:
        """Make the folder ready for a new run.

        With `force`, files that an earlier run wrote are removed; any other file stays.

        Raises SceneError as `check` does, and when an old file cannot be removed.
        """
        cls._check_place(Path(path), force=force)
        folder = cls(Path(path))
        try:
            folder.path.mkdir(parents=True, exist_ok=True)
            # The summary goes first: a folder half emptied must not look like a finished run.
            for old in (folder.summary_file, *folder._own_files()):
                old.unlink(missing_ok=True)
        except OSError as error:
            raise SceneError(f"cannot use '{path}' as run folder: {error.strerror}") from None
        return folder

    @staticmethod
    def check(path: Path, *, force: bool) -> None:
        """Raise SceneError where `create` would refuse; nothing that exists is changed.

        Refused: a path that is no folder, a folder with anything in it unless `force`, a place
        where files cannot be written; a folder that another process works in, which `create` leaves
        to `held`.
        """
        RunFolder._check_place(Path(path), force=force)
        refuse_locked(Path(path))

    @staticmethod
    def _check_place(path: Path, *, force: bool) -> None:
        try:
            if path.exists() and not path.is_dir():
                raise SceneError(f"run folder '{path}' is a file; give a folder with --out")
            if path.is_dir() and not force and any(p.name != LOCK for p in path.iterdir()):
                raise SceneError(f"run folder '{path}' is not empty; --force overwrites its run")
            existing = next(p for p in (path, *path.absolute().parents) if p.exists())
            # Permission bits lie (root, read-only mounts, quotas): only writing tells.
            with tempfile.TemporaryFile(dir=existing):
                pass
        except OSError as error:
            raise SceneError(f"cannot write to run folder '{path}': {error.strerror}") from None

    @staticmethod
    @contextmanager
    def held(path: Path) -> Iterator[None]:
        """Make the folder and hold it for this process; SceneError where another one has it."""
        try:
            Path(path).mkdir(parents=True, exist_ok=True)
            with locked(Path(path)):
                yield
        except PermissionError as error:
            raise SceneError(f"cannot write to run folder '{path}': {error.strerror}") from None

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """The folder of an existing run, finished or not; SceneError names what it lacks."""
        folder = cls(Path(path))
        if not folder.path.is_dir():
            raise SceneError(f"'{path}' is no run folder: there is no such folder")
        for file in (folder.scene_file, folder.history_file):
            if not file.is_file():
                raise SceneError(f"'{path}' is no run folder: it has no {file.name}")
        return folder

    @property
    def scene_file(self) -> Path:
        """The resolved scene, TOML."""
        return self.path / "scene.toml"

    @property
    def history_file(self) -> Path:
        """Scalars over time."""
        return self.path / "history.csv"

    @property
    def fields_file(self) -> Path:
        """Fields and broken bars, VTKHDF."""
        return self.path / "fields.vtkhdf"

    @property
    def summary_file(self) -> Path:
        """Numbers of a finished run, JSON."""
        return self.path / "summary.json"

    @property
    def provenance_file(self) -> Path:
        """What wrote the run: versions, machine and command line of each process, JSON."""
        return self.path / "run.json"

    def processes(self) -> list[Any]:
        """What ``run.json`` says of each process that has worked on the run, the first first."""
        earlier: Any = []
        with suppress(OSError, ValueError, KeyError, TypeError):
            earlier = json.loads(self.provenance_file.read_text(encoding="utf-8"))["processes"]
        return earlier if isinstance(earlier, list) else []

    def write_provenance(self, provenance: dict[str, Any]) -> None:
        """Add a process to those that have worked on the run."""
        processes = [*self.processes(), provenance]
        text = json.dumps({"processes": processes}, indent=2) + "\n"
        write_whole(self.provenance_file, text.encode())

    def picture_metadata(self) -> dict[str, str]:
        """Text chunks of the run's PNG files: the last process's scene and version."""
        with suppress(KeyError, TypeError, IndexError):
            run = self.processes()[-1]
            told = {"scene_sha256": "Scene-SHA256", "version": "Version", "git": "Git"}
            return {tag: str(run[key]) for key, tag in told.items() if run[key]}
        return {}

    def write_scene(self, text: str) -> None:
        """Write the resolved scene (TOML)."""
        write_whole(self.scene_file, text.encode())

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write the summary whole or not at all; what is not finite becomes null."""
        text = json.dumps(_plain(summary), indent=2, allow_nan=False) + "\n"
        write_whole(self.summary_file, text.encode())

    def read_summary(self) -> dict[str, Any]:
        """The summary; empty where the run has not finished.  Raises SceneError if unreadable."""
        if not self.summary_file.is_file():
            return {}
        try:
            summary = json.loads(self.summary_file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise SceneError(f"cannot read '{self.summary_file}': {error}") from None
        if not isinstance(summary, dict):
            raise SceneError(f"'{self.summary_file}' holds no table of numbers")
        return summary

    def read_history(self) -> dict[str, NDArray[np.float64]]:
        """Columns of `history.csv` by header name, each (n,).

        A last line without its line end (a run killed while writing) is dropped.  Raises
        SceneError if the file is no such table.
        """
        try:
            text = self.history_file.read_text(encoding="utf-8")
            lines = text[: text.rfind("\n") + 1].splitlines()
            columns = lines[0].split(",") if lines else []
            body = io.StringIO("\n".join(lines[1:]))
            table = np.loadtxt(body, delimiter=",", ndmin=2) if lines[1:] else np.empty((0, 0))
        except (OSError, ValueError) as error:
            raise SceneError(f"cannot read '{self.history_file}': {error}") from None
        if not table.size:
            table = np.empty((0, len(columns)))
        if not columns or table.shape[1] != len(columns):
            raise SceneError(f"'{self.history_file}': header and rows differ in length")
        return dict(zip(columns, table.T, strict=True))

    def _own_files(self) -> Iterable[Path]:
        return [p for p in self.path.iterdir() if _OWN_FILES.fullmatch(p.name) and p.is_file()]


def _plain(value: Any) -> Any:
    """`value` in JSON's own types; NaN and infinities, which JSON lacks, become None."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


class HistoryWriter:
    """Scalars over time, one line a sample in full precision, on disk after each `append`.

    Args:
        rows: what stands there from the start; a file that holds more or less is replaced.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], rows: Iterable[Sequence[float | int]] = ()
    ) -> None:
        self._width = len(columns)
        lines = [",".join(columns), *(self._line(row) for row in rows)]
        write_whole(path, ("\n".join(lines) + "\n").encode())
        self._file = Appending(path)

    def append(self, row: Sequence[float | int]) -> None:
        """Write one sample, in the order of the columns; ValueError if it has another length."""
        self._file.append(self._line(row) + "\n")

    def _line(self, row: Sequence[float | int]) -> str:
        if len(row) != self._width:
            raise ValueError(f"history row has {len(row)} values, the header {self._width}")
        return ",".join(repr(v.item() if isinstance(v, np.generic) else v) for v in row)

    def sync(self) -> None:
        """Put all rows on the disk, which the system does in its own time otherwise."""
        self._file.sync()

    def close(self) -> None:
        """Close the file; nothing is pending."""
        self._file.close()

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


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
    ) -> None:
        """points: (P, 3) reference positions [m]; hexahedra: (C, 8) point numbers, VTK's order.

        attributes: of the file, by name; readers of VTKHDF pass over them.
        written: go on with the file of an earlier process after so many steps and broken bars.
        Raises SceneError if that does not hold them.
        """
        self._path = Path(path)
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
            raise SceneError(f"'{self._path}' holds less than the checkpoint says")
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
            _growing(broken, "bar", (16384,), np.uint8).attrs["numbering"] = BAR_NUMBERING

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
        bar: (n,), 0 to 13, see `BAR_NUMBERING`.
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
    with h5py.File(path, "w", locking=False) as file:
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
    """Failed bars: time_s (n,) [s], position_m (n, 3) [m], reference; bar (n,), 0 to 13."""

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
