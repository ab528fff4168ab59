"""Cracks of a run, measured from its folder."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from taichi_ldem.analysis.cracks import Cracks, measure
from taichi_ldem.analysis.signals import damage_onset, energy_failure
from taichi_ldem.analysis.window import smoothing_window
from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact.striker import STRIKERS
from taichi_ldem.storage.fields import read_broken_bars
from taichi_ldem.storage.folder import RunFolder

Array = npt.NDArray[np.float64]


def measure_run(folder: RunFolder, radial_time: float | None = None) -> Cracks | None:
    """Measure the cracks of a run; None for a scene without damage or without a broken bar.

    Args:
        radial_time: at which radial cracks are counted, s; None: t2, or the end without failure.

    Raises:
        SceneError: a file of the run cannot be read.
    """
    scene = folder.read_scene()
    if not scene.material.damage or not folder.fields_file.exists():
        return None
    bars = read_broken_bars(folder.fields_file)
    if not len(bars.bar):
        return None
    history = folder.read_history()
    position = scene.striker.position if scene.striker else (0.0, 0.0)
    window = smoothing_window(scene)
    if radial_time is None:
        radial_time = failure_by_energy(scene, history)
    return measure(bars, scene.plate, position, radial_time, history["time_s"], window)


def failure_by_energy(scene: Scene, history: Mapping[str, Array]) -> float | None:
    """Failure time t2 from the strain energy, s (see ``analysis.signals``), or None.

    What the plate gives back is the energy of all strikers that move away from it, and the work
    that it does on loads and the like.

    Args:
        history: (n,) values by column.
    """
    material, time = scene.material, history["time_s"]
    if not material.damage or material.fracture_energy is None:
        return None
    height = scene.plate.size[2]
    onset = damage_onset(time, history["fracture_j"], material.fracture_energy, height)
    given_back = -np.asarray(history.get("external_j", np.zeros(len(time))))
    for striker in STRIKERS[: len(scene.strikers)]:
        away = history[f"{striker.name}_velocity_m_s"] < 0
        given_back = given_back + np.where(away, history[f"kinetic_{striker.name}_j"], 0.0)
    return energy_failure(time, history["strain_j"], onset, given_back)
