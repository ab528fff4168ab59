"""A bar in tension by a static solve of the lattice, bar by bar."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve
from support.reference import Body

from taichi_ldem.model.lattice import prism


def tension_of_a_prism(
    width: int, stiffness: tuple[float, float], height: int = 0, surface_weights: bool = True
) -> tuple[float, float]:
    """E and nu of an infinite prism of width x height modules along x, by a static solve.

    One slice of modules with periodic ends: strain one along x, lateral faces free.
    """
    height = height or width
    body = Body(prism(3, width, height), surface_weights=surface_weights)
    first = body.places[body.ends].min(axis=1)[:, 0]
    slice_ = (first >= 2) & (first < 4)
    ends, along = body.ends[slice_], (body.rest / body.lengths[:, None])[slice_]
    section = body.places * [0, 1, 1] + [1, 0, 0] * (body.places % 2)
    nodes, fold = np.unique(section, axis=0, return_inverse=True)
    offset = 0.5 * (body.places - section)[:, 0]  # in whole modules along x
    rows = np.repeat(np.arange(len(ends)), 3)

    def operator(end: int) -> sparse.csr_matrix:
        columns = (3 * fold[ends[:, end]][:, None] + np.arange(3)).ravel()
        return sparse.csr_matrix(
            (along.ravel(), (rows, columns)), shape=(len(ends), 3 * len(nodes))
        )

    stretch = operator(1) - operator(0)
    given = along[:, 0] * (offset[ends[:, 1]] - offset[ends[:, 0]])
    springs = sparse.diags((body.weights * body.per_bar(*stiffness) / body.lengths)[slice_])
    matrix, load = (stretch.T @ springs @ stretch).tocsc(), -(stretch.T @ springs @ given)
    at = {tuple(p): n for n, p in enumerate(nodes.tolist())}
    origin, aside = at[0, 0, 0], at[0, 2 * width, 0]
    held = [3 * origin, 3 * origin + 1, 3 * origin + 2, 3 * aside + 2]  # rigid motions
    free = np.setdiff1d(np.arange(3 * len(nodes)), held)
    moved = np.zeros(3 * len(nodes))
    moved[free] = spsolve(matrix[free][:, free], load[free])
    energy = 0.5 * np.sum(springs.diagonal() * (stretch @ moved + given) ** 2)
    left, right = (
        np.mean([moved[3 * n + 1] for p, n in at.items() if p[:2] == (0, side)])
        for side in (0, 2 * width)
    )
    return 2 * float(energy) / (width * height), -float(right - left) / width
