"""Masses of nodes, and their motion with and without forces and damping."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, random_displacement
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scene import Material

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

STIFFNESS = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], SPACING)


def test_masses_add_up_and_reach_the_nodes(elastic: "Simulation", body: Body) -> None:
    dynamics = elastic.dynamics
    mass = np.moveaxis(dynamics.mass.to_numpy()[dynamics.lattice.code], -1, 0)
    module = PMMA["density"] * SPACING**3
    np.testing.assert_allclose(mass[body.index], module * body.mass_shares, rtol=1e-15)
    assert mass.sum() == pytest.approx(dynamics.lattice.mask.sum() * module, rel=1e-14)
    inverse = np.moveaxis(dynamics.inverse_mass.to_numpy()[dynamics.lattice.code], -1, 0)
    np.testing.assert_allclose((mass * inverse)[body.index], 1.0, rtol=1e-15)


def test_a_body_without_forces_flies_straight(elastic: "Simulation", body: Body) -> None:
    velocity = np.array([0.3, -0.2, 1.0])
    elastic.start_from(
        np.zeros((2, *elastic.dynamics.sites, 3)),
        body.spread(np.tile(velocity, (len(body.places), 1))),
    )
    elastic.advance(200)
    moved = elastic.displacement()[body.index]
    np.testing.assert_allclose(
        moved, np.tile(200 * elastic.time_step * velocity, (len(moved), 1)), rtol=1e-12
    )
    np.testing.assert_allclose(
        elastic.dynamics.get_velocity()[body.index],
        np.tile(velocity, (len(moved), 1)),
        rtol=1e-10,
    )
    assert not elastic.displacement()[~elastic.dynamics.lattice.exists()].any()


def test_two_steps_are_central_differences(elastic: "Simulation", body: Body) -> None:
    """Eq. (3) by hand: x(n+1) = 2 x(n) - x(n-1) + dt^2 F(x(n)) / m."""
    dt = elastic.time_step
    mass = PMMA["density"] * SPACING**3 * body.mass_shares[:, None]
    start, velocity = (
        random_displacement(body, 0.05 * SPACING),
        random_displacement(body, 5.0, seed=4),
    )
    elastic.start_from(body.spread(start), body.spread(velocity))
    first = start + dt * velocity + 0.5 * dt**2 * body.forces(start, STIFFNESS) / mass
    second = 2 * first - start + dt**2 * body.forces(first, STIFFNESS) / mass
    for expected in (first, second):
        elastic.advance(1)
        np.testing.assert_allclose(
            elastic.displacement()[body.index], expected, rtol=0, atol=1e-14 * SPACING
        )


def test_damping_slows_a_free_flight_by_its_own_factor(taichi: None) -> None:
    """With C = alpha M and no forces, (v+ - v-)/dt = -alpha (v+ + v-)/2: a geometric decay."""
    from taichi_ldem.solver.dynamics import Dynamics, Features

    bars = mat.bar_families(Material(**PMMA), SPACING)
    dynamics = Dynamics(Lattice(prism(2, 1, 1), SPACING), bars, 1190.0, Features(damping=True))
    body = Body(prism(2, 1, 1), SPACING)
    dynamics.set_velocity(body.spread(np.ones((len(body.places), 3))))
    dt, alpha = 1e-7, 2e4
    half = 0.5 * alpha * dt
    for _ in range(500):
        dynamics.kick(0, dt, alpha)
    speed = dynamics.get_velocity()[body.index]
    np.testing.assert_allclose(speed, ((1 - half) / (1 + half)) ** 500, rtol=1e-12)
    assert speed[0, 0] == pytest.approx(np.exp(-alpha * 500 * dt), rel=1e-6)
