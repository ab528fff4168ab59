"""The history of a run, `history.csv`: scalars over time, one line a sample."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.storage.durable import Appending, write_whole


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

    A last line without its line end is dropped: the run was killed while it wrote it.

    Raises:
        SceneError: the file is no such table.
    """
    try:
        text = path.read_text(encoding="utf-8")
        lines = text[: text.rfind("\n") + 1].splitlines()
        columns = lines[0].split(",") if lines else []
        body = io.StringIO("\n".join(lines[1:]))
        table = np.loadtxt(body, delimiter=",", ndmin=2) if lines[1:] else np.empty((0, 0))
    except (OSError, ValueError) as error:
        raise SceneError(f"cannot read '{path}': {error}") from None
    if not table.size:
        table = np.empty((0, len(columns)))
    if not columns or table.shape[1] != len(columns):
        raise SceneError(f"'{path}': header and rows differ in length")
    return dict(zip(columns, table.T, strict=True))
