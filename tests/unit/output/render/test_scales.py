"""Quantities by which modules are coloured."""

import numpy as np
import pytest
from support.modules import displaced

from taichi_ldem.output.render.scales import speed, strain_energy


def test_speed_is_that_of_the_corners() -> None:
    np.testing.assert_allclose(speed(displaced(np.zeros((3, 3)), (0.0, 3.0, -4.0))), 5.0)


def test_strain_energy_of_homogeneous_strains() -> None:
    """Uniaxial strain: C11/2 e2; simple shear: 2 C44 (g/2)^2 and what Green's strain adds."""
    strain = 2.0**-10  # exact in single precision
    pulled = np.zeros((3, 3))
    pulled[0, 0] = strain
    green = strain + strain**2 / 2
    energy = strain_energy(displaced(pulled, (0, 0, 0)), (6.0, 2.0, 2.0))
    np.testing.assert_allclose(energy, [3 * green**2] * 2 + [np.nan] + [3 * green**2], rtol=1e-12)
    sheared = np.zeros((3, 3))
    sheared[1, 2] = strain
    energy = strain_energy(displaced(sheared, (0, 0, 0)), (6.0, 2.0, 2.0))[0]
    assert energy == pytest.approx(4 * (strain / 2) ** 2 + 3 * (strain**2 / 2) ** 2, rel=1e-12)


def test_a_rotation_has_no_strain_energy() -> None:
    cosine, sine = np.cos(0.7), np.sin(0.7)
    turned = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) - np.eye(3)
    energy = strain_energy(displaced(turned, (0, 0, 0)), (6.0, 2.0, 2.0))
    assert np.nanmax(np.abs(energy)) < 1e-12
