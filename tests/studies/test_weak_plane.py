"""A specimen with one weak plane: the energy that its flat crack costs."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import PMMA, block_scene
from support.specimens import pull

from studies.tension import EDGE, WEAK_SHARE, WEAK_STRAIN, weaken

if TYPE_CHECKING:
    pass

ENDS = {"length": 0.55 * EDGE, "ramp": 5e-5, "lateral": "free"}  # the last nodes of both kinds


G_F = 1034.0


def _crack(length: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    from taichi_ldem.solver.simulation import Simulation

    scene = block_scene(
        length,
        6,
        6,
        spacing=EDGE,
        scenario="tension",
        material={"damage": True, "fracture_energy": G_F, "failure_strain": WEAK_STRAIN},
        grips=ENDS | {"velocity": 0.2},
        solver={"duration": 1e-3 + 1e-5 * length, "safety": 0.9},
        output={"history_interval": 1e-6},
    )
    simulation = Simulation(scene)
    weaken(simulation)
    numbers, history = pull(simulation)
    columns = {name: np.array([r[name] for r in history], dtype=float) for name in history[0]}
    area = numbers["net_section_m2"]
    assert area == pytest.approx(36 * EDGE**2, rel=1e-9)
    # in units of what the plane has left, which is counted without the program's ledger
    for name in ("fracture_j", "external_j", "kinetic_plate_j", "strain_j"):
        columns[name] = (columns[name] - columns[name][0]) / (WEAK_SHARE * G_F * area)
    return numbers, columns


@pytest.mark.slow
def test_a_short_specimen_spends_g_f_on_a_flat_crack(taichi: None) -> None:
    """3.2 mm long, a quarter of E G_f / (E eps_p)^2 = 12.3 mm: the crack has to be driven."""
    _, columns = _crack(6)
    assert columns["fracture_j"][-1] == pytest.approx(1.0, rel=0.02)
    assert columns["external_j"][-1] == pytest.approx(1.0, rel=0.02)
    assert columns["kinetic_plate_j"].max() < 0.02
    assert columns["energy_error_of_plate"].max() < 1e-3


@pytest.mark.slow
def test_a_long_specimen_snaps_back(taichi: None) -> None:
    """51.2 mm, four characteristic lengths: it stores more than the crack takes."""
    numbers, columns = _crack(96)
    assert columns["fracture_j"][-1] == pytest.approx(1.0, rel=0.02)
    freed = (columns["kinetic_plate_j"] + columns["strain_j"])[-1]
    assert columns["external_j"][-1] == pytest.approx(columns["fracture_j"][-1] + freed, rel=1e-3)
    # what the bulk alone had stored at the peak is beyond what the crack takes
    stored = numbers["strength"] ** 2 / (2 * PMMA["youngs_modulus"]) * 96 * EDGE
    assert 1.2 < stored / (WEAK_SHARE * G_F) < columns["external_j"][-1]
