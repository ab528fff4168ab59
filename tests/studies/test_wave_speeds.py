"""The wave speeds that the kernels give, compared with the exact ones of the lattice."""

import numpy as np
import pytest
from support.blocks import PMMA

from studies.wave_speeds import Wave, cube, measure
from taichi_ldem.model import waves
from taichi_ldem.scene import Material

RHO = PMMA["density"]


def test_plane_waves_of_the_kernels_keep_the_exact_relation(taichi: None) -> None:
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(cube(24))
    medium = waves.bulk(Material(**PMMA), simulation.spacing)
    for direction, vector, modules, polarisation in (
        ("[100]", (1.0, 0.0, 0.0), 20, "P"),
        ("[100]", (1.0, 0.0, 0.0), 4, "P"),
        ("[111]", (1.0, 1.0, 1.0), 5, "P"),
        ("[210]", (2.0, 1.0, 0.0), 6, "S1"),
    ):
        speed = measure(simulation, medium, Wave(0.25, direction, vector, modules, polarisation))
        assert speed.measured == pytest.approx(speed.exact, rel=1e-5)
        assert speed.measured_continuous == pytest.approx(speed.exact_continuous, rel=1e-5)
        if modules == 4:  # the time step and the lattice are both seen: 0.5 % and 6.8 %
            assert speed.measured > 1.004 * speed.exact_continuous
            assert speed.measured < 0.95 * np.sqrt(1.2 * PMMA["youngs_modulus"] / RHO)
