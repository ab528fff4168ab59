"""Calibration of notched beams: published formulas against each other, and the lattice's."""

import math

import numpy as np
import pytest

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.studies.compliance import (
    added_by_notch,
    calibration,
    lattice_compliance,
    shape_factor,
    whole_beam,
)


def bakker(x: float) -> float:
    """Phi of ASTM D5045 and ISO 13586 for S/W = 4 (Bakker 1990): (A + 18.64)/(dA/dx)."""
    poly = np.polynomial.Polynomial([8.9, -33.717, 79.616, -112.952, 84.815, -25.672])
    front, slope = 16 * x**2 / (1 - x) ** 2, 32 * x / (1 - x) ** 3
    derivative = slope * poly(x) + front * poly.deriv()(x)
    return float((front * poly(x) + 18.64) / derivative)


# beyond 0.7 the two fits of the shape factor part, by 2 % in phi at 0.8
@pytest.mark.parametrize("alpha", [0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
def test_phi_is_the_standards_for_a_span_of_four_widths(alpha: float) -> None:
    assert calibration(alpha, 4.0) == pytest.approx(bakker(alpha), rel=0.01)


def test_whole_beam_is_the_standards_for_a_span_of_four_widths() -> None:
    assert whole_beam(4.0) == pytest.approx(18.64, rel=1e-4)  # ASTM D5045


@pytest.mark.parametrize("beta", [2.5, 3.5, 4.0, 8.0])
def test_shape_factor_has_the_limits_of_a_shallow_and_of_a_deep_notch(beta: float) -> None:
    # Tada: K = 1.1215 sigma sqrt(pi a); K = 3.975 M/(B (W - a)^1.5), that is k (1 - alpha)^1.5 =
    # 3.975/6. The published fits round both.
    shallow = float(shape_factor(1e-9, beta)) / math.sqrt(1e-9)
    slender = 1.1215 * math.sqrt(math.pi)
    assert shallow == pytest.approx(slender * (1 - 0.18 / beta), rel=0.01)
    deep = float(shape_factor(1 - 1e-6, beta)) * 1e-6**1.5
    assert deep == pytest.approx(3.975 / 6, rel=2e-3)


def test_shape_factor_is_srawley_s_for_a_span_of_four_widths() -> None:
    """Srawley 1976, ASTM E399: K = P S f/(B W^1.5), that is k = f/1.5; each claims 0.5 %."""
    a = np.linspace(0.2, 0.9, 15)
    bracket = 1.99 - a * (1 - a) * (2.15 - 3.93 * a + 2.7 * a**2)
    srawley = np.sqrt(a) * bracket / ((1 + 2 * a) * (1 - a) ** 1.5)
    np.testing.assert_allclose(shape_factor(a, 4.0), srawley, rtol=0.01)


def test_a_notch_makes_the_lattice_as_much_softer_as_published() -> None:
    """Span 24 mm, W = 6.5 mm, 13 modules; depths of n + 3/4 modules (``bend.notch_depth``).

    Two modules thick: 3.6 % softer; six, as the series has: 0.8 % at most (docs/bending.md).
    """
    spacing, width, span, modulus = 0.5e-3, 6.5e-3, 24e-3, 3.35e9
    lattice = Lattice(prism(56, 2, 13), spacing)
    thickness = 2 * spacing
    stiffness = mat.axial_stiffness(modulus, 0.25, spacing)
    whole = lattice_compliance(lattice, stiffness, np.zeros(lattice.sites, np.uint16), span)
    for depth in (1.875e-3, 3.375e-3):
        cut = lattice.bars_crossing(0, 0.0, (-1.0, 0.0), (1.0, depth))
        notched = lattice_compliance(lattice, stiffness, cut, span)
        added = modulus * thickness * (notched - whole)
        alpha, beta = depth / width, span / width
        assert added == pytest.approx(added_by_notch(alpha, beta), rel=0.04)
