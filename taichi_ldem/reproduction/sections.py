"""The parts of the reproduction's report: items, their rows and pictures, and where runs lie."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taichi_ldem.scene import Scene
from taichi_ldem.storage.folder import RunFolder


@dataclass(frozen=True)
class Row:
    """A quantity as computed, in the paper and in the experiments.

    Attributes:
        computed, paper: numbers in ``unit``, or None.
        experiments: lowest and highest in ``unit``, or None.
    """

    quantity: str
    unit: str
    computed: float | None
    paper: float | None = None
    experiments: tuple[float, float] | None = None
    digits: int = 3

    def cells(self) -> tuple[str, ...]:
        """Quantity, computed, paper, experiments, difference."""
        return (
            f"{self.quantity} [{self.unit}]" if self.unit else self.quantity,
            "none" if self.computed is None else self._number(self.computed),
            "" if self.paper is None else self._number(self.paper),
            " to ".join(dict.fromkeys(map(self._number, self.experiments or ()))),
            self.difference(),
        )

    def _number(self, value: float) -> str:
        return f"{value:.{self.digits}f}"

    def difference(self) -> str:
        """From the paper in per cent, and whether within the experiments' range."""
        if self.computed is None:
            return ""
        parts = []
        if self.paper:
            parts.append(f"{100 * (self.computed / self.paper - 1):+.0f} % from the paper")
        if self.experiments is not None:
            low, high = self.experiments
            inside = low <= self.computed <= high
            nearest = low if self.computed < low else high
            distance = 100 * (self.computed / nearest - 1) if nearest else 0.0
            parts.append(
                "within the experiments" if inside else f"{distance:+.0f} % from their range"
            )
        return "; ".join(parts)


@dataclass
class Section:
    """The content of an item.

    Attributes:
        pictures: (file, caption) of each; they are copied next to the report.
        markdown: a table that the run itself has written.
        why: a remark on the differences.
    """

    rows: list[Row] = field(default_factory=list)
    pictures: list[tuple[Path, str]] = field(default_factory=list)
    markdown: str = ""
    why: str = ""


@dataclass(frozen=True)
class Context:
    """Where the runs lie and where pictures go."""

    out: Path

    def folder(self, name: str) -> Path:
        """A run folder."""
        return self.out / "runs" / name

    def summary(self, name: str) -> dict[str, Any]:
        """The summary of a run."""
        return RunFolder(self.folder(name)).read_summary()

    def scene(self, name: str) -> Scene:
        """The scene of a run."""
        return RunFolder(self.folder(name)).read_scene()

    def picture(self, name: str) -> Path:
        """Where a figure that is drawn for the report goes."""
        return self.out / "images" / f"{name}.png"


@dataclass(frozen=True)
class Item:
    """A figure or table of the paper.

    Attributes:
        needs: run folders, by name; the item is left out, with the reason, where one is missing.
    """

    key: str
    title: str
    needs: tuple[str, ...]
    make: Callable[[Context], Section]


def scaled(summary: Mapping[str, Any], key: str, factor: float) -> float | None:
    """A number of a summary in another unit; None where the run does not have it."""
    value = summary.get(key)
    return factor * value if isinstance(value, (int, float)) else None


def pictures(context: Context, name: str, **captions: str) -> list[tuple[Path, str]]:
    """Figures of a run that exist, with captions by the figures' names."""
    files = [(context.folder(name) / f"{stem}.png", text) for stem, text in captions.items()]
    return [(file, text) for file, text in files if file.is_file()]
