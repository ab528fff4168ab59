"""Effect of perturbed node positions on the elastic constants of the lattice.

    python -m studies.perturbation [--modules 8 --seeds 4]

Periodic cells of perturbed modules under a uniform strain: C11, C12, C44 over those of the regular
lattice, means over seeds and axes; Poisson's ratio in uniaxial stress; 2 C44 / (C11 - C12); and the
smallest critical time step of free cubes over the regular one's. Prints a table. Bars are assembled
without the solver's kernels.
"""

import argparse
import itertools

import numpy as np
import numpy.typing as npt

from taichi_ldem.model import material as mat
from taichi_ldem.model.cell import MODULE
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.studies.compliance import stiffness_matrix

Array = npt.NDArray[np.float64]

NU = 0.25
SHARES = (0.0, 0.02, 0.05, 0.1, 0.2)


def _cube(modules: int, share: float, seed: int) -> Lattice:
    return Lattice(prism(modules, modules, modules), 1.0, perturbation=share, seed=seed)


def constants(modules: int, share: float, seed: int) -> tuple[float, float, float]:
    """C11, C12, C44 over E of a periodic cell of modules, means over the three axes or planes.

    Every node is free: the motion is a uniform strain plus a periodic motion in equilibrium.
    """
    from scipy.sparse import csr_array, diags_array
    from scipy.sparse.linalg import splu

    offsets = _cube(modules + 2, share, seed).offsets
    inner = slice(2, 2 + modules)  # sites without a face
    shift = np.zeros((2, *[modules] * 3, 3)) if offsets is None else offsets[:, inner, inner, inner]
    shift = shift.reshape(-1, 3)
    number = np.arange(2 * modules**3).reshape(2, *[modules] * 3)
    ends, vectors = [], []
    for ((start, _), (end, step)), vector in zip(MODULE.ends, MODULE.vectors, strict=True):
        first = number[start].ravel()
        second = np.roll(number[end], [-n for n in step], (0, 1, 2)).ravel()
        ends.append(np.stack([first, second]))
        vectors.append(vector + shift[second] - shift[first])
    (first, second), vector = np.concatenate(ends, axis=1), np.concatenate(vectors)
    length = np.linalg.norm(vector, axis=1)
    unit = vector / length[:, None]
    pull = np.repeat(mat.axial_stiffness(1.0, NU, 1.0), [6 * modules**3, 8 * modules**3])
    row = np.repeat(np.arange(len(length)), 6)
    column = 3 * np.stack([first, second], axis=1)[:, :, None] + np.arange(3)
    entries = np.stack([-unit, unit], axis=1) / length[:, None, None]
    strain_of = csr_array((entries.ravel(), (row, column.ravel())))[:, 3:]  # one node is held
    back = strain_of.T @ diags_array(pull * length)
    solver = splu((back @ strain_of).tocsc())

    def energy(strain: Array) -> float:
        given = np.einsum("bi,ij,bj->b", unit, strain, unit)
        left = given - strain_of @ solver.solve(back @ given)
        return float(pull * length @ left**2) / (2 * modules**3)

    axes = np.eye(3)
    one = np.mean([2 * energy(np.diag(axis)) for axis in axes])
    pairs = list(itertools.combinations(axes, 2))
    two = np.mean([energy(np.diag(a + b)) for a, b in pairs])
    shear = np.mean([2 * energy((np.outer(a, b) + np.outer(b, a)) / 2) for a, b in pairs])
    return float(one), float(two - one), float(shear)


def critical_time_step(modules: int, share: float, seed: int) -> float:
    """2 / omega_max of a free cube with E = rho = L = 1."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import eigsh

    lattice = _cube(modules, share, seed)
    stiffness = mat.axial_stiffness(1.0, NU, 1.0)
    matrix = stiffness_matrix(lattice, stiffness, np.zeros(lattice.sites, dtype=np.uint16))
    mass = np.repeat(np.moveaxis(MODULE.node_shares[lattice.code], -1, 0).ravel(), 3)
    scale = diags_array(1 / np.sqrt(mass[mass > 0]))
    there = mass > 0
    scaled = scale @ matrix[there][:, there] @ scale
    value = eigsh(scaled, k=1, which="LA", return_eigenvectors=False, tol=1e-6)
    return float(2 / np.sqrt(value[0]))


def table(modules: int, seeds: int) -> str:
    """The study as a Markdown table."""
    regular = np.array(constants(modules, 0.0, 0))
    step = critical_time_step(modules, 0.0, 0)
    lines = [
        "| perturbation | C11 | C12 | C44 | nu | 2 C44/(C11 - C12) | critical step |",
        "|---|---|---|---|---|---|---|",
    ]
    for share in SHARES:
        found = np.array([constants(modules, share, seed) for seed in range(seeds)])
        c11, c12, c44 = found.mean(axis=0)
        spread = (found / regular).std(axis=0).max()
        steps = [critical_time_step(modules, share, seed) / step for seed in range(seeds)]
        ratios = " | ".join(f"{value:.4f}" for value in found.mean(axis=0) / regular)
        lines.append(
            f"| {share:g} | {ratios} (+- {spread:.4f}) | {c12 / (c11 + c12):.4f} | "
            f"{2 * c44 / (c11 - c12):.4f} | {min(steps):.3f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--modules", type=int, default=8)
    parser.add_argument("--seeds", type=int, default=4)
    options = parser.parse_args()
    print(table(options.modules, options.seeds))


if __name__ == "__main__":
    main()
