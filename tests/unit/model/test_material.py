import math

import pytest
from support.blocks import block_scene

from taichi_ldem.errors import SceneError
from taichi_ldem.model import material as mat
from taichi_ldem.scene import Material

# the falling-weight test of the paper: E, nu, rho, G_f and R_f of its Section 4
PAPER = Material(
    youngs_modulus=3.35e9,
    poisson_ratio=0.25,
    density=1190.0,
    fracture_energy=1034.0,
    failure_factor=31.45,
)
PAPER_SPACING = 3.2e-3 / 6
RATIOS = [0.1, 0.2, 0.25, 0.3, 0.4]


def test_stiffness_of_the_paper_s_bars() -> None:
    # EA_l = 375.47 N is printed; Eq. (1) with nu = 0.25, 0.4 E L^2, gives that for E = 3.30 GPa
    longitudinal, diagonal = mat.axial_stiffness(3.30e9, 0.25, PAPER_SPACING)
    assert longitudinal == pytest.approx(375.47, rel=1e-4)
    assert diagonal == pytest.approx(487.7, rel=2e-4)  # Eq. (2), see the shared paper facts
    _, printed = mat.axial_stiffness(3.30e9, 0.25, PAPER_SPACING, "as-printed")
    assert printed == pytest.approx(195.10, rel=1e-4)  # printed


@pytest.mark.parametrize("nu", RATIOS)
def test_fracture_areas_of_a_cut_add_up_to_it(nu: float) -> None:
    longitudinal, diagonal = mat.fracture_areas(nu)
    assert 2 * longitudinal + 4 * diagonal == pytest.approx(1.0, rel=1e-14)
    ratio = mat.axial_stiffness(1.0, nu, 1.0)
    assert diagonal / longitudinal == pytest.approx(ratio[1] / ratio[0], rel=1e-14)  # Eq. (5)


def test_fracture_areas_round_to_the_printed_ones_at_a_quarter() -> None:
    longitudinal, diagonal = mat.fracture_areas(0.25)
    assert longitudinal == pytest.approx(3 / 22, rel=0.02)  # Eq. (6)
    assert diagonal == pytest.approx(4 / 22, rel=0.02)
    assert mat.fracture_areas(0.25, "paper") == (4 / 22, 3 / 22)  # Eqs. (7), (8): swapped


def test_strains_of_the_paper() -> None:
    bars = mat.bar_families(PAPER, PAPER_SPACING)
    # Eq. (9): 31.45 sqrt(1034 / 3.35e9)
    assert bars.longitudinal.peak_strain == pytest.approx(0.017473, rel=1e-4)
    # Eq. (12) by hand: 2 R_f^-2 A_f E / (EA L_i) = 2 (c_A / phi) / (R_f^2 L_i) with c_A / phi =
    # (0.13891, 0.18044) / (0.4, 0.51962) and L_i = L (1, sqrt(3)/2)
    assert bars.longitudinal.ductility == pytest.approx(1.3166, rel=1e-3)
    assert bars.diagonal.ductility == pytest.approx(1.5203, rel=1e-3)
    assert bars.longitudinal.critical_length == pytest.approx(0.7022e-3, rel=1e-3)


@pytest.mark.parametrize("law_spacing", [0.2e-3, 0.4e-3])
@pytest.mark.parametrize("areas", ["derived", "paper"])
def test_a_bar_dissipates_its_share_of_the_fracture_energy(law_spacing: float, areas: str) -> None:
    material = PAPER.model_copy(update={"fracture_areas": areas})
    bars = mat.bar_families(material, law_spacing)
    for family in (bars.longitudinal, bars.diagonal):
        assert family.energy_to_break == pytest.approx(1034.0 * family.fracture_area, rel=1e-13)


def test_a_given_limit_strain_is_taken_and_its_excess_is_known() -> None:
    material = PAPER.model_copy(
        update={"failure_factor": None, "failure_strain": 0.0224, "limit_strain": 0.0224}
    )
    bars = mat.bar_families(material, PAPER_SPACING)
    assert bars.longitudinal.ductility == 1.0
    # brittle: 1/2 E A eps_p^2 L against G_f A_f; K_r of Eq. (12) would be their inverse ratio
    excess = bars.longitudinal.energy_to_break / (1034.0 * bars.longitudinal.fracture_area)
    free = mat.bar_families(material.model_copy(update={"limit_strain": None}), PAPER_SPACING)
    assert excess == pytest.approx(1 / free.longitudinal.ductility, rel=1e-13)
    assert excess > 1


def _plate(modules: int, **material: float) -> mat.Bars:
    scene = block_scene(
        40, 40, modules, spacing=3.2e-3 / modules, material=PAPER.model_dump() | material
    )
    return mat.check(scene)


def test_too_coarse_a_lattice_is_refused_with_the_number_of_modules_that_would_do() -> None:
    strain = {"failure_factor": None, "failure_strain": 0.0224}
    with pytest.raises(SceneError, match=r"K_r = 0\.8.*at least 8 modules .* at most") as refusal:
        _plate(6, **strain)
    assert "\n" not in str(refusal.value)
    assert "too coarse for longitudinal bars to soften" in str(refusal.value)
    with pytest.raises(SceneError, match=r"^x\.toml: plate\.modules"):
        mat.check(block_scene(9, 9, 3, spacing=2e-3, material=PAPER.model_dump()), "x.toml")
    with pytest.raises(SceneError, match="at least 8 modules"):
        _plate(7, **strain)
    assert min(_plate(8, **strain).longitudinal.ductility, 9) >= 1
    assert _plate(6, **strain, limit_strain=0.0224).longitudinal.ductility == 1.0
    assert _plate(6, **strain, damage=False).longitudinal.peak_strain == 0.0


def test_the_limit_strain_of_the_refusal_is_admitted() -> None:
    # R_f 60: eps_p = 60 sqrt(1034 / 3.35e9) = 0.03333413, which five digits round down
    factor = {"failure_factor": 60.0}
    with pytest.raises(SceneError, match=r"limit_strain >= 0\.0\d+,") as refusal:
        _plate(6, **factor)
    advised = str(refusal.value).partition("limit_strain >= ")[2].partition(",")[0]
    assert _plate(6, **factor, limit_strain=float(advised)).longitudinal.ductility >= 1


def test_characteristic_length_of_eq_9() -> None:
    # L_cr of Eq. (13) is 2 (A_f E / EA) / R_f^2: geometry times the characteristic length 1 / R_f^2
    bars = mat.bar_families(PAPER, PAPER_SPACING)
    area = mat.fracture_areas(0.25)[0] / mat.phi(0.25)
    assert bars.longitudinal.critical_length == pytest.approx(2 * area / 31.45**2, rel=1e-12)
    assert math.isclose(1 / 31.45**2, 1.01e-3, rel_tol=2e-3)  # 1.01 mm, shared paper facts
