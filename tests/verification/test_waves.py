"""Waves travel as in the solid."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.optimize import curve_fit
from support.blocks import PMMA, SPACING
from support.reference import Body

from taichi_ldem.model import material as mat

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


def test_longitudinal_waves_travel_at_the_speed_of_the_bulk(
    elastic: "Simulation", body: Body
) -> None:
    """A standing wave, one wavelength of 20 modules between the free ends of the block.

    Its lateral faces slide (their normal motion is taken away after each step): with the faces'
    bars weighted by a half, such a block is a cut-out of the infinite lattice.
    """
    wave = 2 * np.pi / (20 * SPACING)
    shape = np.cos(wave * (body.positions[:, 0] - body.positions[:, 0].min()))
    elastic.start_from(
        body.spread(1e-5 * SPACING * shape[:, None] * [1, 0, 0]),
        np.zeros((2, *elastic.dynamics.sites, 3)),
    )
    amplitude = []
    for _ in range(500):
        displaced = elastic.displacement() * [1, 0, 0]
        elastic.dynamics.set_displacement(elastic.now, displaced)
        amplitude.append(np.sum(body.mass_shares * displaced[body.index][:, 0] * shape))
        elastic.advance(1)
        velocity = elastic.dynamics.get_velocity()
        elastic.dynamics.set_velocity(velocity * [1, 0, 0])
    time = elastic.time_step * np.arange(500)
    c11, _, _ = mat.elastic_constants(PMMA["youngs_modulus"], PMMA["poisson_ratio"])
    speed = np.sqrt(c11 / PMMA["density"])
    (frequency, _), _ = curve_fit(
        lambda t, w, a: a * np.cos(w * t), time, amplitude, p0=(wave * speed, amplitude[0])
    )
    assert time[-1] * frequency > 20 * np.pi  # over more than ten periods
    assert frequency / wave == pytest.approx(speed, rel=0.01)
