"""Force over indentation of a run against Hertz: python -m studies.indentation RUN

A rigid sphere on an elastic half-space has F = 4/3 E/(1 - nu^2) sqrt(R) d^1.5 (Hertz 1882; Johnson,
Contact Mechanics, 1985, Eq. 4.23). A block is no half-space: it gives way as a whole, in proportion
to F. So d = k F^(2/3) + c F, whose k is that of the half-space and whose c is the block's, is
fitted to the run, too.
"""

import sys
from pathlib import Path

import numpy as np

from taichi_ldem.analysis.signals import smooth_force
from taichi_ldem.storage.folder import RunFolder

WINDOW = 2e-5
"""Time over which the force is averaged, s: twice that of a wave through the block and back."""


def main(run: str) -> int:
    """Print the force over that of Hertz at several depths, and the fit's stiffness."""
    folder = RunFolder(Path(run))
    scene, history = folder.read_scene(), folder.read_history()
    (striker,), m = scene.strikers, scene.material
    depth = history["striker_displacement_m"] - striker.gap
    force = smooth_force(history["time_s"], history["striker_force_n"], WINDOW)
    radius, stiffness = striker.diameter / 2, m.youngs_modulus / (1 - m.poisson_ratio**2)
    hertz = 4 / 3 * stiffness * np.sqrt(radius) * np.maximum(depth, 0.0) ** 1.5
    modules = np.sqrt(radius * np.maximum(depth, 0.0)) / scene.plate.spacing
    print("modules in the contact radius | depth [um] | force [N] | force over Hertz")
    for wanted in np.arange(1.0, modules[-1] + 0.01, 0.5):
        at = int(np.argmin(np.abs(modules - wanted)))
        print(
            f"{modules[at]:.2f} | {1e6 * depth[at]:.2f} | {force[at]:.3f} | "
            f"{force[at] / hertz[at]:.4f}"
        )
    for least in (1.0, 2.0):
        chosen = (modules >= least) & (history["time_s"] < history["time_s"][-1] - WINDOW)
        terms = np.stack([force[chosen] ** (2 / 3), force[chosen]], axis=1)
        (k, c), *_ = np.linalg.lstsq(terms, depth[chosen], rcond=None)
        fitted = 3 / (4 * np.sqrt(radius)) * k**-1.5
        print(
            f"from {least:g} modules on: E/(1 - nu^2) of the fit over the material's "
            f"{fitted / stiffness:.4f}, block {c:.4g} m/N"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
