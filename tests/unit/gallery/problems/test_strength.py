"""Moments of round plates on a ring, against the equation of equilibrium."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taichi_ldem.gallery.problems.strength import (
    PROBLEM,
    effective_volume,
    moments,
    shape_parameter,
    stress,
)


def _run(name: str) -> Any:
    run = next(run for run in PROBLEM.runs if run.name == name)
    return SimpleNamespace(scene=run.resolved(quick=False))


@pytest.mark.parametrize("name", ["ring_1", "ball_1"])
def test_moments_are_in_equilibrium_with_the_force(name: str) -> None:
    run = _run(name)
    radius = np.linspace(0.0055, 0.0099, 4001)  # outside of the load, within the support
    radial, around = moments(run, radius)
    slope = np.gradient(radius * radial, radius)[1:-1]
    # d(r M_r)/dr - M_t = -r Q with the shear Q = 1 / (2 pi r)
    np.testing.assert_allclose(slope - around[1:-1], -1 / (2 * math.pi), rtol=1e-4)
    edge, _ = moments(run, np.array([0.010]))
    assert edge[0] == pytest.approx(0.0, abs=1e-12)


def test_the_moment_is_the_same_all_over_the_load_ring() -> None:
    radial, around = moments(_run("ring_1"), np.array([0.0, 0.002, 0.005]))
    np.testing.assert_allclose(radial, around, rtol=1e-12)
    np.testing.assert_allclose(radial, radial[0], rtol=1e-12)
    # ASTM C1499: 3 F / (2 pi h^2) ((1 - nu) (D_s^2 - D_l^2) / (2 D^2) + (1 + nu) ln(D_s / D_l)),
    # here with D = D_s, as no plate lies outside of the support in thin-plate theory
    expected = 3 / (2 * math.pi * 0.002**2) * (0.75 * (1 - 0.25) / 2 + 1.25 * math.log(2.0))
    assert stress(_run("ring_1"), 1.0) == pytest.approx(expected, rel=1e-12)


def test_weibulls_m_and_the_stressed_volumes() -> None:
    m = shape_parameter(0.15)
    first, second = math.gamma(1 + 1 / m), math.gamma(1 + 2 / m)
    assert math.sqrt(second / first**2 - 1) == pytest.approx(0.15, rel=1e-9)
    ring, ball = effective_volume(_run("ring_1"), m), effective_volume(_run("ball_1"), m)
    # at least the two directions within the load ring, pi a^2 h / (m + 1)
    assert ring > math.pi * 0.005**2 * 0.002 / (m + 1)
    assert ball < 0.1 * ring
