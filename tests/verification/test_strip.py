"""A strip between grips: what it stores, by elasticity and by the lattice's symmetry."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import PMMA, block_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

EDGE = 5e-4


def _strip(width: int, **plate: Any) -> "Simulation":
    """16 modules high and 3 thick, pulled to 1 % slowly; elastic."""
    from taichi_ldem.solver.simulation import Simulation

    scene = block_scene(
        16,
        width,
        3,
        spacing=EDGE,
        scenario="tension",
        plate=plate,
        grips={"length": 6e-4, "velocity": 0.4, "ramp": 5e-5},
        solver={"duration": 2e-4, "damping": 1e5},
        output={"history_interval": 1e-5},
    )
    return Simulation(scene)


@pytest.mark.slow
def test_a_wide_strip_stores_what_plane_stress_says(taichi: None) -> None:
    """Two strips differ by columns that no free edge reaches (Rivlin and Thomas, 1953)."""
    from taichi_ldem.studies.toughness.strip import free_height

    stored = []
    for width in (40, 60):
        simulation = _strip(width)
        *_, last = simulation.samples()
        stored.append(last.ledger.strain)
        assert last.energy_error_of_plate < 1e-6
    separation, height = last.observed["grip_displacement_m"], free_height(simulation)
    modulus = PMMA["youngs_modulus"] / (1 - PMMA["poisson_ratio"] ** 2)
    area = 20 * EDGE * 3 * EDGE
    theory = modulus * separation**2 / (2 * height) * area
    # faces of a plate of three modules make it 1 to 3 % softer or stiffer than the continuum
    assert stored[1] - stored[0] == pytest.approx(theory, rel=0.03)


@pytest.mark.slow
def test_a_strip_turned_by_a_right_angle_is_the_same_strip(taichi: None) -> None:
    """The lattice is cubic: only the order of sums differs."""
    pulls = []
    for angle in (0, 90):
        simulation = _strip(12, angle=angle)
        pulls.append([s.observed["grip_force_n"] for s in simulation.samples()])
    np.testing.assert_allclose(pulls[1], pulls[0], atol=1e-9 * max(pulls[0]))
