"""Notched three-point bending after ISO 17281 (Fig. 7 of the paper): the numbers of a specimen.

Energies are taken at the *peak*: the first maximum of the specimen's strain energy, from damage
onset on, after which it falls by a twentieth. That is when the crack runs. The striker's force
oscillates with the specimen between striker and supports, so its largest value says little, while
the strain energy is what drives the crack. Up to the peak

    work of the striker = strain + fracture + kinetic energy of the specimen + losses in contact

by the energy ledger. The energy that the specimen has absorbed, U, is the sum of the first two. No
estimate is needed to separate them from the others: the ledger has each at every sample.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.analysis import signals
from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scenarios.runner import History
from taichi_ldem.scene import Notch, Scene
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

FALL = 0.05
"""Share of the strain energy that is lost when the crack runs."""


def notch_depth(notch: Notch, lattice: Lattice) -> float:
    """Depth of a notch that is open below: half-way between its last bar and the next one, m.

    Rows of bars along the beam's axis are half a module apart, so ``notch.to`` may be anything
    between two. The compliance of the notched lattice puts the crack's tip half-way if the plane
    goes through corner nodes and the last row is one of centre nodes, that is for a depth of three
    quarters of a module more than whole modules. Otherwise the tip is deeper by up to 0.2 L
    (docs/bending.md).
    """
    row = 0.5 * lattice.spacing
    return row * (math.floor(notch.bounds[1][1] / row + 1e-6) + 0.5)


def ligament_area(scene: Scene, notch: Notch, lattice: Lattice) -> float:
    """Fracture area of the bars that cross a notch's plane and were not removed, m2.

    A flat crack through the rest of the section dissipates G_f times this area.
    """
    everywhere = (-math.inf, -math.inf), (math.inf, math.inf)
    crossing = lattice.bars_crossing(notch.axes[0], notch.place, *everywhere)
    (a, b), (c, d) = notch.bounds
    removed = lattice.bars_crossing(notch.axes[0], notch.place, (a, c), (b, d))
    weights, cell = lattice.bar_shares(), lattice.cell
    bars = mat.bars_of(scene)
    left = crossing & ~removed
    return sum(
        bars[cell.family[bar]].fracture_area
        * float(weights[..., bar][(left >> bar & 1) == 1].sum())
        for bar in range(cell.bars)
    )


def beside_plane(notch: Notch, lattice: Lattice) -> npt.NDArray[np.bool_]:
    """(bars, *S) bars that a flat crack in the notch's plane would not break.

    Their midpoints are more than half a module away from the plane: a crack along either side of
    the plane's nodes breaks bars whose midpoints are nearer.
    """
    axis = notch.axes[0]
    place = lattice.positions()[..., axis]
    middles = [
        place[first] + 0.5 * lattice.spacing * vector[axis]
        for ((first, _), _), vector in zip(lattice.cell.ends, lattice.cell.vectors, strict=True)
    ]
    return np.asarray(np.abs(np.stack(middles) - notch.place) > 0.51 * lattice.spacing)


def peak_index(history: History, onset: float | None) -> int:
    """Row of the peak (see the module); the row of the largest strain energy without one.

    Args:
        onset: time of damage onset, s; None for an elastic run.
    """
    strain = np.array([r["strain_j"] for r in history])
    if onset is not None:
        start = int(np.searchsorted([r["time_s"] for r in history], onset))
        highest = np.maximum.accumulate(strain[start:])
        fallen = np.flatnonzero(strain[start:] < (1 - FALL) * highest)
        if len(fallen):
            return start + int(np.argmax(strain[start : start + fallen[0]]))
    return int(np.argmax(strain))


def summary(simulation: "Simulation", history: History, folder: RunFolder) -> dict[str, Any]:
    """Notch, energies at the peak (see the module) and fracture of a finished run."""
    scene = simulation.scene
    lattice = simulation.dynamics.lattice
    notches = [notch for notch in scene.notch if notch.normal == "x"]
    _, width, height = scene.plate.actual_size
    depth, area = 0.0, width * height
    beside: tuple[float | None, int | None] = (None, None)
    if notches:
        beside = simulation.fracture_of(beside_plane(notches[0], lattice))
        depth = notch_depth(notches[0], lattice)
        area = ligament_area(scene, notches[0], lattice)
    first, last = history[0], history[-1]
    onset = None
    if scene.material.damage and scene.material.fracture_energy is not None:
        time_s, fracture = (np.array([r[key] for r in history]) for key in ("time_s", "fracture_j"))
        energy = scene.material.fracture_energy
        onset = signals.damage_onset(time_s, fracture, energy, math.sqrt(area))
    peak = history[peak_index(history, onset)]
    work = first["kinetic_striker_j"] - peak["kinetic_striker_j"] + peak["external_j"]
    return {
        "notch_depth_m": depth,
        "ligament_area_m2": area,
        "damage_onset_time_s": onset,
        "largest_force_n": max(r["striker_force_n"] for r in history),
        "peak_time_s": peak["time_s"],
        "peak_displacement_m": peak["striker_displacement_m"],
        "peak_work_j": work,
        "peak_strain_j": peak["strain_j"],
        "peak_fracture_j": peak["fracture_j"],
        "peak_kinetic_j": peak["kinetic_plate_j"],
        "peak_contact_j": peak["contact_j"],
        "absorbed_j": peak["strain_j"] + peak["fracture_j"],
        "broken_bars_at_peak": peak["broken_bars"],
        "fracture_per_ligament_j_m2": last["fracture_j"] / area,
        "fracture_beside_plane_j": beside[0],
        "broken_bars_beside_plane": beside[1],
        "strain_end_j": last["strain_j"],
        "kinetic_end_j": last["kinetic_plate_j"],
        "striker_velocity_end_m_s": last["striker_velocity_m_s"],
        "contact_striker_j": simulation.contact_loss("striker"),
        "contact_supports_j": simulation.contact_loss("supports"),
    }
