"""Tension tests that have a known answer: elastic constants, and what one flat crack costs."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from blocks import PMMA, block_scene
from test_elasticity import tension_of_a_prism

from taichi_ldem import material as mat
from taichi_ldem.scenarios.runner import row
from taichi_ldem.scenarios.tension import summary
from taichi_ldem.studies.tension import EDGE, WEAK_SHARE, WEAK_STRAIN, weaken

if TYPE_CHECKING:
    from taichi_ldem.simulation import Simulation

ENDS = {"length": 0.55 * EDGE, "ramp": 5e-5, "lateral": "free"}  # the last nodes of both kinds
G_F = 1034.0


def _pull(simulation: "Simulation") -> tuple[dict[str, Any], list[dict[str, Any]]]:
    history = [
        row(s) | {"energy_error_of_plate": s.energy_error_of_plate} for s in simulation.samples()
    ]
    return summary(simulation, history), history


def _elastic(width: int, height: int, weights: bool) -> dict[str, Any]:
    from taichi_ldem.simulation import Simulation

    length = max(24, width + height)
    slower = length / 24  # the longer, the more time waves need
    scene = block_scene(
        length,
        width,
        height,
        spacing=EDGE,
        scenario="tension",
        plate={"surface_weights": weights},
        grips=ENDS | {"velocity": 0.512, "ramp": 1e-4 * slower},
        solver={"duration": 3e-4 * slower, "safety": 0.9},
        output={"history_interval": 1e-6},
    )
    numbers, history = _pull(Simulation(scene))
    assert history[-1]["energy_error"] < 1e-8
    return numbers


def _static(width: int, height: int, weights: bool) -> tuple[float, float]:
    stiffness = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], 1.0)
    return tension_of_a_prism(width, stiffness, height, weights)


@pytest.mark.parametrize("weights", [True, False], ids=["weighted", "full"])
def test_a_pulled_prism_has_the_modulus_of_the_static_solution(taichi: None, weights: bool) -> None:
    numbers = _elastic(6, 6, weights)
    modulus, _ = _static(6, 6, weights)
    assert numbers["youngs_modulus"] == pytest.approx(modulus, rel=2e-3)
    # a sixth of the modules has no neighbour: what that costs is the static solution's
    assert modulus / PMMA["youngs_modulus"] - 1 == pytest.approx(
        -0.015 if weights else 0.137, abs=0.003
    )


@pytest.mark.slow
def test_a_wide_prism_has_the_input_s_elastic_constants(taichi: None) -> None:
    numbers = _elastic(24, 24, True)
    assert numbers["youngs_modulus"] == pytest.approx(PMMA["youngs_modulus"], rel=5e-3)
    assert numbers["poisson_ratio"] == pytest.approx(PMMA["poisson_ratio"], rel=0.02)


def _crack(length: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    from taichi_ldem.simulation import Simulation

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
    numbers, history = _pull(simulation)
    columns = {name: np.array([r[name] for r in history], dtype=float) for name in history[0]}
    area = numbers["net_section_m2"]
    assert area == pytest.approx(36 * EDGE**2, rel=1e-9)
    # in units of what the plane has left, which is counted without the program's ledger
    for name in ("fracture_j", "external_j", "kinetic_plate_j", "strain_j"):
        columns[name] = (columns[name] - columns[name][0]) / (WEAK_SHARE * G_F * area)
    return numbers, columns


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
