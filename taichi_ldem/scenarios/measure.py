"""Cracks of a run, measured from its folder."""

from __future__ import annotations

from taichi_ldem.analysis.cracks import Cracks, measure
from taichi_ldem.analysis.signals import energy_failure
from taichi_ldem.analysis.window import smoothing_window
from taichi_ldem.storage.fields import read_broken_bars
from taichi_ldem.storage.folder import RunFolder


def measure_run(folder: RunFolder) -> Cracks | None:
    """Measure the cracks of a run; None for a scene without damage or without a broken bar.

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
    time, strain = history["time_s"], history["strain_j"]
    position = scene.striker.position if scene.striker else (0.0, 0.0)
    failure, window = energy_failure(time, strain), smoothing_window(scene)
    return measure(bars, scene.plate, position, failure, time, window)
