"""Force over indentation of runs, against Hertz (``python -m studies.indentation RUN...``).

A rigid sphere on an elastic half-space has F = 4/3 E/(1 - nu^2) sqrt(R) d^1.5 (Hertz 1882; Johnson,
Contact Mechanics, 1985, Eq. 4.23). A block of height h on a frictionless floor is stiffer, by the
series in sqrt(R d) / h of Dimitriadis et al. (Biophys. J. 82, 2002, p. 2798), Eq. 12, for a layer
that is not bonded.
"""

import math
import sys
from pathlib import Path

import numpy as np

from taichi_ldem.analysis.signals import smooth_force
from taichi_ldem.storage.folder import RunFolder

WINDOW = 2e-5
"""Time over which the force is averaged, s: twice that of a wave through the block and back."""

MODULES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Modules in the contact radius at which the force is printed."""


def layer(slenderness: float, poisson_ratio: float) -> float:
    """Force on a layer on a frictionless floor over that on a half-space.

    Args:
        slenderness: sqrt(R d) over the layer's height.
    """
    nu, x = poisson_ratio, slenderness / math.pi
    a = -0.347 * (3 - 2 * nu) / (1 - nu)
    b = 0.056 * (5 - 2 * nu) / (1 - nu)
    return (
        1
        - 2 * a * x
        + 4 * a**2 * x**2
        - 8 * (a**3 + 4 * math.pi**2 / 15 * b) * x**3
        + 16 * a * (a**3 + 3 * math.pi**2 / 5 * b) * x**4
    )


def show(run: Path) -> None:
    """Print the force of a run at some depths, over Hertz and over the layer's."""
    folder = RunFolder.open(run)
    scene, history = folder.read_scene(), folder.read_history()
    (striker,), m, height = scene.strikers, scene.material, scene.plate.size[2]
    depth = np.maximum(history["striker_displacement_m"] - striker.gap, 0.0)
    force = smooth_force(history["time_s"], history["striker_force_n"], WINDOW)
    radius, stiffness = striker.diameter / 2, m.youngs_modulus / (1 - m.poisson_ratio**2)
    contact = np.sqrt(radius * depth)
    for wanted in MODULES:
        at = int(np.argmin(np.abs(contact / scene.plate.spacing - wanted)))
        found = contact[at] / scene.plate.spacing
        if abs(found - wanted) > 0.05:
            continue
        hertz = 4 / 3 * stiffness * math.sqrt(radius) * depth[at] ** 1.5
        thick = layer(contact[at] / height, m.poisson_ratio)
        print(
            f"| {scene.plate.modules_through_thickness} | {found:.2f} | {1e6 * depth[at]:.2f} | "
            f"{force[at]:.2f} | {force[at] / hertz:.3f} | {thick:.3f} | "
            f"{100 * (force[at] / hertz / thick - 1):+.1f} % |"
        )


def main(runs: list[str]) -> int:
    """Print a table of all runs."""
    print(
        "| modules in the height | in the contact radius | depth [um] | force [N] | over Hertz | "
        "layer over Hertz | force against the layer |\n|---|---|---|---|---|---|---|"
    )
    for run in runs:
        show(Path(run))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
