"""Natural frequencies against beam theory and finite elements."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq
from support.blocks import PMMA, SPACING, block_scene

E, NU, DENSITY = PMMA["youngs_modulus"], PMMA["poisson_ratio"], PMMA["density"]
CONSTANTS = (1.2 * E, 0.4 * E, 0.4 * E)  # isotropic, nu = 0.25


def timoshenko(length: float, side: float) -> float:
    """First bending frequency of a free-free square beam, Hz; Cowper's shear coefficient (1966).

    The state (w, psi, M, Q) is carried along the beam; M = Q = 0 at both ends.
    """
    area, inertia = side**2, side**4 / 12
    shear = 10 * (1 + NU) / (12 + 11 * NU) * E / (2 * (1 + NU)) * area

    def ends(frequency: float) -> float:
        squared = (2 * np.pi * frequency) ** 2
        along = np.zeros((4, 4))
        along[0, 1], along[0, 3] = 1.0, 1 / shear
        along[1, 2] = 1 / (E * inertia)
        along[2, 1], along[2, 3] = -DENSITY * inertia * squared, -1.0
        along[3, 0] = -DENSITY * area * squared
        return float(np.linalg.det(expm(along * length)[2:, :2]))

    thin = 22.3733 / (2 * np.pi * length**2) * np.sqrt(E * inertia / (DENSITY * area))
    return brentq(ends, 0.5 * thin, 1.001 * thin)


def test_free_prism_has_six_rigid_motions_and_timoshenko_s_first_bending(taichi: None) -> None:
    from taichi_ldem.scenarios.modes import build, name_modes
    from taichi_ldem.solver import eigen

    across, along = 4, 40
    scene = block_scene(along, across, across)
    dynamics, fixed = build(scene)
    modes = eigen.lowest(eigen.TangentOperator(dynamics, fixed), 9)
    bending = timoshenko(along * SPACING, across * SPACING)
    assert modes.frequencies[:6].max() < 1e-4 * bending
    assert modes.frequencies[6:8] == pytest.approx([bending, bending], rel=0.02)
    assert modes.frequencies[8] > 1.05 * bending
    kinds = [mode.name.kind for mode in name_modes(scene, dynamics, modes)]
    assert kinds == ["rigid"] * 6 + ["other"] * 3


def test_finite_elements_of_a_beam() -> None:
    fe = pytest.importorskip("taichi_ldem.studies.finite_elements")
    pytest.importorskip("skfem")
    length, side = 20e-3, 2e-3
    part = fe.free_plate((length, side, side), (6, 1, 1))
    found, _, _ = fe.frequencies(part, CONSTANTS, DENSITY, fe.Symmetry((True, True, False)), 2)
    bending = timoshenko(length, side)
    assert found[0] < 1e-2 * bending  # translation along z
    assert found[1] == pytest.approx(bending, rel=2e-3)


def test_the_mesh_of_a_clamped_plate_fills_it_and_follows_the_circles() -> None:
    pytest.importorskip("skfem")
    from taichi_ldem.studies import finite_elements as fe

    part = fe.clamped_plate((0.0928, 0.0928, 0.0032), 0.038, 0.045, 1)
    _, mass, basis = fe.matrices(part, CONSTANTS, DENSITY)
    along = np.zeros(basis.N)
    along[fe._component(basis, 0)] = 1.0
    assert along @ mass @ along == pytest.approx(DENSITY * 0.0928**2 * 0.0032 / 8, rel=1e-6)
    radius = np.hypot(*part.mesh.doflocs[:2])
    for circle in (0.038, 0.045):
        assert np.count_nonzero(np.abs(radius - circle) < 1e-12) >= 2 * (2 * 2 * 3 + 1)


@pytest.mark.slow
def test_a_free_plate_converges_to_finite_elements_with_second_order(taichi: None) -> None:
    pytest.importorskip("skfem")
    from taichi_ldem.scenarios.modes import build
    from taichi_ldem.solver import eigen
    from taichi_ldem.studies import finite_elements as fe

    side, thickness = 16e-3, 3.2e-3
    part = fe.free_plate((side, side, thickness), (6, 6, 3))
    exact = [f for f, _ in fe.plate_modes(part, CONSTANTS, DENSITY, 3)]
    twist, errors = min(f for f in exact if f > 1e3), {}
    for layers in (2, 4):
        across = 5 * layers
        scene = block_scene(across, across, layers, spacing=thickness / layers)
        dynamics, fixed = build(scene)
        modes = eigen.lowest(eigen.TangentOperator(dynamics, fixed), 7)
        errors[layers] = modes.frequencies[6] / twist - 1
    order = np.log2(abs(errors[2]) / abs(errors[4]))
    assert order == pytest.approx(2.0, abs=0.3)
    assert abs(errors[4]) < 0.03
