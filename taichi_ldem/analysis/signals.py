"""Numbers that are read from the records of forces, energies and velocities.

Forces are smoothed by a zero-phase moving average over a window, about a third of the period of the
specimen's first free oscillation (``analysis.window``): oscillations remain, sampling noise does
not.

- Damage onset: the first sample whose dissipated energy exceeds a thousandth of G_f H^2, the energy
  of a crack through the thickness H that is H long.
- First peak (P1, t1): the first maximum of the smoothed force, from damage onset on, after which it
  falls by 3 % before it exceeds that maximum again. Where the force falls from the onset on, it is
  the maximum of half a window before; where it falls from earlier on, the fall is not that of a
  damaged plate, and the peak is sought once the force has risen again by 3 %.
- Failure time (t2): the first time from damage onset on at which the smoothed force is below half
  of the largest before it. If the force comes back above this half before it has fallen below a
  fifth of the largest, cracks have popped in and the plate has not failed.
- Second peak (P2): the largest smoothed force between failure and the minimum after the first peak,
  if the force falls by 3 % after it. A record that ends earlier has none, and neither has a plate
  that fails at its first peak.

The paper advises to read t2 from records without oscillations (text on Figs. 13 and 14):

- t2 from the strain energy: the time of its largest value from damage onset on, if it later falls
  below half of that. Where strikers that move away from the plate, or loads, have got back at least
  half of what it lost by then, the plate has sprung back, and there is no failure.
- t2 from the velocity: the time at which the striker's deceleration (change of velocity over a
  window) falls most, if the mean deceleration from a window later to the end is less than half.
  A striker that moves away from the plate then has been thrown back, and there is no failure.

Filtered force (Fig. 11(a)): low-pass at a free-oscillation frequency of the specimen, for t > t1.
ASTM D3763: load and deflection at the largest load, energy to it, and total energy.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

ONSET_SHARE = 1e-3
PEAK_DROP = 0.03
FAILURE_SHARE = 0.5
GONE_SHARE = 0.2
SPRUNG_BACK = 0.5
FILTER_ORDER = 2

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ForcePeaks:
    """Peaks of a force record, N, their times and the time of failure, s; None: there is none."""

    first_force: float | None = None
    first_time: float | None = None
    second_force: float | None = None
    second_time: float | None = None
    failure_time: float | None = None


@dataclass(frozen=True)
class Puncture:
    """Quantities of ASTM D3763; None if the striker never touched the plate.

    Attributes:
        peak_load: largest smoothed force (see the module), N. peak_time: its time, s.
        peak_deflection: displacement of the striker from the start to that time, m.
        peak_energy: work of the force on the plate to that time, J.
        total_energy: to the end of the record, J.
    """

    peak_load: float | None = None
    peak_time: float | None = None
    peak_deflection: float | None = None
    peak_energy: float | None = None
    total_energy: float | None = None


def smooth_force(time: Array, force: Array, window: float) -> Array:
    """Zero-phase moving average of an evenly sampled record; the window shrinks at both ends.

    Args:
        time: (n,) s, evenly spaced. force: (n,) N. window: s.
    """
    if len(time) < 2:
        return np.asarray(force, dtype=float).copy()
    half = _half(time, window)
    total = np.concatenate([[0.0], np.cumsum(force)])
    index = np.arange(len(force))
    reach = np.minimum(half, np.minimum(index, len(force) - 1 - index))
    smooth: Array = (total[index + reach + 1] - total[index - reach]) / (2 * reach + 1)
    return smooth


def _half(time: Array, window: float) -> int:
    """Number of samples in half of a window (s)."""
    return round(0.5 * window / float(time[1] - time[0]))


def damage_onset(
    time: Array, fracture: Array, fracture_energy: float, height: float
) -> float | None:
    """Time at which the dissipated energy leaves zero, s (see the module), or None.

    Args:
        time: (n,) s. fracture: (n,) dissipated energy, J. fracture_energy: G_f, J/m2.
        height: the plate's thickness H, m.
    """
    above = np.flatnonzero(fracture > ONSET_SHARE * fracture_energy * height**2)
    return float(time[above[0]]) if len(above) else None


def force_peaks(time: Array, force: Array, onset: float | None, window: float) -> ForcePeaks:
    """First and second peak and the time of failure (see the module).

    Args:
        time: (n,) s, evenly spaced. force: (n,) striker force, N. onset: damage onset, s; without
            it, no peaks. window: s.
    """
    if onset is None:
        return ForcePeaks()
    smooth = smooth_force(time, force, window)
    begin = int(np.searchsorted(time, onset))
    first = _first_peak(smooth, begin)
    if first is None:
        return ForcePeaks()
    if first == begin:
        # the moving average falls before a sudden fall of the force, and that comes at some time
        # between the sample at the onset and the one before
        start = max(0, begin - _half(time, window) - 1)
        first = start + int(np.argmax(smooth[start : begin + 1]))
        if first == start and smooth[max(0, start - 1)] > smooth[start]:
            return _after_a_valley(time, smooth, begin)
    return _from_first_peak(time, smooth, first, begin)


def _after_a_valley(time: Array, smooth: Array, begin: int) -> ForcePeaks:
    """The peaks of a force that fell before the plate was damaged, once it has risen again.

    Such a fall is that of an oscillation, or of a striker that is thrown back: no peak.
    """
    lowest = np.minimum.accumulate(smooth[begin:])
    back = np.flatnonzero(smooth[begin:] > lowest + PEAK_DROP * smooth[begin])
    if not len(back):
        return ForcePeaks()
    begin += int(back[0])
    first = _first_peak(smooth, begin)
    return ForcePeaks() if first is None else _from_first_peak(time, smooth, first, begin)


def _from_first_peak(time: Array, smooth: Array, first: int, begin: int) -> ForcePeaks:
    """The first peak at an index, the failure from ``begin`` on, and the second peak."""
    found = ForcePeaks(float(smooth[first]), float(time[first]))
    end = _failure(smooth, begin)
    if end < len(time):
        found = replace(found, failure_time=float(time[end]))
    # the valley after the first peak ends where the force has risen by as much as it fell
    lowest = np.minimum.accumulate(smooth[first:end])
    back = np.flatnonzero(smooth[first:end] > lowest + PEAK_DROP * smooth[first])
    if len(back) == 0:
        return found
    start = first + int(back[0])
    second = start + int(np.argmax(smooth[start:end]))
    if smooth[second:].min() > (1 - PEAK_DROP) * smooth[second]:
        return found
    return replace(found, second_force=float(smooth[second]), second_time=float(time[second]))


def _first_peak(smooth: Array, start: int) -> int | None:
    """Index of the first maximum from ``start`` on that is followed by a fall of 3 %."""
    best = start
    for index in range(start, len(smooth)):
        if smooth[index] > smooth[best]:
            best = index
        elif smooth[index] < (1 - PEAK_DROP) * smooth[best]:
            return best
    return None


def _failure(smooth: Array, start: int) -> int:
    """Index of the failure from ``start`` on (see the module), or the length of the record."""
    largest = np.maximum.accumulate(smooth[start:])
    index = start
    while index < len(smooth):
        low = np.flatnonzero(smooth[index:] < FAILURE_SHARE * largest[index - start :])
        if not len(low):
            break
        index += int(low[0])
        share = smooth[index:] / largest[index - start]
        back, gone = np.flatnonzero(share > FAILURE_SHARE), np.flatnonzero(share < GONE_SHARE)
        if not len(back) or (len(gone) and gone[0] < back[0]):
            return index
        index += int(back[0])
    return len(smooth)


def energy_failure(
    time: Array, strain: Array, onset: float | None, given_back: Array
) -> float | None:
    """Failure time t2 from the strain energy, s (see the module), or None.

    Args:
        time: (n,) s. strain: (n,) strain energy, J. onset: damage onset, s; without it, no failure.
        given_back: (n,) energy that the plate has given back, apart from a constant, J.
    """
    if onset is None or not len(strain):
        return None
    begin = int(np.searchsorted(time, onset))
    peak = begin + int(np.argmax(strain[begin:]))
    if begin == peak > 0 and strain[peak - 1] > strain[peak]:
        return None  # it fell before there was any damage
    low = np.flatnonzero(strain[peak:] < FAILURE_SHARE * strain[peak])
    if not len(low):
        return None
    end = peak + int(low[0])
    returned = given_back[end] - given_back[peak]
    return None if returned >= SPRUNG_BACK * (strain[peak] - strain[end]) else float(time[peak])


def velocity_failure(
    time: Array, velocity: Array, onset: float | None, window: float
) -> float | None:
    """Failure time t2 from the striker's velocity, s (see the module), or None.

    Args:
        time: (n,) s, evenly spaced. velocity: (n,) m/s, positive towards the plate. onset: damage
            onset, s; without it, no failure. window: s.
    """
    if onset is None or len(time) < 3:
        return None
    step = float(time[1] - time[0])
    width = max(1, round(window / step))
    # near the end of the record half of the window is enough
    index = np.arange(max(width, int(np.searchsorted(time, onset))), len(time) - (width + 1) // 2)
    if not len(index):
        return None
    after = np.minimum(index + width, len(time) - 1)
    before = (velocity[index - width] - velocity[index]) / (width * step)
    later = (velocity[index] - velocity[after]) / (time[after] - time[index])
    kink = int(np.argmax(before - later))
    # failure takes up to half a millisecond, so that the deceleration in the end decides
    start = min(int(index[kink]) + width, len(time) - 1 - (width + 1) // 2)
    remaining = (velocity[start] - velocity[-1]) / (time[-1] - time[start])
    if velocity[index[kink]] < 0:  # thrown back: the plate has held
        return None
    if before[kink] <= 0 or remaining >= FAILURE_SHARE * before[kink]:
        return None
    return float(time[index[kink]])


def low_pass(time: Array, force: Array, cutoff: float, start: float | None) -> Array:
    """Force after zero-phase Butterworth filtering from a time on, as in Fig. 11(a).

    Second order, forwards and backwards: the gain is 1/2 at the cut-off and 1/(1 + (f/cutoff)^4)
    up to the bilinear transform's warping.

    Args:
        time: (n,) s, evenly spaced. force: (n,) N. cutoff: Hz, below half of the sampling
            frequency. start: t1, s; None: the whole record.

    Returns:
        (n,) N; NaN before ``start``, and everywhere if fewer than ten samples follow it.
    """
    from scipy.signal import butter, sosfiltfilt

    filtered = np.full(len(force), np.nan)
    begin = 0 if start is None else int(np.searchsorted(time, start))
    if len(force) - begin < 10:
        return filtered
    rate = 1 / float(time[1] - time[0])
    sections = butter(FILTER_ORDER, cutoff, fs=rate, output="sos")
    # the record is mirrored for three periods at either end, after which the filter has settled
    mirrored = min(len(force) - begin - 1, math.ceil(3 * rate / cutoff))
    filtered[begin:] = sosfiltfilt(sections, force[begin:], padlen=mirrored)
    return filtered


def puncture(time: Array, force: Array, displacement: Array, window: float) -> Puncture:
    """Quantities of ASTM D3763.

    Args:
        time: (n,) s, evenly spaced. force: (n,) N, each the mean since the sample before.
        displacement: (n,) of the striker towards the plate, m. window: of the smoothed force, s.
    """
    if not np.any(force):
        return Puncture()
    work = np.append(0.0, np.cumsum(force[1:] * np.diff(displacement)))
    smooth = smooth_force(time, force, window)
    peak = int(np.argmax(smooth))
    return Puncture(
        float(smooth[peak]),
        float(time[peak]),
        float(displacement[peak]),
        float(work[peak]),
        float(work[-1]),
    )
