"""Elasticity over Poisson's ratio: modules with a volume beside bars alone (Eq. (2)).

    python -m studies.poisson [--modules 8] [--length 24] [--ratios 0 0.1 ...]

For each ratio it prints C11, C12 and C44 of the infinite lattice over those of the isotropic solid,
the speeds of its long waves along [100] over the solid's, and its critical time step. Then come a
square bar's critical time step, and its E and nu when it is pulled at its ends and at rest. They
follow by conjugate gradients on the forces of the step's own kernels, at strains so small that the
kernels respond linearly.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from taichi_ldem.model import material as mat
from taichi_ldem.model.waves import bulk
from taichi_ldem.scene import Material, Scene, Solver, parse_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

Array = npt.NDArray[np.float64]

RATIOS = (0.0, 0.1, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.49)
SPACING, MODULUS, DENSITY = 0.5e-3, 3.35e9, 1190.0  # PMMA
STRAIN = 1e-7


@dataclass(frozen=True)
class Row:
    """Numbers of one ratio and stiffness, over the solid's where that has one.

    Attributes:
        constants: C11, C12, C44 over the solid's; C12 over its C11, as it is zero at nu = 0.
        speeds: of longitudinal and shear waves along [100] over the solid's.
        steps: critical time steps of the infinite lattice and of the bar, s.
        modulus: E of the pulled bar over the solid's. ratio: its nu.
    """

    constants: tuple[float, float, float]
    speeds: tuple[float, float]
    steps: tuple[float, float]
    modulus: float
    ratio: float


def solid(ratio: float) -> tuple[float, float, float]:
    """C11, C12, C44 of the isotropic solid, Pa (Hooke's law)."""
    shear = MODULUS / (2 * (1 + ratio))
    lame = 2 * shear * ratio / (1 - 2 * ratio)
    return lame + 2 * shear, lame, shear


def bar_scene(modules: int, length: int, ratio: float, stiffness: str) -> Scene:
    """A free elastic square bar along x."""
    return parse_scene(
        {
            "scenario": "impact",  # the default solver, without a striker
            "plate": {
                "size": [length * SPACING, modules * SPACING, modules * SPACING],
                "modules_through_thickness": modules,
                "stiffness": stiffness,
            },
            "material": {
                "youngs_modulus": MODULUS,
                "poisson_ratio": ratio,
                "density": DENSITY,
                "damage": False,
            },
            "solver": {"duration": 1e-3},
        }
    )


def pulled(simulation: "Simulation") -> tuple[float, float]:
    """E over the material's, and nu, of the simulation's bar under a pull on its end faces.

    Both are those of its middle third: the mean axial strain and that of the surface across.
    """
    from scipy.sparse.linalg import LinearOperator, cg

    dynamics = simulation.dynamics
    lattice = dynamics.lattice
    exists = np.broadcast_to(lattice.exists()[..., None], (*lattice.exists().shape, 3))
    free = exists.copy()
    x = lattice.positions()[..., 0]
    ends = exists[..., 0] & (np.abs(np.abs(x) - np.abs(x[exists[..., 0]]).max()) < 1e-9)
    free[ends, 0] = False
    start = np.zeros(exists.shape)
    start[..., 0] = STRAIN * x * exists[..., 0]

    def opposed(unknown: Array) -> Array:
        """The lattice's force against a displacement of any size, without its non-linear part."""
        size = STRAIN * SPACING / max(float(np.abs(unknown).max()), np.finfo(float).tiny)
        field = np.zeros(exists.shape)
        field[free] = size * unknown
        dynamics.set_displacement(0, field)
        return np.asarray(-dynamics.get_force(0)[free] / size)

    dynamics.set_displacement(0, start)
    load = dynamics.get_force(0)[free]
    stiffness = LinearOperator((load.size, load.size), matvec=opposed)
    moved, fault = cg(stiffness, load, rtol=1e-9, maxiter=20 * round(load.size**0.5))
    if fault:
        raise RuntimeError(f"conjugate gradients did not end within {fault} steps")
    field = start.copy()
    field[free] += moved
    dynamics.set_displacement(0, field)
    pull = dynamics.get_force(0)[..., 0][ends & (x > 0)].sum()
    place = lattice.positions()[0]
    middle = exists[0, ..., 0] & (np.abs(place[..., 0]) < np.abs(x[ends]).max() / 3)
    along = np.polyfit(place[middle][:, 0], field[0][middle][:, 0], 1)[0]
    across = np.polyfit(place[middle][:, 1], field[0][middle][:, 1], 1)[0]
    area = (lattice.modules[1] * lattice.spacing) ** 2
    return float(-pull / area / along / MODULUS), float(-across / along)


def measure(simulation: "Simulation", modules: int, length: int, ratio: float) -> Row:
    """The numbers of the simulation's stiffness at a ratio."""
    stiffness = simulation.scene.plate.stiffness
    simulation.reset(bar_scene(modules, length, ratio, stiffness))
    c11, c12, c44 = solid(ratio)
    mine = mat.elastic_constants(MODULUS, ratio, stiffness)
    constants = (mine[0] / c11, (mine[1] - c12) / c11, mine[2] / c44)
    material = Material(youngs_modulus=MODULUS, poisson_ratio=ratio, density=DENSITY, damage=False)
    lattice = bulk(material, SPACING, stiffness)
    k = 1e-3 / SPACING
    waves = np.sqrt(lattice.every_branch([k, 0.0, 0.0])[:3]) / k
    speeds = (waves[2] / np.sqrt(c11 / DENSITY), waves[0] / np.sqrt(c44 / DENSITY))
    modulus, found = pulled(simulation)
    steps = 2 / lattice.highest_frequency, simulation.critical_time_step
    return Row(constants, speeds, steps, modulus, found)


def line(ratio: float, stiffness: str, row: Row) -> str:
    """A row of the table."""
    c11, c12, c44 = row.constants
    cells = [
        f"{ratio:g}",
        stiffness,
        *(f"{value:.6f}" for value in (c11, c44)),
        f"{c12:+.1e}",
        *(f"{value:.4f}" for value in row.speeds),
        *(f"{step * 1e9:.1f}" for step in row.steps),
        f"{row.modulus:.4f}",
        f"{row.ratio:.4f}",
    ]
    return f"| {' | '.join(cells)} |"


HEAD = (
    "| nu | stiffness | C11 | C44 | C12 - solid's over C11 | P wave | S wave | critical step [ns] "
    "| of the bar | E | nu of the bar |\n" + "|---" * 11 + "|"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--modules", type=int, default=8, help="through the bar's sides")
    parser.add_argument("--length", type=int, default=24, help="modules along the bar")
    parser.add_argument("--ratios", type=float, nargs="+", default=RATIOS)
    options = parser.parse_args(arguments)
    from taichi_ldem.solver import backend

    backend.start(Solver(duration=1.0))
    from taichi_ldem.solver.simulation import Simulation

    print(HEAD)
    for stiffness in ("volumetric", "equation-2"):
        scene = bar_scene(options.modules, options.length, 0.25, stiffness)
        simulation = Simulation(scene)
        for ratio in options.ratios:
            if ratio > 0 or stiffness == "volumetric":
                row = measure(simulation, options.modules, options.length, ratio)
                print(line(ratio, stiffness, row), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
