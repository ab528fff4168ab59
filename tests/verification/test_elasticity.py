"""What solid the lattice is: stiffness of the bulk, and of a bar in tension."""

import numpy as np
import pytest
from support.prism import tension_of_a_prism
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import prism

RATIOS = [0.1, 0.2, 0.25, 0.3, 0.4]
AXIAL = np.diag([1.0, 0.0, 0.0])
BIAXIAL = np.diag([1.0, 1.0, 0.0])
SHEAR = np.array([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])


def _bulk_energy(strain: np.ndarray, stiffness: tuple[float, float]) -> float:
    """Energy per module of the infinite lattice in a uniform strain.

    The energy of a block of n^3 modules is a cubic in n (bulk, faces, edges, corners), so its third
    difference is 3! times the bulk's, exactly.
    """
    energies = []
    for n in (1, 2, 3, 4):
        body = Body(prism(n, n, n))
        along = body.rest / body.lengths[:, None]
        bar_strain = np.einsum("bi,ij,bj->b", along, strain, along)
        energies.append(
            np.sum(0.5 * body.weights * body.per_bar(*stiffness) * body.lengths * bar_strain**2)
        )
    return float(np.diff(energies, 3)[0]) / 6


@pytest.mark.parametrize("variant", ["equation-2", "as-printed"])
@pytest.mark.parametrize("nu", RATIOS)
def test_elastic_constants_of_the_bulk(nu: float, variant: str) -> None:
    stiffness = mat.axial_stiffness(1.0, nu, 1.0, variant)
    c11 = 2 * _bulk_energy(AXIAL, stiffness)
    c12 = _bulk_energy(BIAXIAL, stiffness) - c11
    c44 = 2 * _bulk_energy(SHEAR, stiffness)
    expected = mat.elastic_constants(1.0, nu, variant)
    np.testing.assert_allclose((c11, c12, c44), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("nu", RATIOS)
def test_normal_stiffness_is_that_of_the_isotropic_solid_for_any_poisson_ratio(nu: float) -> None:
    c11, c12, _ = mat.elastic_constants(1.0, nu)
    lame = nu / ((1 + nu) * (1 - 2 * nu))  # Hooke's law with E = 1
    assert c12 == pytest.approx(lame, rel=1e-13)
    assert c11 == pytest.approx(lame + 1 / (1 + nu), rel=1e-13)


@pytest.mark.parametrize("nu", [0.2, 0.25, 0.3])
def test_a_laterally_periodic_block_in_tension_has_the_input_s_constants(nu: float) -> None:
    """Every node is a centre of symmetry, so uniform strain is equilibrium: no layer, no error.

    The energy of a pull is a parabola in the contraction; at its lowest point it is E/2.
    """
    stiffness = mat.axial_stiffness(1.0, nu, 1.0)
    none, one, two = (_bulk_energy(np.diag([1.0, -c, -c]), stiffness) for c in (0.0, 1.0, 2.0))
    curvature = 0.5 * (two - 2 * one + none)
    contraction = -(one - none - curvature) / (2 * curvature)
    assert contraction == pytest.approx(nu, rel=1e-12)
    assert 2 * (none - curvature * contraction**2) == pytest.approx(1.0, rel=1e-12)


def test_a_quarter_gives_the_isotropic_solid_and_only_with_equation_2() -> None:
    assert mat.elastic_constants(1.0, 0.25) == pytest.approx((1.2, 0.4, 0.4), rel=1e-14)
    c11, c12, c44 = mat.elastic_constants(1.0, 0.25, "as-printed")
    assert (c12, c44) == pytest.approx((0.16, 0.16), rel=1e-14)
    assert 2 * c44 / (c11 - c12) == pytest.approx(0.4, rel=1e-12)  # isotropic would be one


@pytest.mark.parametrize("nu", [0.2, 0.25, 0.3])
def test_a_bar_in_tension_has_young_s_modulus_and_poisson_s_ratio(nu: float) -> None:
    stiffness = mat.axial_stiffness(1.0, nu, 1.0)
    coarse, fine = (np.array(tension_of_a_prism(n, stiffness)) for n in (10, 20))
    # a free face costs a layer of given depth, so the error is of first order in 1/width
    modulus, ratio = 2 * fine - coarse
    assert modulus == pytest.approx(1.0, rel=1e-4)
    assert ratio == pytest.approx(nu, abs=1e-3)
    assert 0.98 < fine[0] < 1.0
