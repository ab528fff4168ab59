"""The map of a plate's cracks: when each column of modules cracked, and its crushed core."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.skeleton import closed
from taichi_ldem.model.cell import CELLS
from taichi_ldem.scene import Plate

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FAINT_SHARE = 1 / 6
DEPTH_SHARE = 1 / 3
THROUGH_SHARE = 2 / 3
CORE_SHARE = 0.5


class BrokenBars(Protocol):
    """Bars that have failed, n of them, as a run's fields hold them."""

    @property
    def time_s(self) -> Array:
        """(n,) time at which each failed, s."""

    @property
    def position_m(self) -> Array:
        """(n, 3) mid-points in the reference configuration, m."""

    @property
    def bar(self) -> NDArray[np.uint8]:
        """(n,) number of the bar at its site."""


@dataclass(frozen=True)
class CrackMap:
    """When each column of modules cracked.

    Attributes:
        arrival: (nx, ny) time from which on the column is cracked, s; infinite where never.
        spacing: edge of a pixel, one module, m.
        thickness: of the plate, m.
        axis: (2,) the striker's axis, m.
    """

    arrival: Array
    spacing: float
    thickness: float
    axis: Array

    def points(self, pixel: NDArray[np.int64]) -> Array:
        """Centres of pixels (n, 2), m; the plate's centre is the origin."""
        middle: Array = (pixel + 0.5 - 0.5 * np.array(self.arrival.shape)) * self.spacing
        return middle

    def radius(self) -> Array:
        """(nx, ny) distance of each pixel's centre from the striker's axis, m."""
        points = self.points(np.argwhere(np.ones(self.arrival.shape, dtype=bool)))
        away: Array = np.linalg.norm(points - self.axis, axis=1)
        return away.reshape(self.arrival.shape)


def crack_map(
    bars: BrokenBars,
    plate: Plate,
    axis: tuple[float, float] = (0.0, 0.0),
    depth: float = DEPTH_SHARE,
) -> CrackMap:
    """The map of a plate's cracks over time, for a share of the thickness (see ``cracks``).

    A bar on the border of two columns counts in both, so that a crack between two planes of nodes
    is closed, with a width of one or two pixels.
    """
    nx, ny, nz = plate.modules
    spacing = plate.spacing
    cell = CELLS[plate.lattice]
    chosen = np.isin(bars.bar, cell.in_plane)
    place, time = bars.position_m[chosen], bars.time_s[chosen]
    levels = cell.sublattices * nz  # above the lowest one
    level = np.clip(np.rint(levels * place[:, 2] / (nz * spacing)).astype(int), 0, levels)
    column = place[:, :2] / spacing + 0.5 * np.array([nx, ny])
    first = np.full((levels + 1, nx, ny), np.inf)
    for shift in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        # a hundredth of a module: more than rounding, less than the quarter to the next bar
        i, j = np.floor(column + 0.01 * np.array(shift)).astype(int).T
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        np.minimum.at(first, (level[inside], i[inside], j[inside]), time[inside])
    needed = math.ceil(depth * (levels + 1))
    arrival = np.partition(first, needed - 1, axis=0)[needed - 1]
    return CrackMap(arrival, spacing, plate.size[2], np.asarray(axis, dtype=float))


def core_of(at: CrackMap, mask: Mask) -> Mask:
    """The crushed core: a plate's thickness around the axis, and the broad part that surrounds it.

    A part is broad where a disc with the plate's thickness as its radius fits into it. It surrounds
    the axis up to the largest circle of which it covers half; what reaches further out is a wide
    arm, a crack.
    """
    from scipy import ndimage

    disc = at.radius() <= at.thickness
    half = max(2, round(at.thickness / at.spacing))
    i, j = np.ogrid[-half : half + 1, -half : half + 1]
    broad = ndimage.binary_opening(mask, i * i + j * j <= half * half)
    parts, _ = ndimage.label(broad | disc, np.ones((3, 3)))
    core: Mask = np.isin(parts, np.unique(parts[disc]))
    return disc | (core & (at.radius() <= _surrounding(at, core)))


def _surrounding(at: CrackMap, core: Mask) -> float:
    """Radius of the largest circle around the axis of which a mask covers half, m.

    Circles are a module wide; what lies off the plate counts for nothing.
    """
    circle = np.floor(at.radius() / at.spacing).astype(int)
    covered = np.bincount(circle[core], minlength=circle.max() + 1)
    whole = np.flatnonzero(covered >= CORE_SHARE * np.bincount(circle.ravel()))
    return float(whole.max(initial=-1) + 1) * at.spacing


def connected(at: CrackMap, time: float) -> tuple[Mask, Mask]:
    """The part of the map that is connected to the core, and the core; (nx, ny) each."""
    from scipy import ndimage

    mask = closed(at.arrival <= time)
    core = core_of(at, mask)
    parts, _ = ndimage.label(mask | core, np.ones((3, 3)))
    return np.isin(parts, np.unique(parts[core])), core


def first_arrival(arrival: Array) -> Array:
    """Arrival times; in bridged gaps, the first of those of the eight neighbours."""
    from scipy import ndimage

    nearby = ndimage.minimum_filter(arrival, 3, mode="nearest")
    return np.where(np.isfinite(arrival), arrival, nearby)
