"""A thin circular plate, clamped at its rim, under a load at its centre."""

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene


@pytest.mark.slow
def test_static_stiffness_of_a_clamped_plate(taichi: None) -> None:
    """Kirchhoff's plate, F a^2 / (16 pi D), and a little more for shear.

    The load is the weight of a striker of small diameter, on a plate of radius a = 12 H near
    critical damping (its lowest frequency is 10.2 / a^2 sqrt(D / rho H) = 1.8e4 rad/s).
    """
    from taichi_ldem.solver.simulation import Simulation

    layers, across = 4, 104
    radius, height = 24e-3, layers * SPACING
    weight, mass = 2.0, 50e-6
    scene = block_scene(
        across,
        across,
        layers,
        striker={"diameter": 6e-3, "mass": mass, "velocity": 0.0, "gravity": weight / mass},
        clamp={"kind": "rim", "inner_diameter": 2 * radius},
        solver={"duration": 1e-2, "damping": 3e4},
    )
    simulation = Simulation(scene)
    for _ in range(6):
        sample = simulation.sample_step()
        simulation.advance(999)
    assert sample.observed["striker_force_n"] == pytest.approx(weight, rel=0.01)
    assert sample.observed["ring_force_n"] == pytest.approx(weight, rel=0.01)
    lattice = simulation.dynamics.lattice
    middle = (0, 1, across // 2 + 1, across // 2 + 1)  # bottom face: no dent of the striker
    place = lattice.positions()[middle]
    assert np.abs(place).max() < 1e-12
    deflection = -simulation.displacement()[middle][2]
    rigidity = PMMA["youngs_modulus"] * height**3 / 12 / (1 - PMMA["poisson_ratio"] ** 2)
    thin = weight * radius**2 / (16 * np.pi * rigidity)
    assert deflection == pytest.approx(thin, rel=0.15)  # four modules: 9 % more
    assert deflection > thin
