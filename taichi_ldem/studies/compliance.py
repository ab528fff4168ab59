"""Compliance of notched beams in three-point bending: published, and of the lattice itself.

Published, for any span-to-width ratio beta = S/W of 2.5 and more, E B C as a function of alpha =
a/W in plane stress:

- without a notch: beta^3/4 (1 + 2.85/beta^2 - 0.84/beta^3), which is slender-beam theory with shear
  and the stress concentration under the load (Timoshenko and Goodier, Theory of Elasticity, from
  von Karman and Seewald); for beta = 4 it is the 18.64 of ASTM D5045 (Bakker 1990);
- what the notch adds: the integral of 9/2 beta^2 k^2 over alpha, from G = K^2/E = P^2/(2 B) dC/da
  and K = 3 P S k/(2 B W^1.5);
- k(alpha, beta) = sqrt(alpha)/((1 - alpha)^1.5 (1 + 2 alpha)) (p_inf + (4/beta)(p_4 - p_inf)),
  Guinea, Pastor, Planas, Elices, Int. J. Fracture 89 (1998) 103-116: within 0.5 % for every alpha.

The calibration factor is phi = C/(dC/dalpha), so that the energy stored at the onset of cracking is
U = G B W phi.

The lattice's compliance is that of its bars, assembled without the solver's kernels, under line
loads on single rows of nodes. The local indentation at the three contacts is independent of the
notch: it is the lattice's compliance less the published one, both for the beam without a notch.
"""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from taichi_ldem.model.lattice import Lattice

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = npt.NDArray[np.float64]
Nodes = npt.NDArray[np.int64]


# -- published -------------------------------------------------------------------------------------


def shape_factor(alpha: Array | float, beta: float) -> Array:
    """k = K_I 2 B W^1.5/(3 P S) of a beam with a/W = alpha and S/W = beta >= 2.5."""
    a = np.asarray(alpha, dtype=float)
    b = 1 - a
    p_4 = 1.9 - a * (-0.089 + 0.603 * b - 0.441 * b**2 + 1.223 * b**3)
    p_inf = 1.989 - a * b * (0.448 - 0.458 * b + 1.226 * b**2)
    k: Array = np.sqrt(a) / (b**1.5 * (1 + 2 * a)) * (p_inf + 4 / beta * (p_4 - p_inf))
    return k


def whole_beam(beta: float) -> float:
    """E B C of a beam without a notch."""
    return beta**3 / 4 * (1 + 2.85 / beta**2 - 0.84 / beta**3)


def compliance_slope(alpha: Array | float, beta: float) -> Array:
    """E B dC/dalpha."""
    slope: Array = 4.5 * beta**2 * shape_factor(alpha, beta) ** 2
    return slope


@lru_cache(maxsize=256)
def added_by_notch(alpha: float, beta: float) -> float:
    """E B (C - C(0)) of a notch of a/W = alpha."""
    from scipy.integrate import quad

    return float(quad(lambda a: float(compliance_slope(a, beta)), 0.0, alpha)[0])


def calibration(alpha: float, beta: float) -> float:
    """Calibration factor phi = C/(dC/dalpha)."""
    whole = whole_beam(beta) + added_by_notch(alpha, beta)
    return whole / float(compliance_slope(alpha, beta))


# -- of the lattice --------------------------------------------------------------------------------


def bar_ends(lattice: Lattice, bar: int, present: npt.NDArray[np.bool_]) -> tuple[Nodes, Nodes]:
    """Flat numbers over all nodes of both end nodes of one kind of bar at the sites ``present``."""
    site = np.argwhere(present)
    shape = (lattice.cell.sublattices, *lattice.sites)
    first, second = (
        np.ravel_multi_index((np.full(len(site), s), *(site + offset).T), shape).astype(np.int64)
        for s, offset in lattice.cell.ends[bar]
    )
    return first, second


def stiffness_matrix(
    lattice: Lattice, stiffness: tuple[float, ...], removed: npt.NDArray[np.uint16]
) -> "csr_array[np.float64]":
    """Tangent stiffness at rest over the flat degrees of freedom of all nodes, N/m.

    Args:
        lattice: regular or perturbed: every bar has its own length and direction.
        stiffness: EA of the bar families, N.
        removed: S, one bit a bar cut by a notch.
    """
    from scipy.sparse import coo_array

    weights, cell = lattice.bar_shares(), lattice.cell
    place = lattice.positions().reshape(-1, 3)
    rows, columns, values = [], [], []
    for bar in range(cell.bars):
        share = weights[..., bar] * ((removed >> bar & 1) == 0)
        ends = bar_ends(lattice, bar, share > 0)
        vector = place[ends[1]] - place[ends[0]]
        length = np.linalg.norm(vector, axis=1)
        whole = stiffness[cell.family[bar]] * share[share > 0] / length**3
        block = whole[:, None, None] * vector[:, :, None] * vector[:, None, :]
        for a, b, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
            i, j = np.meshgrid(range(3), range(3), indexing="ij")
            rows.append((3 * ends[a][:, None, None] + i).ravel())
            columns.append((3 * ends[b][:, None, None] + j).ravel())
            values.append(sign * block.ravel())
    size = 3 * cell.sublattices * int(np.prod(lattice.sites))
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return coo_array(entries, shape=(size, size)).tocsr()


def row_of_nodes(lattice: Lattice, x: float, z: float) -> Nodes:
    """Flat numbers of the corner nodes along y that are nearest to (x, z), m."""
    place = lattice.grid()[0]
    exists = lattice.exists()[0]
    off = np.where(exists, np.hypot(place[..., 0] - x, place[..., 2] - z), np.inf)
    return np.flatnonzero(np.abs(off - off.min()) < 1e-6 * lattice.spacing)


def lattice_compliance(
    lattice: Lattice,
    stiffness: tuple[float, ...],
    removed: npt.NDArray[np.uint16],
    span: float,
) -> float:
    """Deflection under the load over load of a beam on two rows of nodes, m/N.

    The load is a line at mid-span on the upper face; every row moves as one, as under a rigid
    cylinder. Bars are elastic, displacements small.
    """
    from scipy.sparse.linalg import LinearOperator, cg

    matrix = stiffness_matrix(lattice, stiffness, removed)
    height = lattice.modules[2] * lattice.spacing
    load = row_of_nodes(lattice, 0.0, height)
    held = np.concatenate([row_of_nodes(lattice, side * span / 2, 0.0) for side in (-1, 1)])
    diagonal = matrix.diagonal()
    free = diagonal > 0
    free[3 * np.concatenate([load, held]) + 2] = False
    prescribed = np.zeros(len(free))
    prescribed[3 * load + 2] = -1.0
    inner = matrix[free][:, free]
    scale = LinearOperator(inner.shape, matvec=lambda r: r / diagonal[free])
    # without rigid motions along x, y or about z, which no load excites
    solution, code = cg(
        inner, -np.asarray(matrix @ prescribed)[free], rtol=1e-6, maxiter=20_000, M=scale
    )
    assert code == 0
    prescribed[free] = solution
    return float(-1.0 / np.asarray(matrix @ prescribed)[3 * load + 2].sum())
