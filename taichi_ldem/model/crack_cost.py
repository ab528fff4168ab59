"""What a crack costs in the lattice, over the fracture energy that a scene gives.

The bars of a flat cut dissipate G_f per area. A crack costs more: the bar at its tip has to reach
its peak strain, for which the lattice must be loaded beyond G_f, and the excess that is released
goes into damage next to the crack and into waves. Notched strips (``ldem study toughness``) show
the cost as a function of L / l_ch, the module edge over the characteristic length l_ch = E G_f /
(E eps_p)^2, for each direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichi_ldem.model.material import characteristic_length
from taichi_ldem.scene import Scene

MEASURED_RATIO = 0.25
"""Poisson's ratio of the strips. Another one changes the stiffness of the diagonals."""

RESOLVED = 1.1
"""G_c / G_f up to which a scene counts as resolving its cracks."""

NEAR = 0.05
"""Largest difference in Poisson's ratio for which the measured costs are given."""


SIZES = (0.0, 0.132, 0.264, 0.528)
"""L / l_ch of the strips; 0 is the continuum, where a crack costs G_f."""

AXIS = (1.0, 1.49, 1.87, 3.23)
"""G_c / G_f of a running crack in a plane (100), at ``SIZES`` (docs/tension.md)."""

DIAGONAL = (1.0, 1.19, 1.29, 2.79)
"""G_c / G_f of a running crack in a plane (110), at ``SIZES``."""

COARSEST = 0.7
"""L / l_ch from which on bars cannot soften; up to there the costs are continued in a line."""


AT_TIPS = {"module": (0.95, 1.38), "cubic-26": (0.82, 1.15)}
"""Least and largest G_c / G_f with ``fracture = "crack"`` by lattice, of all directions; those of
the paper's module are of all module sizes, too."""

AT_TIP_STRAINS = {"module": (0.94, 1.10), "cubic-26": (0.99, 1.10)}
"""The same with ``tip_criterion = "strain"``, mean of four strips in each direction with modules of
0.533 mm and a perturbation of 0.07 (docs/tension.md)."""


@dataclass(frozen=True)
class CrackCost:
    """What running cracks cost over G_f.

    Attributes:
        axis, diagonal: cost of a crack in a plane (100), (110).
        resolved: module edge below which both are within 10 % of 1, m.
    """

    axis: float
    diagonal: float
    resolved: float

    def __str__(self) -> str:
        """The cost in words."""
        return (
            f"{self.diagonal:.1f} to {self.axis:.1f} G_f (along a diagonal, along an axis of the "
            f"lattice); within 10 % of G_f below L = {1e3 * self.resolved:.2g} mm"
        )


def words(scene: Scene) -> str | None:
    """What a crack costs in a scene, in words; None where that has not been measured."""
    if scene.material.damage and scene.material.fracture == "crack":
        if scene.material.tip_criterion == "strain":
            least, most = AT_TIP_STRAINS[scene.plate.lattice]
            return (
                f"{least:.2f} to {most:.2f} G_f, by its direction in the lattice (measured with "
                "plate.perturbation = 0.07)"
            )
        least, most = AT_TIPS[scene.plate.lattice]
        return f"{least:g} to {most:g} G_f, by its direction in the lattice"
    cost = crack_cost(scene)
    return None if cost is None else str(cost)


def crack_cost(scene: Scene) -> CrackCost | None:
    """What a crack costs in a scene of the paper's law; None where that has not been measured.

    It has for bilinear bars of the paper's lattice whose limit strain follows from G_f by Eq. (12),
    near nu = 1/4.
    """
    m = scene.material
    measured = m.damage and m.limit_strain is None and m.law == "bilinear"
    measured &= m.fracture == "bar" and scene.plate.lattice == "module"
    if not measured or abs(m.poisson_ratio - MEASURED_RATIO) > NEAR:
        return None
    length = characteristic_length(m)
    ratio = scene.plate.spacing / length
    resolved = float(np.interp(RESOLVED, AXIS, SIZES)) * length
    return CrackCost(_cost(AXIS, ratio), _cost(DIAGONAL, ratio), resolved)


def _cost(costs: Sequence[float], ratio: float) -> float:
    """The cost at L / l_ch, in a straight line between the strips."""
    slope = (costs[-1] - costs[-2]) / (SIZES[-1] - SIZES[-2])
    beyond = costs[-1] + slope * (COARSEST - SIZES[-1])
    return float(np.interp(ratio, (*SIZES, COARSEST), (*costs, beyond)))
