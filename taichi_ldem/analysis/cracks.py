"""Cracks that measure themselves: from broken bars to a map, its radial cracks and its ring.

Reads arrays or a run folder and is never imported by the solver. Everything is in the reference
configuration and in SI units; x, y are those of the plate. docs/cracks.md has the definitions, what
they rest on, and where they end.

- **Map**: a raster of the plate's plane, one pixel a column of modules. A column is cracked from
  the time on at which bars lying in the plate's plane have failed on a third of its 2 n + 1
  levels (n modules through the thickness), and cracked through from two thirds on. Such bars cross
  every crack but one parallel to the plate, so delamination and damage of one face are not taken
  for a crack.
- **Radial crack**: a branch of the map's skeleton, from a tip to the crushed core around the
  striker's axis, that is its own for at least half of its length; its tip is where it has reached a
  sixth of the thickness, since a crack in bending is longest on the face in tension.
- **d_r**: the circle through the tips of the radial cracks at t2 (largest strain energy), just
  before the circular crack (text below Fig. 14 of the paper).
- **d_c**: the circle through those parts of the skeleton of what is cracked through at the end that
  cracked after t2 and run around the axis. Both circles have free centres, as in Section 3.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.skeleton import Skeleton, closed, pixel_lengths, thin, way_length
from taichi_ldem.scene import Plate, Scene, load_scene
from taichi_ldem.storage.store import BrokenBars, RunFolder, read_broken_bars

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

IN_PLANE_BARS = (0, 1, 3, 4)
"""Bars along x and y, of both sublattices (``store.BAR_NUMBERING``)."""

FAINT_SHARE = 1 / 6
DEPTH_SHARE = 1 / 3
THROUGH_SHARE = 2 / 3
OWN_SHARE = 0.5
SPUR_SHARE = 0.25
SHORT_SHARE = 0.5
STRAIGHTNESS = 0.5
RING_BAND = 0.25
RING_COVERAGE = 0.5
SECTORS = 36
SPEED_WINDOW = 0.2e-3


@dataclass(frozen=True)
class Circle:
    """A circle fitted to points.

    Attributes:
        x, y: its centre, m.
        diameter: m.
        scatter: root mean square of the points' distances from the circle, m.
    """

    x: float
    y: float
    diameter: float
    scatter: float


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


@dataclass(frozen=True)
class RadialCrack:
    """A radial crack at the time of the radial map.

    Attributes:
        tip: (2,) its end, m.
        path: (n, 2) its skeleton from the core to the tip, m.
        arrival: (n,) time at which the crack reached each point of the path, s; may be infinite
            where a gap of a pixel was bridged.
    """

    tip: Array
    path: Array
    arrival: Array


@dataclass(frozen=True)
class Growth:
    """Cracks over time.

    Attributes:
        time: (n,) s.
        tip_radius: (n,) distance of the furthest radial tip from the striker's axis, m; NaN before
            a radial crack has left the core, and after the time of the radial map.
        tip_speed: (n,) slope of ``tip_radius`` over 0.2 ms, m/s; NaN where that has none.
        length: (n,) length of all cracks outside of the core, m.
    """

    time: Array
    tip_radius: Array
    tip_speed: Array
    length: Array


@dataclass(frozen=True)
class Cracks:
    """What the broken bars of a run show.

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
        """The numbers for ``summary.json``; None where a thing is not there."""
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
"""What ``Cracks.summary`` gives, of a run in which nothing broke."""


def measure_run(folder: RunFolder) -> Cracks | None:
    """Measure the cracks of a run folder; None for a scene without damage or without a broken bar.

    Raises:
        SceneError: a file of the run cannot be read.
    """
    from taichi_ldem.analysis.signals import energy_failure

    scene = load_scene(folder.scene_file)
    if not scene.material.damage or not folder.fields_file.is_file():
        return None
    bars = read_broken_bars(folder.fields_file)
    if not len(bars.bar):
        return None
    history = folder.read_history()
    time, strain = history["time_s"], history["strain_j"]
    position = scene.striker.position if scene.striker else (0.0, 0.0)
    return measure(bars, scene.plate, position, energy_failure(time, strain), time)


def measure(
    bars: BrokenBars,
    plate: Plate,
    axis: tuple[float, float] = (0.0, 0.0),
    radial_time: float | None = None,
    time: Array | None = None,
) -> Cracks:
    """Measure cracks from broken bars.

    Args:
        bars: place in the reference configuration, time and kind of each.
        plate: its modules and their size.
        axis: of the striker, m.
        radial_time: just before the circular crack, s; None: radial cracks are counted at the end,
            and the circular one is told by its direction alone.
        time: (n,) of the growth curves, s; None: the times at which bars broke.
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
        _through_tips(radial, at.axis),
        ring,
        coverage,
        points,
        _growth(at, radial, radial_time, time),
    )


def crack_map(
    bars: BrokenBars,
    plate: Plate,
    axis: tuple[float, float] = (0.0, 0.0),
    depth: float = DEPTH_SHARE,
) -> CrackMap:
    """The map of a plate's cracks over time (see the module), for a share of the thickness.

    A bar on the border of two columns counts in both: a crack between two planes of nodes is then
    closed, at a width of one or two pixels.
    """
    nx, ny, nz = plate.modules
    spacing = plate.spacing
    chosen = np.isin(bars.bar, IN_PLANE_BARS)
    place, time = bars.position_m[chosen], bars.time_s[chosen]
    level = np.clip(np.rint(2 * place[:, 2] / spacing).astype(int), 0, 2 * nz)
    column = place[:, :2] / spacing + 0.5 * np.array([nx, ny])
    first = np.full((2 * nz + 1, nx, ny), np.inf)
    for shift in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        # a hundredth of a module: more than rounding, less than the quarter to the next bar
        i, j = np.floor(column + 0.01 * np.array(shift)).astype(int).T
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        np.minimum.at(first, (level[inside], i[inside], j[inside]), time[inside])
    needed = math.ceil(depth * (2 * nz + 1))
    arrival = np.partition(first, needed - 1, axis=0)[needed - 1]
    return CrackMap(arrival, spacing, plate.size[2], np.asarray(axis, dtype=float))


def radial_cracks(at: CrackMap, faint: CrackMap, time: float) -> tuple[RadialCrack, ...]:
    """The radial cracks at a time, the furthest tip first.

    Tips are taken from the furthest to the nearest. The way of each along the skeleton to the core
    is a radial crack of its own unless more than half of it is another's already (a fork), what is
    its own is shorter than the plate's thickness or than a quarter of the longest crack (a spur),
    its tip is less than half as far out as the furthest, or it winds so that its tip is less than
    half of its length further out than its root. Then its tip is followed straight on to where
    the crack ends on the tension side.

    Args:
        at: the map that tells cracks apart. faint: the map in which their tips are followed.
        time: s.
    """
    mask, core = _connected(at, time)
    radius = at.radius()
    found: list[tuple[float, NDArray[np.int64]]] = []
    claimed = core.copy()
    ways = Skeleton(mask, core, radius).ways()
    for way in sorted(ways, key=lambda way: -float(radius[tuple(way[0])])):
        total = way_length(way) * at.spacing
        own = way_length(way[: int(np.argmax(claimed[tuple(way.T)])) + 1]) * at.spacing
        straight = radius[tuple(way[0])] - radius[tuple(way[-1])] >= STRAIGHTNESS * total
        if own >= max(at.thickness, OWN_SHARE * total) and straight:
            claimed[tuple(way.T)] = True
            found.append((own, way[::-1]))
    longest = SPUR_SHARE * max((way_length(way) * at.spacing for _, way in found), default=0.0)
    furthest = SHORT_SHARE * max((radius[tuple(way[-1])] for _, way in found), default=0.0)
    earliest = _earliest(faint.arrival)
    begun = closed(faint.arrival <= time)
    whole = [
        _followed(way, begun, radius)
        for own, way in found
        if own >= longest and radius[tuple(way[-1])] >= furthest
    ]
    whole.sort(key=lambda way: -float(radius[tuple(way[-1])]))
    return tuple(
        RadialCrack(at.points(way[-1]), at.points(way), earliest[tuple(way.T)]) for way in whole
    )


def _followed(way: NDArray[np.int64], begun: Mask, radius: Array) -> NDArray[np.int64]:
    """A way (core first), continued to the furthest pixel that hangs together with its tip.

    Only pixels within 30 degrees of its last ten pixels' direction belong to it.
    """
    from scipy import ndimage
    from skimage.draw import line

    tip, back = way[-1], way[-min(len(way), 11)]
    ahead = np.argwhere(begun) - tip
    along = ahead @ (tip - back) / max(math.dist(tip, back), 1.0)
    near = np.zeros_like(begun)
    chosen = along >= math.cos(math.radians(30)) * np.linalg.norm(ahead, axis=1)
    near[tuple((tip + ahead[chosen]).T)] = True
    near[tuple(tip)] = True
    parts, _ = ndimage.label(near, np.ones((3, 3)))
    reach = np.where(parts == parts[tuple(tip)], radius, -1.0)
    end = np.unravel_index(int(np.argmax(reach)), reach.shape)
    return np.vstack([way, np.column_stack(line(*tip, *end))[1:]])


def circular_crack(at: CrackMap, after: float | None) -> tuple[Circle | None, float, Array]:
    """Circle through the circular crack of the final map, its coverage, and the points used.

    Points of the skeleton whose local direction is nearer to the turn than to the ray are fitted
    with a free centre, and direction and fit repeated about the centre found.

    Args:
        at: the map of what is cracked through.
        after: time after which the circular crack formed, s; None: at any time.

    Returns:
        The circle, or None; the share of the turn covered; (n, 2) points, m.
    """
    mask = closed(np.isfinite(at.arrival))
    core = _core(at, mask)
    skeleton = thin(mask | core) & ~core
    pixels = np.argwhere(skeleton if after is None else skeleton & (at.arrival > after))
    none: tuple[Circle | None, float, Array] = (None, 0.0, np.empty((0, 2)))
    points = at.points(pixels)
    if len(points) < 3:
        return none
    direction = _directions(points, max(3 * at.spacing, at.thickness))
    centre, circle, used = at.axis, None, points[:0]
    for _ in range(3):
        ray = points - centre
        away = np.linalg.norm(ray, axis=1)
        along = np.abs((direction * ray).sum(axis=1)) < away * math.sqrt(0.5)
        used = points[along & (away > at.thickness)]
        circle = _fit_circle(used, centre, 0.5 * at.thickness)
        if circle is None:
            return none
        centre = np.array([circle.x, circle.y])
    assert circle is not None
    off = np.linalg.norm(used - centre, axis=1) - circle.diameter / 2
    used = used[np.abs(off) <= RING_BAND * circle.diameter / 2]
    coverage = _coverage(used - centre)
    around = math.dist(centre, at.axis) < circle.diameter / 2
    return (circle if around and coverage >= RING_COVERAGE else None), coverage, used


# --- raster --------------------------------------------------------------------------


def _core(at: CrackMap, mask: Mask) -> Mask:
    """The crushed core: a plate's thickness around the axis, and all that is broad and touches it.

    Broad is what a disc of the plate's thickness as radius fits into.
    """
    from scipy import ndimage

    disc = at.radius() <= at.thickness
    half = max(2, round(at.thickness / at.spacing))
    i, j = np.ogrid[-half : half + 1, -half : half + 1]
    broad = ndimage.binary_opening(mask, i * i + j * j <= half * half)
    parts, _ = ndimage.label(broad | disc, np.ones((3, 3)))
    core: Mask = np.isin(parts, np.unique(parts[disc]))
    return core


def _connected(at: CrackMap, time: float) -> tuple[Mask, Mask]:
    """The part of the map that hangs together with the core, and the core."""
    from scipy import ndimage

    mask = closed(at.arrival <= time)
    core = _core(at, mask)
    parts, _ = ndimage.label(mask | core, np.ones((3, 3)))
    return np.isin(parts, np.unique(parts[core])), core


def _earliest(arrival: Array) -> Array:
    """Arrival, and where a gap was bridged the first one of the eight neighbours."""
    from scipy import ndimage

    beside = ndimage.minimum_filter(arrival, 3, mode="nearest")
    return np.where(np.isfinite(arrival), arrival, beside)


# --- circles and time -----------------------------------------------------------------------------


def _directions(points: Array, reach: float) -> Array:
    """(n, 2) unit vector along the skeleton at each point: first principal axis within a reach."""
    from scipy.spatial import KDTree

    tree = KDTree(points)
    result = np.empty_like(points)
    for number, near in enumerate(tree.query_ball_point(points, reach)):
        beside = points[near] - points[near].mean(axis=0)
        result[number] = np.linalg.eigh(beside.T @ beside)[1][:, 1]
    return result


def _fit_circle(points: Array, guess: Array, scale: float) -> Circle | None:
    """Circle of least distances (m) through points, free centre; None for fewer than three points.

    Args:
        points: (n, 2) m. guess: (2,) m. scale: distance beyond which a point loses weight, m.
    """
    from scipy.optimize import least_squares

    if len(points) < 3:
        return None

    def off(p: Array) -> Array:
        distance: Array = np.linalg.norm(points - p[:2], axis=1) - p[2]
        return distance

    start = np.append(guess, np.median(np.linalg.norm(points - guess, axis=1)))
    fit = least_squares(off, start, loss="soft_l1", f_scale=scale, x_scale=start[2])
    x, y, radius = fit.x
    scatter = math.sqrt(float(np.mean(off(fit.x) ** 2)))
    return Circle(float(x), float(y), float(2 * radius), scatter)


def _through_tips(radial: tuple[RadialCrack, ...], axis: Array) -> Circle | None:
    """Circle through the tips where they stand around the axis (no gap of half a turn)."""
    if len(radial) < 3:
        return None
    tips = np.array([crack.tip for crack in radial])
    angle = np.sort(np.arctan2(*(tips - axis).T[::-1]))
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    if gaps.max() >= np.pi:
        return None
    # no tip counts less than another: every distance is far within the scale
    return _fit_circle(tips, axis, 1e3 * float(np.abs(tips).max()))


def _coverage(ray: Array) -> float:
    """Share of 36 sectors of ten degrees that hold a point, rays (n, 2) from the centre."""
    turn = np.arctan2(ray[:, 1], ray[:, 0]) / (2 * np.pi) % 1.0
    return len(np.unique((turn * SECTORS).astype(int) % SECTORS)) / SECTORS


def _growth(
    at: CrackMap, radial: tuple[RadialCrack, ...], radial_time: float, time: Array
) -> Growth:
    tip = np.full(len(time), np.nan)
    if radial:
        radius = np.concatenate([np.linalg.norm(c.path - at.axis, axis=1) for c in radial])
        tip = _largest_until(time, np.concatenate([c.arrival for c in radial]), radius)
    tip[time > radial_time] = np.nan
    mask = closed(np.isfinite(at.arrival))
    core = _core(at, mask)
    skeleton = thin(mask | core) & ~core
    arrival = _earliest(at.arrival)[skeleton]
    length = _sum_until(time, arrival, pixel_lengths(skeleton) * at.spacing)
    if not len(time):
        return Growth(time, tip, tip, length)
    half = 0.5 * SPEED_WINDOW
    ends = [np.interp(time + s, time, tip, np.nan, np.nan) for s in (-half, half)]
    return Growth(time, tip, (ends[1] - ends[0]) / SPEED_WINDOW, length)


def _largest_until(time: Array, arrival: Array, value: Array) -> Array:
    """Largest value that has arrived by each time; NaN before the first."""
    order = np.argsort(arrival, kind="stable")
    largest = np.append(np.nan, np.maximum.accumulate(value[order]))
    result: Array = largest[np.searchsorted(arrival[order], time, side="right")]
    return result


def _sum_until(time: Array, arrival: Array, value: Array) -> Array:
    """Sum of what has arrived by each time."""
    order = np.argsort(arrival, kind="stable")
    total = np.append(0.0, np.cumsum(value[order]))
    result: Array = total[np.searchsorted(arrival[order], time, side="right")]
    return result


def broken_area(bars: BrokenBars, scene: Scene, time: Array) -> Array:
    """Area of all broken bars by each time, m2: what G_f is paid for (Eqs. (4) to (8)).

    Bars on a face or an edge of the prism carry 1/2 or 1/4 where the scene weights surfaces, so
    that a plane crack normal to a cube edge has its geometric area. A disc's rim counts as inside.
    """
    from taichi_ldem.model.material import fracture_areas

    plate, material = scene.plate, scene.material
    longitudinal, diagonal = fracture_areas(material.poisson_ratio, material.fracture_areas)
    area = np.where(bars.bar < 6, longitudinal, diagonal) * plate.spacing**2
    if plate.surface_weights:
        half = 0.5 * np.array(plate.actual_size)
        from_middle = np.abs(bars.position_m - [0.0, 0.0, half[2]])
        on_face = from_middle > half - 0.01 * plate.spacing
        # the middle of an edge bar lies on a face that it is normal to only if it lies outside
        area *= np.where(bars.bar < 3, 0.5 ** on_face.sum(axis=1), 1.0)
    return _sum_until(time, bars.time_s, area)
