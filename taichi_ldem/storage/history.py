"""The history of a run, `history.csv`: scalars over time, one line a sample."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.errors import DamagedFile
from taichi_ldem.reading import Named, read_text
from taichi_ldem.storage.durable import Appending, write_whole

LARGEST = 1e30
"""Largest size of a value before the last row, in SI units; a run that exceeds it is stopped."""
SHORTEST = 1e-9
"""Smallest first interval over the whole time."""


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


def read_history(path: Path) -> dict[str, NDArray[np.float64]]:
    """Columns of a history by header name, each (n,).

    A last line without its line end is dropped: the run was killed while it wrote it. The values of
    the last row need not be finite: the guard stops a run after it, see ``finite_rows``.

    Raises:
        DamagedFile: the file is no such table; a column that is asked for and is not there, too.
    """
    names, table = _columns(path)
    _refuse_rows(path, names, table)
    return Named(path, "column", dict(zip(names, table.T, strict=True)))


def read_table(path: Path) -> dict[str, NDArray[np.float64]]:
    """Columns of a table of finite numbers by header name, each (n,); the first is time_s.

    Raises:
        DamagedFile: as for ``read_history``, and where the table has no rows.
    """
    names, table = _columns(path)
    if not len(table) or not (np.abs(table) <= LARGEST).all():
        raise DamagedFile(f"'{path}': it must have rows, and numbers in all of them")
    return Named(path, "column", dict(zip(names, table.T, strict=True)))


def _columns(path: Path) -> tuple[list[str], NDArray[np.float64]]:
    """The names of a table's columns, and its rows (n, columns)."""
    text = read_text(path)
    lines = text[: text.rfind("\n") + 1].splitlines()
    names = lines[0].split(",") if lines else []
    if len(set(names)) < len(names) or names[:1] != ["time_s"]:
        raise DamagedFile(f"'{path}': its first line must name every column once, time_s first")
    try:
        body = io.StringIO("\n".join(lines[1:]))
        given: dict[str, Any] = {"delimiter": ",", "comments": None, "ndmin": 2}
        table = np.loadtxt(body, **given) if lines[1:] else np.empty((0, len(names)))
    except ValueError as error:
        raise DamagedFile(f"cannot read '{path}': {error}") from None
    if table.shape[1] != len(names):
        raise DamagedFile(f"'{path}': header and rows differ in length")
    return names, table


def _refuse_rows(path: Path, names: Sequence[str], table: NDArray[np.float64]) -> None:
    """Refuse a table with values that no run writes."""
    odd = np.argwhere(~(np.abs(table) <= LARGEST))  # NaN is not below it either
    for row, column in odd:
        if column == 0 or row < len(table) - 1:
            value = f"{names[column]} = {table[row, column]:g}"
            raise DamagedFile(f"'{path}': line {row + 2} has {value}, which no run writes there")
    step = np.diff(table[:, 0])
    late = np.flatnonzero(step <= 0)
    if len(late):
        raise DamagedFile(f"'{path}': line {late[0] + 3} is not later than the line before")
    if len(step) and step[0] < SHORTEST * (table[-1, 0] - table[0, 0]):
        raise DamagedFile(f"'{path}': line 3 is too close to the line before")


def finite_rows(history: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """A history without its last row, if that is not finite and not the only one."""
    last = [values[-1] for values in history.values() if len(values) > 1]
    if not last or all(abs(value) <= LARGEST for value in last):
        return dict(history)
    return {name: values[:-1] for name, values in history.items()}
