"""The falling-weight test: its numbers (Sections 3.1 and 5.2 of the paper)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.analysis import signals
from taichi_ldem.analysis.window import smoothing_window
from taichi_ldem.scenarios.runner import History
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


def summary(simulation: "Simulation", history: History, folder: RunFolder) -> dict[str, Any]:
    """Onset, peaks, failure and cracks of a finished run, SI units.

    The definitions are those of ``analysis.signals`` and ``analysis.cracks``.
    """
    from taichi_ldem.scenarios.measure import failure_by_energy

    scene, last = simulation.scene, history[-1]
    columns = {name: _column(history, name) for name in last if last[name] is not None}
    time_s, window = _column(history, "time_s"), smoothing_window(scene)
    onset, peaks, load, failure = None, signals.ForcePeaks(), signals.Puncture(), None
    if scene.material.damage and scene.material.fracture_energy is not None:
        fracture = _column(history, "fracture_j")
        height = scene.plate.size[2]
        onset = signals.damage_onset(time_s, fracture, scene.material.fracture_energy, height)
        if scene.striker is not None:
            force = _column(history, "striker_force_n")
            peaks = signals.force_peaks(time_s, force, onset, window)
            velocity = _column(history, "striker_velocity_m_s")
            failure = signals.velocity_failure(time_s, velocity, onset, window)
    if scene.striker is not None:
        displacement = _column(history, "striker_displacement_m")
        load = signals.puncture(time_s, _column(history, "striker_force_n"), displacement, window)
    return {
        "damage_onset_time_s": onset,
        "first_peak_force_n": peaks.first_force,
        "first_peak_time_s": peaks.first_time,
        "second_peak_force_n": peaks.second_force,
        "second_peak_time_s": peaks.second_time,
        "failure_time_s": peaks.failure_time,
        "failure_time_velocity_s": failure,
        "failure_time_energy_s": failure_by_energy(scene, columns),
        "smoothing_window_s": window,
        "peak_load_n": load.peak_load,
        "peak_load_time_s": load.peak_time,
        "deflection_at_peak_load_m": load.peak_deflection,
        "energy_at_peak_load_j": load.peak_energy,
        "total_energy_j": load.total_energy,
        "striker_velocity_end_m_s": last["striker_velocity_m_s"],
        "contact_striker_j": simulation.contact_loss("striker"),
        "contact_rings_j": simulation.contact_loss("rings"),
        **_further_bodies(simulation, last),
        **_measured(folder),
    }


def _further_bodies(simulation: "Simulation", last: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of what only some scenes have: more strikers, supports, faces that meet."""
    found = {}
    for number in range(2, len(simulation.scene.strikers) + 1):
        name = f"striker{number}"
        found[f"{name}_velocity_end_m_s"] = last[f"{name}_velocity_m_s"]
        found[f"contact_{name}_j"] = simulation.contact_loss(name)
    if simulation.scene.supports is not None:
        found["contact_supports_j"] = simulation.contact_loss("supports")
    if simulation.dynamics.features.meeting:
        sums = simulation.energies
        found["contact_faces_j"] = sums.lost_at_faces(sums.total())
    return found


def _measured(folder: RunFolder) -> dict[str, Any]:
    """The numbers of the cracks; a run without cracks has the same keys."""
    from taichi_ldem.analysis.cracks import NO_CRACKS
    from taichi_ldem.scenarios.measure import measure_run

    cracks = measure_run(folder)
    return NO_CRACKS if cracks is None else cracks.summary()


def _column(history: History, name: str) -> npt.NDArray[np.float64]:
    return np.array([row[name] for row in history], dtype=float)
