"""A run folder as it is read once, for its figures and its report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.paper import is_papers_test
from taichi_ldem.analysis.window import smoothing_window
from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.reading import Named
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scenarios.runner import columns
from taichi_ldem.scene import Scene
from taichi_ldem.storage.fields import fault_of
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import finite_rows

if TYPE_CHECKING:
    from taichi_ldem.analysis.cracks import Cracks

Series = NDArray[np.float64]


def number(summary: Mapping[str, Any], key: str) -> float | None:
    """A number of a summary; None where the run does not have it."""
    value = summary.get(key)
    return float(value) if isinstance(value, (int, float)) else None


@dataclass(frozen=True)
class LoadedRun:
    """A run.

    Attributes:
        history: its columns, (n,) each, under the names of ``history.csv``; empty without one.
        summary: the contents of ``summary.json``; empty while the run is not finished.
    """

    folder: RunFolder
    scene: Scene
    history: Mapping[str, Series]
    summary: Mapping[str, Any]

    @classmethod
    def read(cls, folder: RunFolder, *, most_rows: int | None = None) -> LoadedRun:
        """Read a run.

        Args:
            most_rows: of the history; a longer one is thinned evenly. None: all rows.

        Raises:
            SceneError: a file of the run cannot be read.
        """
        history = folder.read_history() if folder.history_file.exists() else {}
        history = finite_rows(history)
        if most_rows is not None:
            every = max(1, -(-len(history.get("time_s", ())) // most_rows))
            history = {name: values[::every] for name, values in history.items()}
        named = Named(folder.history_file, "column", history)
        return cls(folder, folder.read_scene(), named, folder.read_summary())

    @property
    def rows(self) -> int:
        """Number of samples."""
        return len(self.history.get("time_s", ()))

    @property
    def time_ms(self) -> Series:
        """(n,) times of the samples, ms."""
        return 1e3 * self.history["time_s"]

    @property
    def is_papers_test(self) -> bool:
        """Whether the scene has the plate, striker and speed of the paper's test."""
        return is_papers_test(self.scene)

    @property
    def is_beam(self) -> bool:
        """Whether the specimen is a beam on supports, which is seen from the side."""
        return self.scene.is_beam

    @property
    def drawn(self) -> bool:
        """Whether pictures of the plate belong to the scenario."""
        return SCENARIOS[self.scene.scenario].pictures

    @property
    def window(self) -> float:
        """Time over which forces are averaged, s."""
        return smoothing_window(self.scene)

    @cached_property
    def cracks(self) -> Cracks | None:
        """The measured cracks of a falling-weight test; None without a broken bar."""
        if self.scene.scenario != "impact" or not self.folder.fields_file.exists():
            return None
        from taichi_ldem.scenarios.measure import measure_run

        return measure_run(self.folder)

    def has(self, column: str) -> bool:
        """Whether the history has a column, and a curve in it.

        Raises:
            DamagedFile: runs of this scene write the column, and it is not there.
        """
        if self.rows > 1 and column not in self.history and column in columns(self.scene):
            raise DamagedFile(f"'{self.folder.history_file}' has no column '{column}'")
        return len(self.history.get(column, ())) > 1

    def number(self, key: str) -> float | None:
        """A number of the summary; None where the run does not have it."""
        return number(self.summary, key)

    def positive(self, key: str) -> float:
        """A number of the summary that every such run has; DamagedFile where it is not above 0."""
        value = self.number(key)
        if value is None or not value > 0:
            raise DamagedFile(f"'{self.folder.summary_file}': {key} is no number above 0")
        return value

    @cached_property
    def fault(self) -> str:
        """What is wrong with the fields, for the figures that are made from them; empty: nothing.

        Raises:
            DamagedFile: they cannot be read.
        """
        file = self.folder.fields_file
        found = fault_of(file) if file.exists() else ""
        return f"{file.name} is damaged: {found}" if found else ""

    @contextmanager
    def drawing(self, what: str) -> Iterator[None]:
        """Draw from the run's files, which may be whole each and yet not fit together.

        Raises:
            DamagedFile: instead of any error of arithmetic, of a name or of a shape.
        """
        try:
            yield
        except SceneError:
            raise
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise DamagedFile(
                f"'{self.folder.path}': {what} cannot be drawn, since its files do not fit "
                f"together: {type(error).__name__}: {error}"
            ) from error
