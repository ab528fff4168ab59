"""Reads arrays of HDF5 files, which may be damaged: nothing is taken before its size is known."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.reading import refuse_large, refuse_special


class Arrays:
    """An HDF5 file of which only plain arrays are taken."""

    def __init__(self, file: h5py.File, path: Path) -> None:
        self._path = path
        self._groups: dict[str, Any] = {"": file}

    def item(self, name: str) -> Any:
        """A group or a dataset.

        Raises:
            ValueError: it is not there, or is a link, which may lead to any other file.
        """
        folder, _, last = name.rpartition("/")
        parent = self._groups.get(folder)
        if parent is None:
            parent = self.item(folder)
            if not isinstance(parent, h5py.Group):
                raise ValueError(f"it has no {name}")
            self._groups[folder] = parent
        try:
            kind = parent.id.links.get_info(last.encode()).type
        except (KeyError, RuntimeError):
            raise ValueError(f"it has no {name}") from None
        if kind != h5py.h5l.TYPE_HARD:
            raise ValueError(f"{name} is a link")
        return parent[last]

    def has(self, name: str) -> bool:
        """Whether a group or a dataset is there."""
        try:
            self.item(name)
        except ValueError:
            return False
        return True

    def take(
        self,
        name: str,
        width: tuple[int, ...],
        *,
        kinds: str = "f",
        start: int = 0,
        count: int | None = None,
    ) -> Any:
        """Rows of a dataset.

        Args:
            width: shape of a row.
            kinds: of numbers, as NumPy names them.
            start, count: of the rows; None: all of them.

        Raises:
            ValueError: the dataset has not that shape, kind or length.
            DamagedFile: it does not fit into the memory.
        """
        item = self.item(name)
        if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
            raise ValueError(f"{name} is no plain list of numbers")
        if item.dtype.kind not in kinds or item.dtype.itemsize > 8:
            raise ValueError(f"{name} holds other values than it should")
        if not item.shape or item.shape[1:] != width:
            raise ValueError(f"{name} has another shape")
        stop = len(item) if count is None else start + count
        if not 0 <= start <= stop <= len(item):
            raise ValueError(f"{name} is too short")
        rows = (stop - start) * int(np.prod(width, dtype=np.int64))
        chunk = int(np.prod(item.chunks or (0,), dtype=np.float64))
        refuse_large((rows + chunk) * item.dtype.itemsize, self._path)
        return item[start:stop]


@contextmanager
def reading(path: Path) -> Iterator[Arrays]:
    """A file for reading; what fails, inside the block too, becomes a one-line DamagedFile."""
    refuse_special(path)
    try:
        # Without HDF5's lock a viewer never stops a run from writing, nor the other way.
        with h5py.File(path, "r", locking=False) as file:
            yield Arrays(file, path)
    except SceneError:
        raise
    # whatever HDF5 raises on bytes that it did not write
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, OverflowError) as error:
        reason = str(error.args[-1]) if error.args else type(error).__name__
        raise DamagedFile(f"cannot read fields from '{path}': {reason}") from None
