"""Checkpoints: all that a run needs to go on as if it had never stopped.

A checkpoint is an HDF5 file behind a head of 512 bytes (a user block, which HDF5 passes over) that
holds its length and SHA-256. Nothing is given to HDF5 before both are right. It carries the scene,
the state of the simulation, the history, and how much of the fields had been written. The last two
are kept; one that is broken, or of another scene or version, is refused with the reason.
"""

from __future__ import annotations

import hashlib
import io
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from taichi_ldem import __version__
from taichi_ldem.errors import SceneError
from taichi_ldem.machine import available_bytes
from taichi_ldem.scene import Scene, parse_scene_text, scene_to_toml
from taichi_ldem.storage import place
from taichi_ldem.storage.durable import MemoryFile, write_whole
from taichi_ldem.storage.provenance import provenance, unequal

LATEST, PREVIOUS, NEW = "checkpoint.h5", "checkpoint.previous.h5", "checkpoint.new.h5"
FORMAT = 2
HEAD = 512
MAGIC = "taichi_ldem checkpoint"
MOST_ARRAYS = 1000
"""More datasets than any checkpoint has."""

MAY_DIFFER = (
    "solver.duration",
    "solver.threads",
    "output.checkpoint_interval",
    "output.image_times",
    "output.smoothing_window",
    "output.filter_frequencies",
)
"""Keys of scene.toml that may be changed between a checkpoint and its resume."""

Arrays = Mapping[str, NDArray[Any]]
History = Sequence[Mapping[str, Any]]


class CheckpointError(SceneError):
    """A checkpoint that cannot be used; ``str(error)`` is the reason, on one line."""


@dataclass(frozen=True)
class Checkpoint:
    """A run between two steps.

    Attributes:
        scene: what is run.
        state: ``Simulation.saved_state``.
        history: a row for each sample so far.
        time: s; wall: seconds of stepping so far.
        field_steps, broken_bars: what had been written to the fields.
    """

    scene: Scene
    state: Arrays
    history: History
    time: float
    wall: float
    field_steps: int
    broken_bars: int


# --- bytes ----------------------------------------------------------------------------------------


def encode(checkpoint: Checkpoint) -> bytes:
    """A checkpoint as the bytes of its file."""
    image = MemoryFile()
    with image as file:
        file.attrs["format"] = FORMAT
        file.attrs["version"] = __version__
        file.attrs["provenance"] = json.dumps(provenance(checkpoint.scene))
        file.attrs["scene"] = scene_to_toml(checkpoint.scene)
        for name in ("time", "wall", "field_steps", "broken_bars"):
            file.attrs[name] = getattr(checkpoint, name)
        file.attrs["rows"] = len(checkpoint.history)
        for name, values in checkpoint.state.items():
            file.create_dataset(f"state/{name}", data=values)
        for name, values in _columns(checkpoint.history).items():
            file.create_dataset(f"history/{name}", data=values)
    return _head(image.content) + image.content


def _head(content: bytes) -> bytes:
    digest = hashlib.sha256(content).hexdigest()
    return f"{MAGIC}\n{len(content)}\n{digest}\n".encode().ljust(HEAD, b"\0")


def _columns(history: History) -> dict[str, NDArray[Any]]:
    """Columns of a history; whole numbers stay whole, a column of None is empty."""
    if not history:
        return {}
    columns = {}
    for name, first in history[0].items():
        values = [] if first is None else [row[name] for row in history]
        columns[name] = np.array(values, dtype=np.int64 if type(first) is int else np.float64)
    return columns


def decode(content: bytes) -> Checkpoint:
    """The checkpoint that ``encode`` made these bytes of.

    Raises:
        CheckpointError: any other bytes.
    """
    _verify(content)
    try:
        with h5py.File(io.BytesIO(content[HEAD:]), "r") as file:
            _refuse_version(file)
            arrays = _arrays(file, len(content))
            numbers = {n: float(file.attrs[n]) for n in ("time", "wall")}
            counts = {n: int(file.attrs[n]) for n in ("field_steps", "broken_bars", "rows")}
            scene = parse_scene_text(str(file.attrs["scene"]), "its scene")
    except CheckpointError:
        raise
    except SceneError as error:
        raise CheckpointError(str(error)) from None
    # whatever HDF5 or a missing part may raise: the bytes are as written, but no run wrote them
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, OverflowError) as error:
        raise CheckpointError(f"is no checkpoint of this program: {error}") from None
    if min(counts.values()) < 0 or not np.isfinite(list(numbers.values())).all():
        raise CheckpointError("is no checkpoint of this program: negative counts")
    rows = _rows(arrays, counts.pop("rows"))
    state = {n.removeprefix("state/"): v for n, v in arrays.items() if n.startswith("state/")}
    return Checkpoint(scene, state, rows, **numbers, **counts)  # type: ignore[arg-type]


def _verify(content: bytes) -> None:
    lines = content[:HEAD].rstrip(b"\0").decode("ascii", "replace").split("\n")
    if len(lines) != 4 or lines[0] != MAGIC or not lines[1].isdecimal():
        raise CheckpointError("does not begin like a checkpoint")
    if lines[1] != str(len(content) - HEAD):
        raise CheckpointError(f"has {len(content) - HEAD} bytes of {lines[1][:20]}: it was cut off")
    if content[:HEAD] != _head(content[HEAD:]):
        raise CheckpointError("has a wrong checksum: it was damaged after it was written")


def _refuse_version(file: h5py.File) -> None:
    number, version = int(file.attrs["format"]), str(file.attrs["version"])
    if number != FORMAT or version != __version__:
        raise CheckpointError(
            f"was written by version {version} (format {number}), and this is {__version__} "
            f"(format {FORMAT}): resume with the version that wrote it"
        )


def _arrays(file: h5py.File, limit: int) -> dict[str, NDArray[Any]]:
    """All datasets by name, plain numbers only: no links, no packed or external storage.

    Nothing is allocated before all of them together are known to fit into the file: those that
    HDF5 has not allocated take no space in it.

    Args:
        limit: bytes of the file.
    """
    found: dict[str, h5py.Dataset] = {}
    left = limit

    def take(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        nonlocal left
        # a name that is no UTF-8 comes as bytes
        plain = isinstance(name, str) and item.dtype.kind in "iuf" and item.chunks is None
        left -= item.nbytes if plain else 0
        if not plain or item.external or item.is_virtual or left < 0 or len(found) == MOST_ARRAYS:
            raise CheckpointError(f"is no checkpoint of this program: '{name!s}'")
        found[name] = item

    file.visititems(take)
    return {name: np.array(item[()]) for name, item in found.items()}


def _rows(arrays: Arrays, count: int) -> History:
    own = {n.removeprefix("history/"): v for n, v in arrays.items() if n.startswith("history/")}
    for name, values in own.items():
        if values.ndim != 1 or len(values) not in (0, count):
            raise CheckpointError(f"is no checkpoint of this program: 'history/{name}'")
    if count != max(map(len, own.values()), default=0) or bool(own) != bool(count):
        raise CheckpointError("is no checkpoint of this program: history")
    columns = {name: values.tolist() or [None] * count for name, values in own.items()}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


# --- files ----------------------------------------------------------------------------------------


class Checkpoints:
    """The checkpoints of a run folder.

    Args:
        good: which of the files this process knows to be good; a bad one never takes the older's
            place.
    """

    def __init__(self, folder: Path, good: str | None = None) -> None:
        self._folder, self._good = folder, good

    def write(self, checkpoint: Checkpoint) -> None:
        """Write a checkpoint and keep the one before.

        Raises:
            OSError: it could not be written; what was there stands.
        """
        new, latest = self._folder / NEW, self._folder / LATEST
        write_whole(new, encode(checkpoint))
        if self._good == LATEST:
            place.replace(latest, self._folder / PREVIOUS)
        place.replace(new, latest)
        place.sync_folder(self._folder)
        self._good = LATEST

    def usable(self, scene: Scene) -> Iterator[tuple[str, Checkpoint]]:
        """Good checkpoints of a scene with their files' names, the latest first.

        A file that is refused is named on stderr with the reason, a line each.
        """
        for name in (LATEST, PREVIOUS):
            path = self._folder / name
            try:
                checkpoint = decode(_read(path))
                refuse_other(checkpoint.scene, scene)
            except FileNotFoundError:
                continue
            except OSError as error:
                print(f"refused: {path}: cannot be read: {error.strerror}", file=sys.stderr)
            except CheckpointError as error:
                print(f"refused: {path}: {error}", file=sys.stderr)
            else:
                yield name, checkpoint


def _read(path: Path) -> bytes:
    size, free = path.stat().st_size, available_bytes()
    if not path.is_file():
        raise CheckpointError("is a pipe, a device or a folder, not a file")
    if free is not None and size > free / 2:
        raise CheckpointError(f"has {size:,} bytes, and {free:,} bytes of memory are available")
    return path.read_bytes()


def refuse_other(saved: Scene, scene: Scene) -> None:
    """Raise CheckpointError where a checkpoint's scene is not the folder's."""
    for key, mine, theirs in unequal(scene, saved, MAY_DIFFER):
        raise CheckpointError(
            f"is of another scene: {key} = {theirs} in the checkpoint, {mine} in scene.toml"
        )
