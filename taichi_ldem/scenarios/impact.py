"""The falling-weight test: its numbers (Sections 3.1 and 5.2 of the paper)."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem import signals
from taichi_ldem.scenarios import runner
from taichi_ldem.scene import Scene

if TYPE_CHECKING:
    from taichi_ldem.simulation import Simulation


def run(scene: Scene, out: Path, *, force: bool = False, quiet: bool = False) -> int:
    """Run a falling-weight test into a folder; exit codes and errors are ``runner.run``'s."""
    return runner.run(scene, out, summary, force=force, quiet=quiet)


def summary(simulation: "Simulation", history: runner.History) -> dict[str, Any]:
    """Onset, peaks, failure and velocity of a finished run (definitions: ``signals``)."""
    scene, last = simulation.scene, history[-1]
    time_s = np.array([r["time_s"] for r in history])
    onset, peaks = None, signals.ForcePeaks()
    if scene.material.damage and scene.material.fracture_energy is not None:
        fracture = np.array([r["fracture_j"] for r in history])
        height = scene.plate.size[2]
        onset = signals.damage_onset(time_s, fracture, scene.material.fracture_energy, height)
        if scene.striker is not None:
            force = np.array([r["striker_force_n"] for r in history], dtype=float)
            peaks = signals.force_peaks(time_s, force, onset)
    return {
        "damage_onset_time_s": onset,
        "first_peak_force_n": peaks.first_force,
        "first_peak_time_s": peaks.first_time,
        "second_peak_force_n": peaks.second_force,
        "second_peak_time_s": peaks.second_time,
        "failure_time_s": peaks.failure_time,
        "striker_velocity_end_m_s": last["striker_velocity_m_s"],
        "contact_striker_j": simulation.contact_loss(simulation.striker),
        "contact_rings_j": simulation.contact_loss(simulation.rings),
    }
