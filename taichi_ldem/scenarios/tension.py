"""The tension test: its numbers (Section 3.2 of the paper)."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.analysis.stress_strain import (
    curve,
    elastic_rows,
    initial_slope,
    mean_rate,
    rows_until_parted,
)
from taichi_ldem.scenarios.runner import History
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


def summary(simulation: "Simulation", history: History, folder: RunFolder) -> dict[str, Any]:
    """Elastic constants, strength, strain at the peak, dissipated energy, rates; SI units.

    Stress is nominal: pull over the net section at rest, the mean section in the gauge length.
    Young's modulus and Poisson's ratio are initial slopes, of stress and of minus the lateral over
    the axial strain, over ``elastic_rows``; null where the specimen vibrates too much for a fit.
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
        "loading_rate_pa_s": mean_rate(c.time[within], stress[within]),
        "strain_rate_1_s": mean_rate(c.time[within], c.strain[within]),
        "net_section_m2": gauge.section,
        "gauge_length_m": gauge.length,
    }
