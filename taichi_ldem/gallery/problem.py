"""What a problem of the gallery consists of: runs, a judgement, a figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.scene import Scene, load_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENES = Path(__file__).parent / "scenes"
"""Folder of the scene files."""

Runs = Mapping[str, LoadedRun]
"""The finished runs of a problem by their names; in a quick gallery some are not there."""


@dataclass(frozen=True)
class Run:
    """A run that a problem needs.

    Attributes:
        name: of its folder within the problem's.
        scene: file of ``SCENES``.
        settings: keys that differ from the file, "section.key=value" each.
        quick: further ones for a quick gallery; None: the run is left out of it.
    """

    name: str
    scene: str
    settings: tuple[str, ...] = ()
    quick: tuple[str, ...] | None = ()

    def resolved(self, *, quick: bool, threads: int | None = None) -> Scene:
        """The scene to run.

        Args:
            threads: in place of the scene's.
        """
        settings = [*self.settings, *((self.quick or ()) if quick else ())]
        if threads is not None:
            settings.append(f"solver.threads={threads}")
        return load_scene(SCENES / self.scene, settings)


@dataclass(frozen=True)
class Finding:
    """A computed number and what it should be.

    Attributes:
        computed: in ``unit``; None where the run does not have it.
        reference: as its source states it.
        low, high: the interval in ``unit`` that counts as a hit. It comes from the source or from
            the spread between sources, never from this program.
        run: which of the problem's runs it belongs to, in words; empty where there is one.
    """

    quantity: str
    unit: str
    computed: float | None
    reference: str
    low: float
    high: float
    run: str = ""

    @property
    def holds(self) -> bool:
        """Whether the computed number is in the interval."""
        return bool(self.computed is not None and self.low <= self.computed <= self.high)

    @property
    def difference(self) -> str:
        """From the nearest end of the interval, or from its middle where it holds."""
        if self.computed is None:
            return "no result"
        middle = 0.5 * (self.low + self.high)
        bounded = math.isfinite(middle)
        if self.holds:
            if not bounded or not middle:
                return "within"
            return f"{100 * (self.computed / middle - 1):+.1f} % of the middle"
        end = self.low if self.computed < self.low else self.high
        if not end:
            return f"{self.computed - end:+.3g} from its end"
        return f"{100 * (self.computed / end - 1):+.1f} % beyond its end"


def near(
    quantity: str,
    unit: str,
    computed: float | None,
    value: float,
    tolerance: float,
    *,
    digits: int = 4,
    run: str = "",
) -> Finding:
    """A finding next to a theoretical value, with a relative tolerance."""
    low, high = sorted((value * (1 - tolerance), value * (1 + tolerance)))
    text = f"{value:.{digits}g} ± {100 * tolerance:g} %"
    return Finding(quantity, unit, computed, text, low, high, run)


def between(
    quantity: str, unit: str, computed: float | None, low: float, high: float, *, run: str = ""
) -> Finding:
    """A finding next to a range; an end may be infinite."""
    if math.isinf(high):
        text = f"above {low:g}"
    elif math.isinf(low):
        text = f"below {high:g}"
    else:
        text = f"{low:g} to {high:g}"
    return Finding(quantity, unit, computed, text, low, high, run)


@dataclass(frozen=True)
class Problem:
    """A problem of the gallery.

    Attributes:
        title: in words.
        about: what is run, for the page.
        source: where the reference and its tolerance come from.
        runs: what has to be run.
        judge: the findings, from the finished runs.
        draw: draws the figure. size: its width and height, inches.
        why: what is known about a miss, or about what the method cannot do; for the page.
    """

    title: str
    about: str
    source: str
    runs: tuple[Run, ...]
    judge: Callable[[Runs], list[Finding]]
    draw: Callable[[Figure, Runs], None]
    size: tuple[float, float] = (8.0, 5.0)
    why: str = ""

    def wanted(self, *, quick: bool) -> list[Run]:
        """The runs of a whole or of a quick gallery."""
        return [run for run in self.runs if not quick or run.quick is not None]
