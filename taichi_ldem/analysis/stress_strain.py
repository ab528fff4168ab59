"""The stress-strain curve of a tension test: where it ends, and its initial slope."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

SCATTER = 0.005
"""Standard deviation from a fit, over the largest value, up to which its slope is accepted."""

Array = npt.NDArray[np.float64]


class Curve(NamedTuple):
    """Stress over strain; a row lies in the middle between two samples, as its force does.

    Attributes:
        time: (n,), s.
        strain: (n,) axial strain of the gauge.
        lateral: (n,) lateral strain of the gauge.
        force: (n,) mean pull of the grips, N.
    """

    time: Array
    strain: Array
    lateral: Array
    force: Array


def curve(history: Mapping[str, Array]) -> Curve:
    """The curve from the columns of a history (n rows give n - 1)."""

    def middle(name: str) -> Array:
        return 0.5 * (history[name][1:] + history[name][:-1])

    return Curve(
        middle("time_s"),
        middle("gauge_strain"),
        middle("gauge_lateral_strain"),
        history["grip_force_n"][1:],
    )


def rows_until_parted(force: Array) -> int:
    """Number of rows until the pull, once above a tenth of its maximum, first falls below zero.

    After that the grips feel the two parts vibrate, at times by more than the strength.
    """
    loaded = np.maximum.accumulate(force) > 0.1 * force.max()
    parted = np.flatnonzero(loaded & (force < 0))
    return int(parted[0]) if len(parted) else len(force)


def initial_slope(x: Array, y: Array) -> float:
    """Slope at x = 0 of the parabola that fits y over x best; nan where the fit is refused.

    It is refused for fewer than five points, where all points lie in the farther half of the range,
    and where waves leave a scatter of more than ``SCATTER``. A parabola, because finite strains and
    rotations of the bars bend the curve: the slope of a straight line would depend on where it
    ends.
    """
    if len(x) < 5 or np.abs(x).min() > 0.5 * np.abs(x).max():
        return math.nan
    fit = np.polyfit(x, y, 2)
    scatter = float(np.std(y - np.polyval(fit, x)) / np.abs(y).max())
    return float(fit[1]) if scatter <= SCATTER else math.nan


def elastic_rows(c: Curve, ramp: float, first_broken: int | None) -> npt.NDArray[np.bool_]:
    """(n,) rows to fit: from the end of the ramp to half of the strain at the largest force.

    Before the end of the ramp the grips also accelerate the specimen. A largest force after the
    first bar has broken may come from vibrating parts, so then that bar's row takes its place.

    Args:
        ramp: time in which the grips reach their speed, s.
        first_broken: row at which the first bar has broken; None: none has.
    """
    peak = int(np.argmax(c.force[: rows_until_parted(c.force)]))
    if first_broken is not None:
        peak = min(peak, first_broken)
    before = (np.arange(len(c.time)) <= peak) & (c.time >= ramp)
    return np.asarray(before & (c.strain <= 0.5 * c.strain[peak]))


def mean_rate(time: Array, values: Array) -> float:
    """Mean rate of change of values over time, their unit per second; nan for fewer than two."""
    return float((values[-1] - values[0]) / (time[-1] - time[0])) if len(time) > 1 else math.nan
