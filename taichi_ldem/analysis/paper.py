"""What the paper and its experiments found in the falling-weight test: the one place for it.

Its text and Figs. 5, 11 to 16, Tables 1 and 3. SI units.
"""

import math
from dataclasses import dataclass

from taichi_ldem.scene import Scene

# The experiments: first peak, box of the second peak and failure, time of the largest velocity.
P1_N, T1_S = 600.0, 1.75e-3
P2_N, T2_S = (600.0, 830.0), (6.4e-3, 9.4e-3)
V_MAX_S = 0.8e-3
T2_LDEM_S = 7.5e-3  # the paper's model


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
"""The paper's model by CV(G_f)."""


def is_papers_test(scene: Scene) -> bool:
    """Whether a scene has the plate, striker and speed of the paper's test."""
    striker, plate = scene.striker, scene.plate
    if striker is None or plate.shape != "rectangle":
        return False
    has = (*plate.size, striker.diameter, striker.mass, striker.velocity)
    test = (92.8e-3, 92.8e-3, 3.2e-3, 12.7e-3, 18.49, 1.065)
    return all(math.isclose(a, b, rel_tol=1e-6) for a, b in zip(has, test, strict=True))
