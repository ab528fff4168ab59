"""The pieces of a plate over time, `fragments.csv`: a line for each piece and stored time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.storage.durable import Appending, write_whole
from taichi_ldem.storage.history import read_table

COLUMNS = (
    "time_s",
    "fragment",
    "nodes",
    "mass_kg",
    "x_m",
    "y_m",
    "z_m",
    "velocity_x_m_s",
    "velocity_y_m_s",
    "velocity_z_m_s",
    "momentum_x_kg_m_s",
    "momentum_y_kg_m_s",
    "momentum_z_kg_m_s",
    "extent_x_m",
    "extent_y_m",
    "extent_z_m",
    "equivalent_diameter_m",
)
_WHOLE = ("fragment", "nodes")


class FragmentWriter:
    """Writes the pieces at one time after the other, in full precision.

    Args:
        until: of an earlier process, whose file is continued: what it wrote later than this time,
            s, is dropped. None: the file is made anew.

    Raises:
        SceneError: the earlier file ends before that time.
    """

    def __init__(self, path: Path, until: float | None = None) -> None:
        rows: list[str] = []
        if until is not None:
            table = read_table(path)
            if not (table["time_s"] == until).any():
                raise SceneError(f"'{path}' ends before the time that the checkpoint records")
            kept = table["time_s"] <= until
            rows = _lines({name: table[name][kept] for name in COLUMNS})
        write_whole(path, ("\n".join([",".join(COLUMNS), *rows]) + "\n").encode())
        self._path = path

    def append(self, time_s: float, pieces: Mapping[str, ArrayLike]) -> None:
        """Add the pieces at a time: (n,) values of every column but the time."""
        values = {name: np.asarray(column) for name, column in pieces.items()}
        times = np.full(len(values["fragment"]), time_s)
        file = Appending(self._path)
        try:
            file.append("".join(f"{line}\n" for line in _lines(values | {"time_s": times})))
            file.sync()
        finally:
            file.close()


def _lines(values: Mapping[str, NDArray[Any]]) -> list[str]:
    columns = [
        values[name].astype(np.int64 if name in _WHOLE else np.float64).tolist() for name in COLUMNS
    ]
    return [",".join(map(repr, row)) for row in zip(*columns, strict=True)]


def read_fragments(path: Path) -> dict[str, NDArray[np.float64]]:
    """Columns of `fragments.csv` by header name, each (n,).

    Raises:
        DamagedFile: the file is no such table.
    """
    return read_table(path)
