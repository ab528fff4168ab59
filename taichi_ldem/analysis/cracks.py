"""Cracks measured from broken bars: the map, radial cracks, circular crack and their growth.

The functions take arrays. Everything is in the reference configuration and in SI units; x and y are
those of the plate. docs/cracks.md gives the definitions, their grounds and their limits.

- **Map**: a raster of the plate's plane with one pixel for each column of modules. A column is
  cracked from the time at which bars in the plate's plane have failed on a third of its 2 n + 1
  levels (n modules through the thickness); it is cracked through from two thirds on. Such bars
  cross every crack except one parallel to the plate, so that delamination and damage of one face
  do not count as cracks.
- **Radial crack**: a branch of the map's skeleton from a tip to the crushed core that surrounds the
  striker's axis, of which at least half belongs to no other crack. Its tip is where it has
  reached a sixth of the thickness, since a crack in bending is longest on the face in tension.
- **d_r**: the diameter of the circle through the tips of the radial cracks at t2 (largest strain
  energy), just before the circular crack (text below Fig. 14 of the paper).
- **d_c**: the diameter of the circle through the circular crack: those parts of the skeleton that
  are cracked through at the end, cracked after t2 and run around the axis. Both circles have free
  centres, as in Section 3.1 of the paper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.circles import Circle, directions, fit_circle, turn_covered
from taichi_ldem.analysis.crackmap import (
    FAINT_SHARE,
    THROUGH_SHARE,
    BrokenBars,
    CrackMap,
    core_of,
    crack_map,
    first_arrival,
)
from taichi_ldem.analysis.radial import RadialCrack, circle_through_tips, radial_cracks
from taichi_ldem.analysis.skeleton import closed, pixel_lengths, thin
from taichi_ldem.analysis.window import PLATE_WINDOW
from taichi_ldem.scene import Plate, Scene

Array = NDArray[np.float64]

RING_BAND = 0.25
RING_COVERAGE = 0.5


@dataclass(frozen=True)
class Growth:
    """Cracks over time.

    Attributes:
        time: (n,) s.
        tip_radius: (n,) distance of the furthest radial tip from the striker's axis, m; NaN before
            a radial crack has left the core, and after the time of the radial map.
        tip_speed: (n,) slope of ``tip_radius`` over a window, m/s; NaN where that has none.
        length: (n,) length of all cracks outside of the core, m.
        window: of the speed, s.
    """

    time: Array
    tip_radius: Array
    tip_speed: Array
    length: Array
    window: float


@dataclass(frozen=True)
class Cracks:
    """The cracks of a run, measured.

    Attributes:
        faint: when each column of modules began to crack (to a sixth of the thickness).
        map: when it cracked (to a third).
        through: when it cracked through (to two thirds).
        radial_time: of the map in which radial cracks are counted: t2 by the strain energy, or the
            end of a record without failure, s.
        radial: the radial cracks, the furthest tip first; empty where there is none.
        radial_circle: circle through their tips (its diameter is d_r); None with fewer than three
            tips, or with all of them on one side of the axis.
        circular_circle: circle through the circular crack (its diameter is d_c); None where the
            parts that run around the axis cover less than half of the turn.
        circular_coverage: share of the turn that those parts cover (0 to 1), also where it is too
            small for a circle.
        circular_points: (n, 2) skeleton points that the circle was fitted to, m.
        growth: tip radius, speed and length over time.
    """

    faint: CrackMap
    map: CrackMap
    through: CrackMap
    radial_time: float
    radial: tuple[RadialCrack, ...]
    radial_circle: Circle | None
    circular_circle: Circle | None
    circular_coverage: float
    circular_points: Array
    growth: Growth

    @property
    def at_failure(self) -> bool:
        """Whether radial cracks are counted at failure, rather than at the end without one."""
        return bool(len(self.growth.time)) and self.radial_time < float(self.growth.time[-1])

    @property
    def mean_speed(self) -> float | None:
        """Slope of a straight line through the furthest tip's radius over time, m/s, or None."""
        known = np.isfinite(self.growth.tip_radius)
        if np.unique(self.growth.tip_radius[known]).size < 2:
            return None
        time, radius = self.growth.time[known], self.growth.tip_radius[known]
        return float(np.polyfit(time - time[0], radius, 1)[0])

    def summary(self) -> dict[str, Any]:
        """The numbers for ``summary.json``; None for what the run does not have."""
        radial, ring, growth = self.radial_circle, self.circular_circle, self.growth
        speed = growth.tip_speed[np.isfinite(growth.tip_speed)]
        reach = growth.tip_radius[np.isfinite(growth.tip_radius)]
        return NO_CRACKS | {
            "radial_cracks": len(self.radial),
            "radial_diameter_m": radial.diameter if radial else None,
            "radial_centre_m": [radial.x, radial.y] if radial else None,
            "radial_scatter_m": radial.scatter if radial else None,
            "radial_time_s": self.radial_time,
            "radial_tip_m": float(reach.max()) if reach.size else None,
            "circular_diameter_m": ring.diameter if ring else None,
            "circular_centre_m": [ring.x, ring.y] if ring else None,
            "circular_scatter_m": ring.scatter if ring else None,
            "circular_coverage": self.circular_coverage,
            "crack_length_m": float(growth.length[-1]) if growth.length.size else 0.0,
            "crack_speed_mean_m_s": self.mean_speed,
            "crack_speed_max_m_s": float(speed.max()) if speed.size else None,
        }


NO_CRACKS: dict[str, Any] = {
    "radial_cracks": 0,
    "radial_diameter_m": None,
    "radial_centre_m": None,
    "radial_scatter_m": None,
    "radial_time_s": None,
    "radial_tip_m": None,
    "circular_diameter_m": None,
    "circular_centre_m": None,
    "circular_scatter_m": None,
    "circular_coverage": 0.0,
    "crack_length_m": 0.0,
    "crack_speed_mean_m_s": None,
    "crack_speed_max_m_s": None,
}
"""The numbers of ``Cracks.summary`` for a run in which nothing broke."""


def measure(
    bars: BrokenBars,
    plate: Plate,
    axis: tuple[float, float] = (0.0, 0.0),
    radial_time: float | None = None,
    time: Array | None = None,
    window: float = PLATE_WINDOW,
) -> Cracks:
    """Measure cracks from broken bars.

    Args:
        bars: place in the reference configuration, time and kind of each.
        plate: its modules and their size.
        axis: of the striker, m.
        radial_time: just before the circular crack, s; None: radial cracks are counted at the end,
            and the circular crack is recognised by its direction alone.
        time: (n,) of the growth curves, s; None: the times at which bars broke.
        window: over which the tips' speed is taken, s.
    """
    at = crack_map(bars, plate, axis)
    through = crack_map(bars, plate, axis, THROUGH_SHARE)
    ring, coverage, points = circular_crack(through, radial_time)
    if radial_time is None:
        radial_time = float(np.append(bars.time_s, [] if time is None else time).max(initial=0.0))
    faint = crack_map(bars, plate, axis, FAINT_SHARE)
    radial = radial_cracks(at, faint, radial_time)
    time = np.unique(bars.time_s) if time is None else time
    return Cracks(
        faint,
        at,
        through,
        radial_time,
        radial,
        circle_through_tips(radial, at.axis),
        ring,
        coverage,
        points,
        _growth(at, radial, radial_time, time, window),
    )


def circular_crack(at: CrackMap, after: float | None) -> tuple[Circle | None, float, Array]:
    """Circle through the circular crack of the final map, its coverage, and the points used.

    A point of the skeleton belongs to it where its direction is nearer to the circle's tangent
    than to its radius. The fit has a free centre; it is repeated about the centre found.

    Args:
        at: the map of columns that are cracked through.
        after: time after which the circular crack formed, s; None: at any time.

    Returns:
        The circle, or None; the share of the turn covered; (n, 2) points, m.
    """
    mask = closed(np.isfinite(at.arrival))
    core = core_of(at, mask)
    skeleton = thin(mask | core) & ~core
    pixels = np.argwhere(skeleton if after is None else skeleton & (at.arrival > after))
    none: tuple[Circle | None, float, Array] = (None, 0.0, np.empty((0, 2)))
    points = at.points(pixels)
    if len(points) < 3:
        return none
    direction = directions(points, max(3 * at.spacing, at.thickness))
    centre, circle, used = at.axis, None, points[:0]
    for _ in range(3):
        ray = points - centre
        away = np.linalg.norm(ray, axis=1)
        along = np.abs((direction * ray).sum(axis=1)) < away * math.sqrt(0.5)
        used = points[along & (away > at.thickness)]
        circle = fit_circle(used, centre, 0.5 * at.thickness)
        if circle is None:
            return none
        centre = np.array([circle.x, circle.y])
    assert circle is not None
    off = np.linalg.norm(used - centre, axis=1) - circle.diameter / 2
    used = used[np.abs(off) <= RING_BAND * circle.diameter / 2]
    coverage = turn_covered(used - centre)
    around = math.dist(centre, at.axis) < circle.diameter / 2
    return (circle if around and coverage >= RING_COVERAGE else None), coverage, used


def _growth(
    at: CrackMap,
    radial: tuple[RadialCrack, ...],
    radial_time: float,
    time: Array,
    window: float,
) -> Growth:
    tip = np.full(len(time), np.nan)
    if radial:
        radius = np.concatenate([np.linalg.norm(c.path - at.axis, axis=1) for c in radial])
        tip = _largest_until(time, np.concatenate([c.arrival for c in radial]), radius)
    tip[time > radial_time] = np.nan
    mask = closed(np.isfinite(at.arrival))
    core = core_of(at, mask)
    skeleton = thin(mask | core) & ~core
    arrival = first_arrival(at.arrival)[skeleton]
    length = _sum_until(time, arrival, pixel_lengths(skeleton) * at.spacing)
    if not len(time):
        return Growth(time, tip, tip, length, window)
    half = 0.5 * window
    ends = [np.interp(time + s, time, tip, np.nan, np.nan) for s in (-half, half)]
    return Growth(time, tip, (ends[1] - ends[0]) / window, length, window)


def _largest_until(time: Array, arrival: Array, value: Array) -> Array:
    """Largest of the values whose arrival is not after each time; NaN before the first."""
    order = np.argsort(arrival, kind="stable")
    largest = np.append(np.nan, np.maximum.accumulate(value[order]))
    result: Array = largest[np.searchsorted(arrival[order], time, side="right")]
    return result


def _sum_until(time: Array, arrival: Array, value: Array) -> Array:
    """Sum of the values whose arrival is not after each time."""
    order = np.argsort(arrival, kind="stable")
    total = np.append(0.0, np.cumsum(value[order]))
    result: Array = total[np.searchsorted(arrival[order], time, side="right")]
    return result


def broken_area(bars: BrokenBars, scene: Scene, time: Array) -> Array:
    """Area of all broken bars by each time, (n,) m2: the area that G_f refers to (Eqs. (4) to (8)).

    Bars on a face or an edge of the prism carry 1/2 or 1/4 where the scene weights surfaces, so
    that a plane crack normal to a cube edge has its geometric area. A disc's rim counts as inside.
    """
    from taichi_ldem.model.cell import CELLS
    from taichi_ldem.model.material import bars_of

    plate, cell = scene.plate, CELLS[scene.plate.lattice]
    areas = np.array([family.fracture_area for family in bars_of(scene)])
    area = areas[np.array(cell.family)[bars.bar]]
    if plate.surface_weights:
        half = 0.5 * np.array(plate.actual_size)
        from_middle = np.abs(bars.position_m - [0.0, 0.0, half[2]])
        on_face = from_middle > half - 0.01 * plate.spacing
        # the middle of a bar lies on a face that the bar is not in only where the bar lies outside
        area *= 0.5 ** on_face.sum(axis=1)
    return _sum_until(time, bars.time_s, area)
