"""The course of a load in time: its factor and the factor's integral, in f64 on the device.

Sine and cosine are written as sums, because not every backend has them in f64.
"""

import math
from collections.abc import Sequence

import numpy as np
import taichi as ti

from taichi_ldem.scene import Load
from taichi_ldem.solver.state import field_apart

COURSES = ("constant", "ramp", "half-sine", "table")
CONSTANT, RAMP, HALF_SINE, TABLE = range(4)

# the numbers of a load's course
COURSE, BEGIN, RISE, DURATION, FIRST, LAST = range(6)
WIDTH = 6

TERMS = 12
"""Of the sums for sine and cosine of at most a right angle: the next is below 1e-18."""


def points_of(loads: Sequence[Load]) -> int:
    """Number of points of all tables."""
    return sum(len(load.times or ()) for load in loads)


@ti.data_oriented
class Courses:
    """The courses of all loads.

    Attributes:
        numbers: (loads, WIDTH) f64. times, factors: (points,) f64, those of a load together.
        integrals: (points,) f64, of the factor from a load's start up to each point, s.
    """

    def __init__(self, loads: int, points: int):
        self.numbers = field_apart(ti.f64, (loads, WIDTH))
        self.times = field_apart(ti.f64, max(points, 1))
        self.factors = field_apart(ti.f64, max(points, 1))
        self.integrals = field_apart(ti.f64, max(points, 1))

    def set(self, loads: Sequence[Load]) -> None:
        """Take the courses of a scene's loads."""
        numbers = np.zeros((len(loads), WIDTH))
        tables = np.zeros((3, self.times.shape[0]))
        first = 0
        for n, load in enumerate(loads):
            duration = math.inf if load.duration is None else load.duration
            last = first + max(len(load.times or ()) - 1, 0)
            course = COURSES.index(load.course)
            numbers[n] = course, load.start, load.ramp or 0.0, duration, first, last
            if load.times is None or load.factors is None:
                continue
            time, factor = np.array(load.times), np.array(load.factors)
            steps = 0.5 * np.diff(time) * (factor[1:] + factor[:-1])
            before = factor[0] * time[0]
            integral = np.cumsum(np.concatenate([[before], steps]))
            tables[:, first : last + 1] = time, factor, integral
            first = last + 1
        self.numbers.from_numpy(numbers)
        for field, values in zip((self.times, self.factors, self.integrals), tables, strict=True):
            field.from_numpy(values)

    @ti.func
    def at(self, n, time):
        """Factor of load n at a time (s), and its integral from the start on (s)."""
        since = time - self.numbers[n, BEGIN]
        factor, integral = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        if since >= 0:
            course, duration = int(self.numbers[n, COURSE]), self.numbers[n, DURATION]
            within = ti.min(since, duration)
            if course == CONSTANT:
                factor, integral = 1.0, within
            elif course == RAMP:
                factor, integral = self.ramp(within, self.numbers[n, RISE])
            elif course == HALF_SINE:
                factor, integral = self.half_sine(within, duration)
            else:
                factor, integral = self.tabled(n, within)
            if since > duration:
                factor = 0.0
        return factor, integral

    @ti.func
    def ramp(self, time, rise):
        """The smooth ramp: 3 t^2 - 2 t^3, then 1."""
        share = ti.min(time / rise, 1.0)
        factor = share * share * (3.0 - 2.0 * share)
        return factor, rise * share**3 * (1.0 - 0.5 * share) + ti.max(time - rise, 0.0)

    @ti.func
    def half_sine(self, time, duration):
        """Half a sine: the cosine from -90 to 90 degrees."""
        angle = ti.static(math.pi) * (time / duration - 0.5)
        square = angle * angle
        sine, cosine = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        for term in ti.static(range(TERMS - 1, -1, -1)):
            sign = ti.static((-1.0) ** term)
            cosine = cosine * square + ti.static(sign / math.factorial(2 * term))
            sine = sine * square + ti.static(sign / math.factorial(2 * term + 1))
        return cosine, ti.static(1 / math.pi) * duration * (1.0 + angle * sine)

    @ti.func
    def tabled(self, n, time):
        """Straight lines between the points; the first factor before them, the last one after."""
        low, high = int(self.numbers[n, FIRST]), int(self.numbers[n, LAST])
        factor, integral = self.factors[low], self.factors[low] * time
        if time >= self.times[high]:
            factor = self.factors[high]
            integral = self.integrals[high] + factor * (time - self.times[high])
        elif time > self.times[low]:
            while high - low > 1:
                middle = (low + high) // 2
                if self.times[middle] <= time:
                    low = middle
                else:
                    high = middle
            since, span = time - self.times[low], self.times[high] - self.times[low]
            begin = self.factors[low]
            factor = begin + (self.factors[high] - begin) * (since / span)
            integral = self.integrals[low] + 0.5 * since * (begin + factor)
        return factor, integral
