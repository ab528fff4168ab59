"""A plate under loads: its numbers."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.analysis import signals
from taichi_ldem.scenarios.runner import History
from taichi_ldem.scene import Load
from taichi_ldem.storage.fields import read_broken_bars
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

ROUNDING = 1e-9
"""Relative difference of two forces that counts as none."""


def summary(simulation: "Simulation", history: History, folder: RunFolder) -> dict[str, Any]:
    """Peaks of the loads, onset of damage, energies and extent of the cracks; SI units.

    A peak is the first sample with the largest size of the force, with its sign. The cracked area
    is the fracture energy that was dissipated over G_f. The crack reaches from the least to the
    largest coordinates of the broken bars' mid-points at rest.
    """
    scene, last = simulation.scene, history[-1]
    onset, area = None, None
    if scene.material.damage and scene.material.fracture_energy is not None:
        time_s = np.array([row["time_s"] for row in history])
        fracture = np.array([row["fracture_j"] for row in history], dtype=float)
        energy = scene.material.fracture_energy
        onset = signals.damage_onset(time_s, fracture, energy, scene.plate.size[2])
        area = last["fracture_j"] / energy
    numbers: dict[str, Any] = {}
    for load in scene.loads:
        numbers |= _peak(load, history)
    return numbers | {
        "damage_onset_time_s": onset,
        "cracked_area_m2": area,
        **_extent(simulation, folder),
        "external_end_j": last["external_j"],
        "strain_end_j": last["strain_j"],
        "kinetic_end_j": last["kinetic_plate_j"],
    }


def _peak(load: Load, history: History) -> dict[str, float]:
    """The largest force of a load, its time, and how far its nodes had moved then."""
    force, way = load.columns
    largest = max(abs(row[force]) for row in history)
    # the first of samples that differ by rounding alone, as under a constant load
    at = next(row for row in history if abs(row[force]) >= (1 - ROUNDING) * largest)
    return {
        f"{load.name}_peak_force_n": at[force],
        f"{load.name}_peak_time_s": at["time_s"],
        f"{load.name}_peak_displacement_m": at[way],
    }


def _extent(simulation: "Simulation", folder: RunFolder) -> dict[str, Any]:
    """The box around the broken bars; None where none has failed."""
    place = np.empty((0, 3))
    if simulation.scene.material.damage and folder.fields_file.exists():
        place = read_broken_bars(folder.fields_file).position_m
    ends = {"from": place.min(axis=0), "to": place.max(axis=0)} if len(place) else {}
    return {
        f"crack_{end}_{axis}_m": float(ends[end][n]) if ends else None
        for n, axis in enumerate("xyz")
        for end in ("from", "to")
    }
