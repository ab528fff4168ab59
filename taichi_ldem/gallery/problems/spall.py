"""Spalling: a pulse of pressure comes back from the free end of a bar as tension and breaks it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, near
from taichi_ldem.gallery.readings import Advance, Array, advance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

LABELS = {"bar": "paper's method", "crack": "cracks cost G_f"}


def theory(run: LoadedRun) -> tuple[float, float]:
    """Distance of the first crack from the free end (m), and its time (s), in one dimension.

    At a distance x from the free end, incident pulse and reflection add up to the tension

        sigma(x, t) = p(t - x / c) - p(t + x / c),

    where p(t) is the pressure that arrives at the end at t. Behind its peak, a pulse that falls
    linearly from p_0 within T leaves 2 p_0 x / (c T): the strength is reached first at the distance
    c T sigma / (2 p_0) and half the time of the rise later than the peak passes there. Here the
    first place is sought on a grid.
    """
    scene, load = run.scene, run.scene.loads[0]
    material = scene.material
    speed = math.sqrt(material.youngs_modulus / material.density)
    assert load.velocity is not None
    assert load.times is not None
    assert load.factors is not None
    assert load.box is not None
    assert material.failure_strain is not None
    strength = material.youngs_modulus * material.failure_strain
    pressure = material.density * speed * load.velocity
    place = np.linspace(0.0, speed * load.times[-1] / 2, 2001)
    late = (scene.plate.actual_size[0] / 2 - load.box[1][0]) / speed

    times, factors = np.array(load.times), np.array(load.factors)

    def tension(time: float) -> Array:
        back, out = (
            np.interp(t, times, factors) for t in (time - place / speed, time + place / speed)
        )
        return np.asarray(pressure * (back - out))

    for time in np.linspace(0.0, 2 * load.times[-1], 4001):
        reached = np.flatnonzero(tension(float(time)) >= strength)
        if len(reached):
            return float(np.median(place[reached])), late + float(time)
    return math.nan, math.nan


def _crack(run: LoadedRun) -> Advance:
    """The broken bars, along the bar from its free end inwards."""
    end = run.scene.plate.actual_size[0] / 2
    return advance(run, tip=(end, 0.0), direction=(-1.0, 0.0))


def _first(run: LoadedRun) -> tuple[float | None, float | None]:
    """Place (m) and time (s) of the first crack, from as many bars as a section has."""
    crack = _crack(run)
    _, ny, nz = run.scene.plate.modules
    section = 2 * ny * nz
    if len(crack.time) < section:
        return None, None
    return float(np.median(crack.along[:section])), float(crack.time[0])


def _judge(runs: Runs) -> list[Finding]:
    found = []
    for name, run in runs.items():
        place, time = theory(run)
        measured, begun = _first(run)
        label = LABELS[name]
        from_end = None if measured is None else 1e3 * measured
        at = None if begun is None else 1e6 * begun
        found.append(
            near("distance from the free end", "mm", from_end, 1e3 * place, 0.15, run=label)
        )
        found.append(near("time of the crack", "us", at, 1e6 * time, 0.05, run=label))
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    axes = figure.subplots()
    for name, run in runs.items():
        crack = _crack(run)
        axes.plot(1e6 * crack.time, 1e3 * crack.along, ".", markersize=4, label=LABELS[name])
    place, time = theory(next(iter(runs.values())))
    axes.plot([1e6 * time], [1e3 * place], "k+", markersize=14, label="one-dimensional theory")
    axes.set(xlabel="time [us]", ylabel="distance from the free end [mm]")
    figure.legend(loc="outside lower center", ncols=3, fontsize=12)


PROBLEM = Problem(
    title="Spalling of a bar",
    about=(
        "A pressure of half a sine, 60 us long and twice the strength high, acts on one end of a "
        "bar of 150 x 4 x 4 mm. Its reflection at the free end is tension."
    ),
    source=(
        "waves in one dimension (Kolsky, Stress Waves in Solids, 1953): place and time at which "
        "incident and reflected pulse first add up to the strength. The intervals allow one module "
        "and the time that softening takes."
    ),
    runs=(
        Run("bar", "spall.toml"),
        Run("crack", "spall.toml", ('material.fracture="crack"',), quick=None),
    ),
    judge=_judge,
    draw=_draw,
)
