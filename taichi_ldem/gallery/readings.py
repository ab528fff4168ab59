"""What several problems read from a finished run: cracks that advance, series at a place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.storage.fields import read_broken_bars
from taichi_ldem.studies.toughness.strip import rayleigh_speed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Advance:
    """A crack that runs along an axis.

    Attributes:
        time: (n,) when bars failed, s, in order.
        along, across: (n,) place of each bar along the axis from the crack's first tip, and across
            it, m.
    """

    time: Array
    along: Array
    across: Array

    @property
    def front(self) -> Array:
        """(n,) farthest bar that has failed until each time, m."""
        return np.maximum.accumulate(self.along) if len(self.along) else self.along

    def arrival(self, distance: float) -> float | None:
        """Time at which the front comes to a distance, s; None where it never does."""
        found = np.flatnonzero(self.front >= distance)
        return float(self.time[found[0]]) if len(found) else None

    def speed(self, start: float, end: float) -> float | None:
        """Mean speed of the front between two distances (m), m/s; None where it does not pass."""
        first, last = self.arrival(start), self.arrival(end)
        if first is None or last is None or last <= first:
            return None
        return (end - start) / (last - first)

    def between(self, start: float, end: float) -> Advance:
        """The bars that failed between two distances, m."""
        chosen = (self.along >= start) & (self.along <= end)
        return Advance(self.time[chosen], self.along[chosen], self.across[chosen])

    def path(self, width: float) -> tuple[Array, Array]:
        """The crack's path: places along, in steps of a width (m), and the median across, m."""
        if not len(self.along):
            return self.along, self.across
        slots = np.floor(self.along / width).astype(int)
        used = np.unique(slots)
        return (used + 0.5) * width, np.array([np.median(self.across[slots == n]) for n in used])


def advance(
    run: LoadedRun,
    *,
    tip: tuple[float, float],
    direction: tuple[float, float] = (1.0, 0.0),
    plane: str = "xy",
    reach: float = np.inf,
) -> Advance:
    """The bars of a run that failed near a line in a plane, in order of time.

    Args:
        tip: where the line begins, two coordinates, m. direction: of the line, of length one.
        plane: the two axes of these coordinates.
        reach: largest distance from the line, m.
    """
    bars = read_broken_bars(run.folder.fields_file)
    place = bars.position_m[:, ["xyz".index(axis) for axis in plane]] - np.array(tip)
    along = place @ np.array(direction)
    across = place @ np.array((-direction[1], direction[0]))
    chosen = np.abs(across) <= reach
    order = np.argsort(bars.time_s[chosen], kind="stable")
    return Advance(bars.time_s[chosen][order], along[chosen][order], across[chosen][order])


def speed_over_rayleigh(run: LoadedRun, crack: Advance, start: float, end: float) -> float | None:
    """Mean speed of a crack between two distances (m) over that of Rayleigh waves."""
    material, speed = run.scene.material, crack.speed(start, end)
    if speed is None:
        return None
    wave = rayleigh_speed(material.youngs_modulus, material.poisson_ratio, material.density)
    return speed / wave


def deviation(found: Advance) -> float | None:
    """Angle of a crack's path to its line, degrees; None below ten bars."""
    if len(found.along) < 10:
        return None
    slope = np.polyfit(found.along, found.across, 1)[0]
    return float(np.degrees(np.arctan(slope)))
