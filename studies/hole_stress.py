"""Stress beside a round hole in a strip under tension, on the lattice, against Howland's.

    python -m studies.hole_stress [--diameters 10 20 40] [--share 0.2] [--layers 2]

The strip is pulled along x at its ends. The lattice is solved at rest, with small displacements. At
the free edge of the hole the stress is uniaxial, so it is E times the strain along the edge; where
the hole is widest, that is the strain of the bars along x. Stresses are divided by the force over
the strip's whole section. The reference is R. C. J. Howland's (1930) in the form of Peterson's
Stress Concentration Factors: K_n = 2 + 0.284 a - 0.600 a^2 + 1.32 a^3 on the net section, with a =
1 - d / W; in a wide plate it is Kirsch's 3.
"""

from argparse import ArgumentParser
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import Scene, parse_scene
from taichi_ldem.solver.build import build_lattice
from taichi_ldem.studies.compliance import stiffness_matrix

EDGE = 0.5e-3
PMMA = {"youngs_modulus": 3.35e9, "poisson_ratio": 0.25, "density": 1190.0, "damage": False}
LONG = 2.0
"""Length of the strip over its width."""


def howland(share: float) -> float:
    """Largest stress over the force on the whole section, for a hole of a share of the width."""
    a = 1 - share
    return (2 + 0.284 * a - 0.600 * a**2 + 1.32 * a**3) / a


def scene_of(diameter: int, share: float, layers: int) -> Scene:
    """A strip with a hole of a diameter in modules."""
    width = 2 * round(diameter / share / 2)
    size = [2 * round(LONG * width / 2) * EDGE, width * EDGE, layers * EDGE]
    plate = {"size": size, "modules_through_thickness": layers}
    hole = {"shape": "circle", "diameter": diameter * EDGE}
    return parse_scene({"scenario": "modes", "plate": plate, "hole": [hole], "material": PMMA})


def stretched(lattice: Lattice, scene: Scene) -> tuple[npt.NDArray[np.float64], float]:
    """Displacements (sublattices, *S, 3) of a strip whose ends part by 1 m, and the force, N."""
    from scipy.sparse.linalg import LinearOperator, cg

    bars = mat.bars_of(scene)
    none = np.zeros(lattice.sites, dtype=np.uint16)
    matrix = stiffness_matrix(lattice, tuple(bar.axial_stiffness for bar in bars), none)
    place, half = lattice.grid(), lattice.modules[0] * lattice.spacing / 2
    ends = lattice.exists() & (np.abs(place[..., 0]) > half - 1e-6 * lattice.spacing)
    known = np.zeros((*ends.shape, 3), dtype=bool)
    known[..., 0] = ends
    given = np.where(known, np.sign(place) / 2, 0.0).ravel()
    diagonal = matrix.diagonal()
    free = (diagonal > 0) & ~known.ravel()
    inner = matrix[free][:, free]
    scale = LinearOperator(inner.shape, matvec=lambda r: r / diagonal[free])
    right = -np.asarray(matrix @ given)[free]
    start = np.zeros((*ends.shape, 3))
    start[..., 0] = place[..., 0] / (2 * half)
    solution, code = cg(inner, right, start.ravel()[free], rtol=1e-7, maxiter=20_000, M=scale)
    assert code == 0
    given[free] = solution
    pull = np.asarray(matrix @ given).reshape(*ends.shape, 3)
    return given.reshape(*ends.shape, 3), float(pull[..., 0][place[..., 0] > 0].clip(0).sum())


def concentration(diameter: int, share: float, layers: int) -> tuple[float, float]:
    """Largest stress along x over that of the whole section, and the same a module further out.

    Args:
        diameter: of the hole, modules. share: of the width.
    """
    scene = scene_of(diameter, share, layers)
    lattice = build_lattice(scene)
    u, force = stretched(lattice, scene)
    _, ny, _ = lattice.modules
    section = ny * layers * lattice.spacing**2
    strain = (u[0, ..., 1:, 0] - u[0, ..., :-1, 0]) / lattice.spacing
    exists = lattice.bar_exists()[..., :-1, 0]
    strain = np.where(exists, strain, np.nan)
    middle, column = ny // 2 + 1, lattice.modules[0] // 2  # of sites; bars on both sides of x = 0
    edge = middle + int(np.nonzero(lattice.mask[0, ny // 2 :, lattice.modules[0] // 2])[0][0])
    near = strain[1 : layers + 2, edge : edge + 2, column : column + 2]
    stress = scene.material.youngs_modulus * np.nanmean(near, axis=(0, 2)) / (force / section)
    return float(stress[0]), float(stress[1])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--diameters", type=int, nargs="+", default=[10, 20, 40])
    parser.add_argument("--share", type=float, default=0.2, help="of the width")
    parser.add_argument("--layers", type=int, default=2, help="modules through the thickness")
    options = parser.parse_args(arguments)
    exact = howland(options.share)
    print(f"Howland, d / W = {options.share:g}: {exact:.3f}; on the edge and one module off it")
    for diameter in options.diameters:
        edge, off = concentration(diameter, options.share, options.layers)
        print(
            f"{diameter} modules: {edge:.3f} ({100 * (edge / exact - 1):+.1f} %), {off:.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
