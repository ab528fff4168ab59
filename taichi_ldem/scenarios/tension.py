"""The tension test: its numbers (Section 3.2 of the paper)."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from taichi_ldem.scenarios import runner
from taichi_ldem.scene import Scene

if TYPE_CHECKING:
    from taichi_ldem.simulation import Simulation

ELASTIC_STRAIN = 0.0025
"""Gauge strain up to which elastic constants are fitted: where ISO 527-1 ends its modulus."""

Array = npt.NDArray[np.float64]


def run(
    scene: Scene,
    out: Path,
    *,
    force: bool = False,
    quiet: bool = False,
    prepare: "Callable[[Simulation], None] | None" = None,
) -> int:
    """Run a tension test into a folder; arguments, exit codes and errors are ``runner.run``'s."""
    return runner.run(scene, out, summary, force=force, quiet=quiet, prepare=prepare)


class Curve(NamedTuple):
    """Stress over strain; a row lies in the middle between two samples, as its force does.

    Attributes:
        time: s. strain, lateral: of the gauge. force: mean pull of the grips, N.
    """

    time: Array
    strain: Array
    lateral: Array
    force: Array


def curve(history: dict[str, Array]) -> Curve:
    """The curve from the columns of a history (n rows give n - 1)."""

    def middle(name: str) -> Array:
        return 0.5 * (history[name][1:] + history[name][:-1])

    return Curve(
        middle("time_s"),
        middle("gauge_strain"),
        middle("gauge_lateral_strain"),
        history["grip_force_n"][1:],
    )


def initial_slope(x: Array, y: Array) -> float:
    """Slope at the origin of the parabola through it that fits y over x best (nan: no data).

    The bars' finite rotations bend the curve by about as much as half of the largest strain, so a
    straight line would measure its own length.
    """
    if len(x) < 5:
        return math.nan
    (slope, _), *_ = np.linalg.lstsq(np.stack([x, x**2], axis=1), y, rcond=None)
    return float(slope)


def summary(simulation: "Simulation", history: runner.History) -> dict[str, Any]:
    """Elastic constants, strength, strain at the peak, dissipated energy, rates; SI units.

    Stress is nominal: pull over the net section at rest, the mean section in the gauge length.
    Young's modulus and Poisson's ratio are initial slopes, of stress and of minus the lateral over
    the axial strain, from strains up to ``ELASTIC_STRAIN``. Strength is the largest stress, null
    where no bar has failed; dissipated energy that of all bars over the net section.
    """
    assert simulation.gauge is not None
    gauge, last = simulation.gauge, history[-1]
    names = ("time_s", "gauge_strain", "gauge_lateral_strain", "grip_force_n")
    c = curve({name: np.array([r[name] for r in history], dtype=float) for name in names})
    stress = c.force / gauge.section
    peak = int(np.argmax(stress))
    within = np.arange(len(stress)) <= peak
    within &= (c.strain > 0) & (c.strain <= ELASTIC_STRAIN)
    stress_rate, strain_rate = _rates(c.time, stress, c.strain, peak)
    broken = bool(last["broken_bars"])
    at_peak = history[peak]
    return {
        "youngs_modulus": initial_slope(c.strain[within], stress[within]),
        "poisson_ratio": initial_slope(c.strain[within], -c.lateral[within]),
        "strength": float(stress[peak]) if broken else None,
        "strain_at_peak": float(c.strain[peak]) if broken else None,
        "peak_force_n": float(c.force[peak]),
        "peak_time_s": float(c.time[peak]),
        "fracture_energy_dissipated": last["fracture_j"] / gauge.section,
        "work_of_grips_over_section": last["external_j"] / gauge.section,
        "kinetic_over_strain_energy_at_peak": at_peak["kinetic_plate_j"] / at_peak["strain_j"]
        if at_peak["strain_j"]
        else None,
        "loading_rate_pa_s": stress_rate,
        "strain_rate_1_s": strain_rate,
        "net_section_m2": gauge.section,
        "gauge_length_m": gauge.length,
    }


def _rates(time: Array, stress: Array, strain: Array, peak: int) -> tuple[float, float]:
    """Mean rates of stress and strain between a tenth and half of the largest stress before it."""
    rising = np.arange(peak + 1)
    rising = rising[(stress[rising] >= 0.1 * stress[peak]) & (stress[rising] <= 0.5 * stress[peak])]
    if len(rising) < 2:
        return math.nan, math.nan
    first, last = rising[0], rising[-1]
    span = time[last] - time[first]
    return (
        float((stress[last] - stress[first]) / span),
        float((strain[last] - strain[first]) / span),
    )
