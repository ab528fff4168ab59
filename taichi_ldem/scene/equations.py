"""From material constants to bars: Eqs. (1), (2) and (4) to (13) of the paper.

These are numbers that the checks of a scene need; ``model.material`` offers them to the rest of the
program. Where the printed numbers disagree with the printed equations, the default follows what can
be derived and the printed variant stays selectable by name (docs/theory.md tells them apart).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from taichi_ldem.errors import SceneError

if TYPE_CHECKING:
    from taichi_ldem.scene.tables import Material

DIAGONAL_LENGTH = math.sqrt(3) / 2
"""Length of a diagonal bar over that of a longitudinal one."""


FAMILY_NAMES = {
    "module": ("longitudinal", "diagonal"),
    "cubic-26": ("edge", "face diagonal", "cube diagonal"),
}
"""Bar families of each lattice, as messages name them."""


def delta(poisson_ratio: float) -> float:
    """delta = 9 nu / (4 - 8 nu), below Eq. (1)."""
    return 9 * poisson_ratio / (4 - 8 * poisson_ratio)


def phi(poisson_ratio: float) -> float:
    """phi = (9 + 8 delta) / (18 + 24 delta), below Eq. (1)."""
    d = delta(poisson_ratio)
    return (9 + 8 * d) / (18 + 24 * d)


def axial_stiffness(
    youngs_modulus: float, poisson_ratio: float, spacing: float, variant: str = "equation-2"
) -> tuple[float, float]:
    """Axial stiffness EA of longitudinal and diagonal bars, N: Eqs. (1), (2).

    Args:
        variant: "equation-2"; "as-printed": the EA_d that the paper prints (195.10 N for EA_l =
            375.47 N), in which phi was counted twice; "volumetric": bars of the isotropic solid
            with nu = 1/4 and the material's shear modulus (``volumetric_modulus``).
    """
    if variant == "volumetric":
        youngs_modulus, poisson_ratio = bars_modulus(youngs_modulus, poisson_ratio), QUARTER
    longitudinal = phi(poisson_ratio) * youngs_modulus * spacing**2
    diagonal = 2 / math.sqrt(3) * delta(poisson_ratio) * longitudinal
    if variant == "as-printed":
        diagonal *= phi(poisson_ratio)
    return longitudinal, diagonal


QUARTER = 0.25
"""Poisson's ratio of a solid whose bars alone make it isotropic: lambda = mu."""


def bars_modulus(youngs_modulus: float, poisson_ratio: float) -> float:
    """Young's modulus of the solid with nu = 1/4 and the same shear modulus, Pa."""
    return youngs_modulus * (1 + QUARTER) / (1 + poisson_ratio)


def volumetric_modulus(youngs_modulus: float, poisson_ratio: float) -> float:
    """lambda - mu, Pa: what bars alone do not give; less than zero below nu = 1/4.

    A module then has the energy (lambda - mu) (J - 1)^2 L^3 / 2, with J the ratio of its volume to
    that at rest, so the lattice is the isotropic solid for any Poisson's ratio.
    """
    shear = youngs_modulus / (2 * (1 + poisson_ratio))
    return shear * (4 * poisson_ratio - 1) / (1 - 2 * poisson_ratio)


def elastic_constants(
    youngs_modulus: float, poisson_ratio: float, variant: str = "equation-2"
) -> tuple[float, float, float]:
    """C11, C12, C44 that the lattice really has, Pa (exactly isotropic for nu = 0.25 with Eq. (2)).

    With ``volumetric``, and in the lattice cubic-26, they are those of the isotropic solid.

    Per volume L^3 the lattice holds six longitudinal bars (two along each axis) and eight
    diagonals: C11 = 2 EA_l/L^2 + (8/9) (sqrt(3)/2) EA_d/L^2 and C12 = C44 = (8/9) (sqrt(3)/2)
    EA_d/L^2.
    """
    if variant == "volumetric":
        mu = youngs_modulus / (2 * (1 + poisson_ratio))
        lame = mu + volumetric_modulus(youngs_modulus, poisson_ratio)
        return lame + 2 * mu, lame, mu
    longitudinal, diagonal = axial_stiffness(youngs_modulus, poisson_ratio, 1.0, variant)
    shear = 8 / 9 * DIAGONAL_LENGTH * diagonal
    return 2 * longitudinal + shear, shear, shear


def fracture_areas(poisson_ratio: float, variant: str = "derived") -> tuple[float, float]:
    """Equivalent fracture areas of longitudinal and diagonal bars over L^2: Eqs. (5) to (8).

    A plane normal to a cube edge, between node planes, cuts two longitudinal and four diagonal bars
    per L^2, so 2 A_l + 4 A_d = 1 with A_d/A_l = EA_d/EA_l (Eq. (5)): c_A = 1/(2 + 8 delta/sqrt(3)),
    which Eq. (6) rounds to 3/22 for nu = 0.25.

    Args:
        variant: "derived", or "paper": Eqs. (7), (8) as printed, which swap the two families.
    """
    if variant == "paper":
        return 4 / 22, 3 / 22
    c_a = 1 / (2 + 8 * delta(poisson_ratio) / math.sqrt(3))
    return c_a, 2 / math.sqrt(3) * delta(poisson_ratio) * c_a


def _cubic_26_areas() -> tuple[float, ...]:
    """Fracture areas of the three families over L^2 (see ``CUBIC_26_AREAS``)."""
    face = 1 / math.sqrt(2) - 1 / math.sqrt(3)
    return 2 / math.sqrt(3) - 1, face, 0.5 * (1 - 1 / math.sqrt(3)) - face


CUBIC_26_AREAS = _cubic_26_areas()
"""Fracture areas of edges, face and cube diagonals of the lattice cubic-26, over L^2.

A bar family of vectors X crosses a plane of normal n |n.X| times per L^2. Flat cracks along (100),
(110) and (111) then cost G_f if

    A_1 + 4 A_2 + 4 A_3 = 1,   A_1 + 3 A_2 + 2 A_3 = 1/sqrt(2),   A_1 + 2 A_2 + 2 A_3 = 1/sqrt(3).
"""


def _cubic_26_stiffnesses() -> tuple[float, ...]:
    """EA/L0 of the three families over E L (see ``CUBIC_26_STIFFNESSES``)."""
    _, face, cube = CUBIC_26_AREAS
    ratio = (cube / 3) / (face / 2)
    two = 0.4 / (1 + 4 / 3 * ratio)
    return 0.8 - two, two, ratio * two


CUBIC_26_STIFFNESSES = _cubic_26_stiffnesses()
"""EA/L0 of edges, face and cube diagonals of the lattice cubic-26, over E L, for nu = 1/4.

C11 = k_1 + 2 k_2 + 4/3 k_3 and C12 = C44 = k_2 + 4/3 k_3 in units of E are 1.2 and 0.4 of the
isotropic solid for k_1 + k_2 = 0.8 and k_2 + 4/3 k_3 = 0.4. The third condition is free: both
families of diagonals have the same K_r, A_2 / (2 k_2) = A_3 / (3 k_3) (Eq. (12)).
"""


@dataclass(frozen=True)
class BarFamily:
    """Geometry and strength of one family of bars.

    Attributes:
        length: m.
        axial_stiffness: EA, N.
        fracture_area: A^f, m2 (0 without damage).
        peak_strain: eps_p, where damage starts (0 without damage).
        limit_strain: eps_r, where the bilinear law ends (0 without damage).
        critical_length: L_cr, Eq. (13), m (0 without damage).
        toughness: G_f A^f over EA L0, what a bar's part of a crack costs (0 without damage).
        viscosity: rho c_P A^f L0 over EA, s: the force with which an opening crack resists is EA
            times this times the strain rate of its bars (0 without damage).
    """

    length: float
    axial_stiffness: float
    fracture_area: float = 0.0
    peak_strain: float = 0.0
    limit_strain: float = 0.0
    critical_length: float = 0.0
    toughness: float = 0.0
    viscosity: float = 0.0

    @property
    def ductility(self) -> float:
        """K_r = eps_r / eps_p, Eq. (11)."""
        return self.limit_strain / self.peak_strain

    @property
    def energy_to_break(self) -> float:
        """Energy that a whole bar dissipates, J: triangle OAB in Fig. 2 times its length."""
        return 0.5 * self.axial_stiffness * self.peak_strain * self.limit_strain * self.length


class Bars(tuple[BarFamily, ...]):
    """The bar families of a lattice, in the order of its unit cell's."""

    @property
    def longitudinal(self) -> BarFamily:
        """The bars along the edges of a module."""
        return self[0]

    @property
    def diagonal(self) -> BarFamily:
        """The shortest diagonals: those of the paper's module, from its centre to its corners."""
        return self[1]


def failure_strain(material: Material) -> float:
    """eps_p: given, or from Eq. (9), R_f sqrt(G_f / E)."""
    if material.failure_strain is not None:
        return material.failure_strain
    if material.failure_factor is None or material.fracture_energy is None:
        raise SceneError(
            "material: damage needs fracture_energy and failure_factor, or failure_strain"
        )
    return material.failure_factor * math.sqrt(material.fracture_energy / material.youngs_modulus)


def pressure_wave_impedance(material: Material) -> float:
    """rho c_P = sqrt(rho E (1 - nu) / ((1 + nu) (1 - 2 nu))), Pa s/m."""
    nu = material.poisson_ratio
    modulus = material.youngs_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    return math.sqrt(material.density * modulus)


def characteristic_length(material: Material) -> float:
    """l_ch = E G_f / (E eps_p)^2, m (Hillerborg et al. 1976); 1 / R_f^2 by Eq. (9).

    Raises:
        SceneError: bars cannot break.
    """
    if not material.damage or material.fracture_energy is None:
        raise SceneError("material.damage = false: a crack needs bars that break")
    strain = failure_strain(material)
    return material.fracture_energy / (material.youngs_modulus * strain**2)


def bar_families(
    material: Material,
    spacing: float,
    stiffness_variant: str = "equation-2",
    strengthening: float = 1.0,
    lattice: str = "module",
) -> Bars:
    """The bar families of a lattice of module edge ``spacing`` (m), without judging K_r.

    With damage: K_r from Eq. (12), or from the scene's limit strain.

    Args:
        strengthening: mean eps_p of bars over the scene's.
        lattice: name of its unit cell.
    """
    nu, shares, modulus = material.poisson_ratio, CUBIC_26_AREAS, material.youngs_modulus
    if stiffness_variant == "volumetric":
        modulus, nu = bars_modulus(modulus, nu), QUARTER
        stiffness_variant = "equation-2"
    if lattice == "cubic-26":
        lengths = tuple(math.sqrt(n) * spacing for n in (1, 2, 3))
        stiffness = tuple(
            k * modulus * spacing * length
            for k, length in zip(CUBIC_26_STIFFNESSES, lengths, strict=True)
        )
    else:
        lengths = (spacing, DIAGONAL_LENGTH * spacing)
        stiffness = axial_stiffness(modulus, nu, spacing, stiffness_variant)
        shares = fracture_areas(nu, material.fracture_areas)
    if not material.damage:
        return Bars(BarFamily(ln, ea) for ln, ea in zip(lengths, stiffness, strict=True))
    assert material.fracture_energy is not None  # the scene refuses damage without it
    eps_p = strengthening * failure_strain(material)
    families = []
    for length, ea, share in zip(lengths, stiffness, shares, strict=True):
        area = share * spacing**2
        # Eq. (13), with A_i = EA_i / E; it grows with L^2 / L^2, so it does not depend on L
        critical = 2 * material.fracture_energy * area / (ea * eps_p**2)
        limit = material.limit_strain or eps_p * critical / length
        if material.fracture == "crack":  # a bar that cannot soften is brittle
            limit = max(limit, eps_p)
        toughness = material.fracture_energy * area / (ea * length)
        viscosity = pressure_wave_impedance(material) * area * length / ea
        families.append(BarFamily(length, ea, area, eps_p, limit, critical, toughness, viscosity))
    return Bars(families)
