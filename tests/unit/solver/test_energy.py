from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import PMMA, SPACING
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.solver.energy import Ledger

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

STIFFNESS = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], SPACING)


def test_energies_are_those_of_bars_and_nodes(elastic: "Simulation", body: Body) -> None:
    rng = np.random.default_rng(6)
    displacement = rng.normal(0.0, 0.05 * SPACING, (len(body.places), 3))
    velocity = rng.normal(0.0, 3.0, (len(body.places), 3))
    elastic.start_from(body.spread(displacement), body.spread(velocity))
    ledger = elastic.sample_step().ledger
    assert ledger.strain == pytest.approx(body.strain_energy(displacement, STIFFNESS), rel=1e-12)
    # the velocity at t = 0 is the mean of those half a step before and after, whose product is
    # v^2 less a quarter of the change squared
    mass = PMMA["density"] * SPACING**3 * body.mass_shares[:, None]
    jump = elastic.time_step * body.forces(displacement, STIFFNESS) / mass
    kinetic = 0.5 * np.sum(mass * (velocity**2 - jump**2 / 4))
    assert ledger.kinetic_plate == pytest.approx(kinetic, rel=1e-12)


def test_energy_of_a_free_body_does_not_drift(elastic: "Simulation", body: Body) -> None:
    """10 000 steps of the first longitudinal mode: the imbalance's running mean keeps still."""
    mode = np.cos(np.pi * body.places[:, 0] / np.ptp(body.places[:, 0]))  # no strain at its ends
    velocity = 0.5 * mode[:, None] * [1.0, 0.0, 0.0]
    elastic.start_from(np.zeros((2, *elastic.dynamics.sites, 3)), body.spread(velocity))
    start = elastic.sample_step().ledger
    errors = []
    for _ in range(1000):
        elastic.advance(9)
        errors.append(elastic.sample_step().ledger.imbalance(start) / start.stored)
    running = np.cumsum(errors) / np.arange(1, 1001)
    slope = np.polyfit(np.arange(500), running[500:], 1)[0]
    assert abs(1000 * slope) <= 1e-6
    assert abs(np.mean(errors[500:]) - np.mean(errors[:500])) <= 1e-6


def test_ledger_balance() -> None:
    start = Ledger(kinetic_bodies=2.0)
    later = Ledger(0.25, 1.0, 0.5, 0.125, 0.0625, 0.03125, external=0.25)
    # 2 J and 0.25 J from outside became 0.25 + 1 + 0.5 + 0.125 + 0.0625 + 0.03125 J
    assert later.imbalance(start) == 1.96875 - 2.25
    assert later.error(start) == 0.28125 / 2.25
    assert later.error_of_plate(start, 1e-3) == 0.28125 / 1.25
    assert later.error_of_plate(start, 10.0) == 0.28125 / 10.0
    assert start.error(start) == 0.0


def test_a_body_at_rest_has_no_error() -> None:
    rest = Ledger()
    assert rest.error(rest) == 0.0
    assert rest.error_of_plate(rest, 0.0) == 0.0
