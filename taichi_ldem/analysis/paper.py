"""The facts that the paper prints, in one place: its experiments, its model and their results.

Figures, tables and reports take them from here. SI units.
"""

import math
from dataclasses import dataclass

from taichi_ldem.scene import Scene

# Falling-weight test of the specimens without disorder (text of Section 5.2, Figs. 5 and 11).
P1_N, T1_S = 600.0, 1.75e-3
"""First peak of the experiments' force and its time."""
P2_N, T2_S = (600.0, 830.0), (6.4e-3, 9.4e-3)
"""Smallest and largest second peak of the experiments, and smallest and largest time of failure."""
V_MAX_S = 0.8e-3
"""Time of the largest velocity in the experiments."""
T2_LDEM_S = 7.5e-3
"""Time of failure in the paper's model."""

# Properties of PMMA from tension and bending tests (Section 3.2).
YOUNGS_MODULUS_PA = 3.35e9
STRENGTH_PA = 75e6
STRENGTH_SCATTER = 0.15
"""Scatter of the measured strength, as a share of it."""
FRACTURE_ENERGY_J_M2 = 930.0
FRACTURE_ENERGY_SCATTER_J_M2 = 120.0
"""Scatter of the measured fracture energy G_IC."""

# The model (Section 4): size of its lattice, and the bars of its homogeneous material.
MODEL_BARS = 2.5e6
MODEL_DEGREES_OF_FREEDOM = 1.2e6
MODEL_SPACING_M = 0.533e-3
"""Edge of a module."""
MODEL_BAR_PROPERTIES = {
    "EA_l [N]": 375.47,
    "EA_d [N]": 195.10,
    "eps_p": 0.01818,
    "eps_r": 0.02238,
    "K_r": 1.23,
}
"""Printed stiffness of longitudinal and diagonal bars, peak and limit strain, ductility."""

NATURAL_FREQUENCIES_HZ = {
    (0, 0): (1.46e3, 1.61e3),
    (1, 0): (3.04e3, 3.35e3),
    (2, 0): (4.85e3, 5.51e3),
    (0, 1): (5.51e3, 6.29e3),
    (0, 2): (11.85e3, 14.05e3),
}
"""Table 2, by (nodal diameters, nodal circles): the paper's lattice, and its Rayleigh-Ritz column.

The latter is the thin clamped disc with E = 3.30 GPa, nu = 0.25 and a radius of 40 mm. Neither the
paper's E (3.35 GPa) nor the radius of its rings (38 mm) gives these values.
"""

DISORDER_CVS = (0.1, 0.25, 0.5)
"""Coefficients of variation of G_f in the paper's random specimens (Fig. 9, Table 3)."""


@dataclass(frozen=True)
class Specimens:
    """Cracks of several specimens, in order.

    Attributes:
        radial_cracks: their number.
        radial_diameter: d_r, of the circle through the tips, m.
        circular_diameter: d_c, m.
    """

    radial_cracks: tuple[int, ...]
    radial_diameter: tuple[float, ...]
    circular_diameter: tuple[float, ...]


EXPERIMENTS = Specimens(
    (6, 8, 9, 7), (69e-3, 65e-3, 63e-3, 64e-3), (54e-3, 38e-3, 48e-3, 47e-3)
)  # Table 1

TABLE_3 = {
    0.0: Specimens((5,), (58.5e-3,), (42e-3,)),
    0.10: Specimens(
        (4, 6, 5, 6), (55.7e-3, 52.7e-3, 52.3e-3, 56.2e-3), (44e-3, 38e-3, 40e-3, 38e-3)
    ),
    0.25: Specimens(
        (5, 6, 6, 5), (53.6e-3, 54.7e-3, 53.4e-3, 46.8e-3), (46e-3, 42e-3, 42e-3, 32e-3)
    ),
    0.50: Specimens(
        (5, 6, 4, 5), (46.3e-3, 48.8e-3, 47.5e-3, 49.7e-3), (16e-3, 34e-3, 32e-3, 26e-3)
    ),
}
"""Cracks of the paper's model by the coefficient of variation of G_f."""


def is_papers_test(scene: Scene) -> bool:
    """Whether a scene has the plate, striker and speed of the paper's falling-weight test."""
    striker, plate = scene.striker, scene.plate
    if striker is None or plate.shape != "rectangle":
        return False
    if len(scene.strikers) > 1 or striker.mass is None or not striker.guided:
        return False
    has = (*plate.size, striker.diameter, striker.mass, striker.speed)
    test = (92.8e-3, 92.8e-3, 3.2e-3, 12.7e-3, 18.49, 1.065)
    return all(math.isclose(a, b, rel_tol=1e-6) for a, b in zip(has, test, strict=True))
