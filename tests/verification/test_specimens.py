"""Tension tests that have a known answer: elastic constants, and what one flat crack costs."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import PMMA, block_scene
from support.prism import tension_of_a_prism
from support.specimens import NO_FOLDER, pull

from taichi_ldem.model import material as mat
from taichi_ldem.scenarios.runner import row
from taichi_ldem.scenarios.tension import initial_slope, summary

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

EDGE = 3.2e-3 / 6  # the module of the paper's plate, m
ENDS = {"length": 0.55 * EDGE, "ramp": 5e-5, "lateral": "free"}  # the last nodes of both kinds
G_F = 1034.0


def _elastic_prism(width: int, height: int, weights: bool) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

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
    return Simulation(scene)


def _static(width: int, height: int, weights: bool) -> tuple[float, float]:
    stiffness = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], 1.0)
    return tension_of_a_prism(width, stiffness, height, weights)


@pytest.mark.parametrize(
    "weights", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["weighted", "full"]
)
def test_a_pulled_prism_has_the_modulus_of_the_static_solution(taichi: None, weights: bool) -> None:
    numbers, history = pull(_elastic_prism(6, 6, weights))
    assert history[-1]["energy_error"] < 1e-8
    modulus, _ = _static(6, 6, weights)
    assert numbers["youngs_modulus"] == pytest.approx(modulus, rel=2e-3)
    # a sixth of the modules has no neighbour: what that costs is the static solution's
    assert modulus / PMMA["youngs_modulus"] - 1 == pytest.approx(
        -0.015 if weights else 0.137, abs=0.003
    )


@pytest.mark.slow
def test_a_wide_prism_has_the_input_s_elastic_constants(taichi: None) -> None:
    simulation = _elastic_prism(24, 24, True)
    place = simulation.dynamics.lattice.positions()[0]
    x, y = place[..., 0], place[..., 1]
    inner = simulation.dynamics.lattice.exists()[0] & (
        np.abs(place[..., :2]).max(axis=-1) < 6 * EDGE
    )
    inner &= np.abs(place[..., 2] - 12 * EDGE) < 6 * EDGE
    history, strains = [], []
    for sample in simulation.samples():
        history.append(row(sample))
        if len(history) % 20 == 0 and sample.time > simulation.scene.grips.ramp:
            u, v = np.moveaxis(simulation.displacement_before()[0][inner], -1, 0)[:2]
            strains.append((np.polyfit(x[inner], u, 1)[0], np.polyfit(y[inner], v, 1)[0]))
    numbers = summary(simulation, history, NO_FOLDER)
    assert numbers["youngs_modulus"] == pytest.approx(PMMA["youngs_modulus"], rel=5e-3)
    # between the sides a layer at either counts too: 1.7 % more than inside
    assert numbers["poisson_ratio"] == pytest.approx(_static(24, 24, True)[1], rel=5e-3)
    along, across = np.array(strains).T
    assert initial_slope(along, -across) == pytest.approx(PMMA["poisson_ratio"], rel=5e-3)


@pytest.mark.slow
def test_a_prism_tears_at_the_stress_at_which_its_longitudinal_bars_pay(taichi: None) -> None:
    """Pulled along an axis, a front eats the longitudinal bars before the diagonals break.

    Behind it the modulus is a fifth: C11 = C12 = 0.4 E and C22 = 1.2 E give 0.4 - 2 0.4^2 / 1.6.
    Its two sides balance at sigma^2 (5 - 1) / E = sigma^2 (5 - 1) / 2 E + D, with D = 2 c_A G_f / L
    for the longitudinal bars along the pull (two a module, 2 c_A L^2 of fracture area in L^3).
    Only the last corner nodes are pulled: damage starts there, early and with little energy stored.
    """
    from taichi_ldem.solver.simulation import Simulation

    scene = block_scene(
        48,
        12,
        6,
        spacing=EDGE,
        scenario="tension",
        material={"damage": True, "fracture_energy": G_F, "failure_factor": 31.45},
        grips=ENDS | {"length": 0.2 * EDGE, "velocity": 1.0},
        solver={"duration": 9e-4, "safety": 0.5},
        output={"history_interval": 1e-6},
    )
    numbers, history = pull(Simulation(scene))
    stress = np.array([r["grip_force_n"] for r in history]) / numbers["net_section_m2"]
    time = np.array([r["time_s"] for r in history])
    front = np.sqrt(1 / (2 + 9 / np.sqrt(3)) * G_F * 3.35e9 / EDGE)
    assert front == pytest.approx(30.0e6, rel=2e-3)
    assert np.median(stress[(time > 5e-4) & (time < 8e-4)]) == pytest.approx(front, rel=0.05)
