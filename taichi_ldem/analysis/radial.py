"""Radial cracks: branches of the map's skeleton that run from the core outwards."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.circles import Circle, fit_circle
from taichi_ldem.analysis.crackmap import CrackMap, connected, first_arrival
from taichi_ldem.analysis.skeleton import Skeleton, closed, path_length

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OWN_SHARE = 0.5
SPUR_SHARE = 0.25
SHORT_SHARE = 0.5
STRAIGHTNESS = 0.5


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


def radial_cracks(at: CrackMap, faint: CrackMap, time: float) -> tuple[RadialCrack, ...]:
    """The radial cracks at a time, the furthest tip first.

    Tips are taken from the furthest to the nearest. Each tip's path along the skeleton to
    the core is a radial crack of its own, except in four cases: more than half of the path already
    belongs to another crack (a fork); its own part is shorter than the plate's thickness or than a
    quarter of the longest crack (a spur); its tip is less than half as far out as the furthest one;
    or it winds, so that its tip is less than half of its length further out than its root. The tip
    is then followed straight ahead to where the crack ends on the tension side.

    Args:
        at: the map that separates the cracks. faint: the map in which their tips are followed.
        time: s.
    """
    mask, core = connected(at, time)
    radius = at.radius()
    found: list[tuple[float, NDArray[np.int64]]] = []
    claimed = core.copy()
    paths = Skeleton(mask, core, radius).paths()
    for path in sorted(paths, key=lambda path: -float(radius[tuple(path[0])])):
        total = path_length(path) * at.spacing
        own = path_length(path[: int(np.argmax(claimed[tuple(path.T)])) + 1]) * at.spacing
        straight = radius[tuple(path[0])] - radius[tuple(path[-1])] >= STRAIGHTNESS * total
        if own >= max(at.thickness, OWN_SHARE * total) and straight:
            claimed[tuple(path.T)] = True
            found.append((own, path[::-1]))
    longest = SPUR_SHARE * max((path_length(path) * at.spacing for _, path in found), default=0.0)
    furthest = SHORT_SHARE * max((radius[tuple(path[-1])] for _, path in found), default=0.0)
    arrival = first_arrival(faint.arrival)
    begun = closed(faint.arrival <= time)
    whole = [
        _followed(path, begun, radius)
        for own, path in found
        if own >= longest and radius[tuple(path[-1])] >= furthest
    ]
    whole.sort(key=lambda path: -float(radius[tuple(path[-1])]))
    return tuple(
        RadialCrack(at.points(path[-1]), at.points(path), arrival[tuple(path.T)]) for path in whole
    )


def _followed(path: NDArray[np.int64], begun: Mask, radius: Array) -> NDArray[np.int64]:
    """The path (core first), continued to the furthest pixel that is connected to its tip.

    Only pixels within 30 degrees of its last ten pixels' direction belong to it.
    """
    from scipy import ndimage
    from skimage.draw import line

    tip, back = path[-1], path[-min(len(path), 11)]
    ahead = np.argwhere(begun) - tip
    along = ahead @ (tip - back) / max(math.dist(tip, back), 1.0)
    near = np.zeros_like(begun)
    chosen = along >= math.cos(math.radians(30)) * np.linalg.norm(ahead, axis=1)
    near[tuple((tip + ahead[chosen]).T)] = True
    near[tuple(tip)] = True
    parts, _ = ndimage.label(near, np.ones((3, 3)))
    reach = np.where(parts == parts[tuple(tip)], radius, -1.0)
    end = np.unravel_index(int(np.argmax(reach)), reach.shape)
    return np.vstack([path, np.column_stack(line(*tip, *end))[1:]])


def circle_through_tips(radial: tuple[RadialCrack, ...], axis: Array) -> Circle | None:
    """Circle through the tips; None where they leave a gap of half a turn around the axis."""
    if len(radial) < 3:
        return None
    tips = np.array([crack.tip for crack in radial])
    angle = np.sort(np.arctan2(*(tips - axis).T[::-1]))
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    if gaps.max() >= np.pi:
        return None
    # all tips have the same weight: every distance is far below the scale
    return fit_circle(tips, axis, 1e3 * float(np.abs(tips).max()))
