"""Faces and clamps of a plate of few modules: the error that each one makes."""

import numpy as np
import pytest
from support.blocks import PMMA

from studies import boundaries

NU = PMMA["poisson_ratio"]


@pytest.mark.parametrize("modules", [1, 3, 6])
def test_curvature_that_leaves_the_thickness_alone_has_an_error_of_second_order(
    modules: int,
) -> None:
    """Sums of z^2 over the planes of the bars that carry it, instead of the integral H^3 / 12.

    A saddle along the axes stretches longitudinal bars alone (diagonals have as much of either
    sign): the trapezoidal rule's H^3/12 (1 + 2/n^2) on corner planes, the mid-point rule's H^3/12
    (1 - 1/n^2) on centre planes. A twist stretches diagonals alone, whose middles are the
    mid-points of half modules.
    """
    saddle, twist = (boundaries.SHAPES[name] for name in ("saddle", "twist"))
    off = 1 / modules**2
    assert boundaries.bending_stiffness(modules, saddle, NU) == pytest.approx(1 + off / 2)
    assert boundaries.bending_stiffness(modules, twist, NU) == pytest.approx(1 - off / 4)


def test_strain_across_a_face_makes_the_error_one_of_first_order() -> None:
    """The soft layers have a depth in modules: their share halves where the number doubles."""
    shapes = boundaries.SHAPES
    for name in ("cylinder", "sphere"):
        off = {n: 1 - boundaries.bending_stiffness(n, shapes[name], NU) for n in (48, 96)}
        assert off[48] / off[96] == pytest.approx(2.0, rel=0.1)
    fixed = {n: 1 - boundaries.thickness_frequency(n, 2, True, NU) for n in (24, 48)}
    assert fixed[24] / fixed[48] == pytest.approx(2.0, rel=0.05)
    free = {n: 1 - boundaries.thickness_frequency(n, 2, False, NU) for n in (24, 48)}
    assert free[24] / free[48] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("fixed", [False, True])
def test_shear_through_the_thickness_is_a_chain_of_equal_springs(fixed: bool) -> None:
    """2 n springs between 2 n + 1 layers, the outer ones of half the mass: a textbook's chain."""
    for modules in (2, 6):
        angle = np.pi / (4 * modules)
        found = boundaries.thickness_frequency(modules, 0, fixed, NU)
        assert found == pytest.approx(np.sin(angle) / angle, rel=1e-9)


@pytest.mark.slow
def test_a_clamp_along_planes_of_nodes_keeps_the_plate_within_1_percent(taichi: None) -> None:
    """Square rings; the round ones of docs/modes.md lose 1.7 % more at four modules to stairs."""
    pytest.importorskip("skfem")
    exact = boundaries._reference(boundaries.square_rings(2))
    size = (boundaries.SIDE, boundaries.SIDE, boundaries.THICKNESS)
    found = boundaries.lowest_frequency(boundaries.scene_of(size, 4), boundaries.on_square_rings)
    assert found / exact - 1 == pytest.approx(-0.010, abs=0.005)
