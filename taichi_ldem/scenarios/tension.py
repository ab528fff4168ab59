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
    from taichi_ldem.solver.simulation import Simulation

SCATTER = 0.005
"""Standard deviation from a fit, over the largest value, up to which its slope is a constant."""

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


def rows_until_parted(force: Array) -> int:
    """Number of rows until the pull, having been noticeable, first falls below zero.

    From then on the grips feel the parted ends ringing, at times by more than their strength.
    """
    loaded = np.maximum.accumulate(force) > 0.1 * force.max()
    parted = np.flatnonzero(loaded & (force < 0))
    return int(parted[0]) if len(parted) else len(force)


def initial_slope(x: Array, y: Array) -> float:
    """Slope at x = 0 of the parabola that fits y over x best; nan where none fits.

    None does with less than five points, with points from the farther half of the range alone, or
    where waves leave more than ``SCATTER``. The bars' finite strains and rotations bend the curve,
    so that the slope of a straight line would depend on where it ends.
    """
    if len(x) < 5 or np.abs(x).min() > 0.5 * np.abs(x).max():
        return math.nan
    fit = np.polyfit(x, y, 2)
    scatter = float(np.std(y - np.polyval(fit, x)) / np.abs(y).max())
    return float(fit[1]) if scatter <= SCATTER else math.nan


def elastic_rows(c: Curve, ramp: float, first_broken: int | None) -> npt.NDArray[np.bool_]:
    """Rows to fit: from the end of the ramp to half of the strain at the largest force.

    Before, the grips also accelerate the specimen. A largest force after the first bar has broken
    (the parts may ring) is no measure of what is elastic: that bar's row counts then.
    """
    peak = int(np.argmax(c.force[: rows_until_parted(c.force)]))
    if first_broken is not None:
        peak = min(peak, first_broken)
    before = (np.arange(len(c.time)) <= peak) & (c.time >= ramp)
    return np.asarray(before & (c.strain <= 0.5 * c.strain[peak]))


def summary(simulation: "Simulation", history: runner.History) -> dict[str, Any]:
    """Elastic constants, strength, strain at the peak, dissipated energy, rates; SI units.

    Stress is nominal: pull over the net section at rest, the mean section in the gauge length.
    Young's modulus and Poisson's ratio are initial slopes, of stress and of minus the lateral over
    the axial strain, over ``elastic_rows``; null where the specimen rings too much to tell.
    Strength is the largest stress until the specimen parts, null where no bar has failed.
    Dissipated energy is that of all bars over the net section.
    """
    grips, last = simulation.body("grips"), history[-1]
    gauge = grips.gauge
    names = ("time_s", "gauge_strain", "gauge_lateral_strain", "grip_force_n")
    c = curve({name: np.array([r[name] for r in history], dtype=float) for name in names})
    stress = c.force / gauge.section
    whole = rows_until_parted(c.force)
    peak = int(np.argmax(stress[:whole]))
    broken = np.array([r["broken_bars"] or 0 for r in history[1:]]) > 0
    first = int(np.argmax(broken))
    within = elastic_rows(c, grips.table.ramp, first if broken.any() else None)
    at_peak = history[peak]
    return {
        "youngs_modulus": initial_slope(c.strain[within], stress[within]),
        "poisson_ratio": initial_slope(c.strain[within], -c.lateral[within]),
        "strength": float(stress[peak]) if broken.any() else None,
        "strain_at_peak": float(c.strain[peak]) if broken.any() else None,
        "stress_at_first_broken_bar": float(stress[first]) if broken.any() else None,
        "peak_force_n": float(c.force[peak]),
        "peak_time_s": float(c.time[peak]),
        "fracture_energy_dissipated": last["fracture_j"] / gauge.section,
        "work_of_grips_until_parted": history[whole]["external_j"] / gauge.section,
        "kinetic_over_strain_energy_at_peak": at_peak["kinetic_plate_j"] / at_peak["strain_j"]
        if at_peak["strain_j"]
        else None,
        "loading_rate_pa_s": _rate(c.time[within], stress[within]),
        "strain_rate_1_s": _rate(c.time[within], c.strain[within]),
        "net_section_m2": gauge.section,
        "gauge_length_m": gauge.length,
    }


def _rate(time: Array, values: Array) -> float:
    """Mean rate of change, 1/s of the values' unit (nan with less than two)."""
    return float((values[-1] - values[0]) / (time[-1] - time[0])) if len(time) > 1 else math.nan
