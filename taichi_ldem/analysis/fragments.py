"""Pieces of a cracked plate: the nodes that intact bars join, with their mass, motion and size.

A bar joins its two nodes until it fails or a notch removes it; one that has failed does not join
them, even where it still carries compression. A node that no bar joins to another is debris.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.model.lattice import Lattice

Array = NDArray[np.float64]
Labels = NDArray[np.int32]

DEBRIS, NOTHING = 0, -1
"""In place of the number of a piece: for nodes without an intact bar, and where there is no node.
"""


def labels_of(lattice: Lattice, failed: NDArray[np.integer[Any]]) -> Labels:
    """(sublattices, *S) the number of each node's piece: 1 for the largest by volume, and so on.

    Pieces of one volume are in the order of their first nodes. Debris has the number DEBRIS.

    Args:
        failed: (*S) a bit for each bar of a site that has failed or was removed.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    exists = lattice.exists()
    number = np.cumsum(exists.ravel(), dtype=np.int32) - 1
    count = int(exists.sum())
    ends = _joined(lattice, failed, number)
    graph = coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(count, count))
    pieces, piece = connected_components(graph.tocsr(), directed=False)
    nodes, volume = np.bincount(piece), np.bincount(piece, weights=_volumes(lattice)[exists])
    # components are numbered by their first nodes, and a stable sort keeps that order in ties; the
    # rounding of sums must not make one of two like pieces the larger one
    shares = np.rint(volume / lattice.spacing**3 * 1e6)
    order = np.argsort(np.where(nodes > 1, -shares, 1.0), kind="stable")
    rank = np.empty(pieces, dtype=np.int32)
    rank[order] = np.arange(1, pieces + 1)
    rank[nodes == 1] = DEBRIS
    labels = np.full(exists.shape, NOTHING, dtype=np.int32)
    labels[exists] = rank[piece]
    return labels


def _joined(
    lattice: Lattice, failed: NDArray[np.integer[Any]], number: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """The numbers of the nodes at both ends of every intact bar."""
    cell, (_, ny, nx) = lattice.cell, lattice.sites
    sites = lattice.code.size
    code, bits = lattice.code.ravel(), failed.ravel()
    first: list[NDArray[np.int32]] = []
    second: list[NDArray[np.int32]] = []
    for bar, both in enumerate(cell.ends):
        home = np.flatnonzero((cell.shares[:, bar] > 0)[code] & ((bits >> bar) & 1 == 0))
        for found, (sublattice, (dz, dy, dx)) in zip((first, second), both, strict=True):
            found.append(number[home + (sublattice * sites + (dz * ny + dy) * nx + dx)])
    return np.concatenate(first), np.concatenate(second)


def _volumes(lattice: Lattice) -> Array:
    """(sublattices, *S) volume that belongs to each node, m3."""
    shares = lattice.cell.node_shares[lattice.code] * lattice.spacing**3
    return np.asarray(np.moveaxis(shares, -1, 0))


def of_modules(lattice: Lattice, labels: Labels) -> Labels:
    """(modules,) the piece that most nodes of a module belong to, in the order of the mask's sites.

    The larger piece where there are several such, and debris only where there is nothing else.
    """
    nz, ny, nx = lattice.mask.shape
    own = [
        labels[0, 1 + dz : 1 + dz + nz, 1 + dy : 1 + dy + ny, 1 + dx : 1 + dx + nx][lattice.mask]
        for dz, dy, dx in np.ndindex(2, 2, 2)
    ]
    own += [part[1:-2, 1:-2, 1:-2][lattice.mask] for part in labels[1:]]
    last = np.iinfo(np.int32).max
    best = np.full(len(own[0]), last, dtype=np.int32)
    most = np.zeros(len(best), dtype=np.int8)
    for mine in own:
        alike = np.array(sum((mine == other).astype(np.int8) for other in own))
        alike[mine == DEBRIS] = 0
        candidate = np.where(mine == DEBRIS, last, mine)
        better = (alike > most) | ((alike == most) & (candidate < best))
        best, most = np.where(better, candidate, best), np.where(better, alike, most)
    return np.where(best == last, DEBRIS, best).astype(np.int32)


@dataclass(frozen=True)
class Pieces:
    """All pieces at one time, debris together in the first place if there is any.

    Attributes:
        number: (n,) as in ``labels_of``.
        nodes: (n,) how many each has.
        volume: (n,) at rest, m3. mass: (n,) kg.
        centre, velocity: (n, 3) of the centre of mass, m and m/s.
        extent: (n, 3) of the box around its nodes at rest, along x, y and z, m; 0 for debris.
        edge: of a module, m.
    """

    number: Labels
    nodes: NDArray[np.int64]
    volume: Array
    mass: Array
    centre: Array
    velocity: Array
    extent: Array
    edge: float

    @property
    def momentum(self) -> Array:
        """(n, 3) kg m/s."""
        return self.mass[:, None] * self.velocity

    @property
    def diameter(self) -> Array:
        """(n,) of the sphere of a piece's volume, m; for debris, of a node's mean volume."""
        each = np.where(self.number == DEBRIS, self.volume / self.nodes, self.volume)
        return np.cbrt(6 * each / np.pi)

    def summary(self) -> dict[str, float | int]:
        """Numbers for the summary of a run."""
        whole = self.number != DEBRIS
        total = float(self.mass.sum())
        return {
            "fragments": int(whole.sum()),
            "fragments_above_10_modules": int((self.volume[whole] > 10 * self.edge**3).sum()),
            "largest_fragment_mass_share": float(self.mass[whole].max(initial=0.0)) / total,
            "debris_mass_share": float(self.mass[~whole].sum()) / total,
        }


def pieces_of(
    lattice: Lattice, labels: Labels, masses: Array, displacement: Array, velocity: Array
) -> Pieces:
    """What belongs to each piece.

    Args:
        masses: (sublattices, *S), kg. displacement, velocity: (sublattices, *S, 3), m and m/s.
    """
    exists = labels != NOTHING
    rest, mass = lattice.positions()[exists], masses[exists]
    present, label, nodes = np.unique(labels[exists], return_inverse=True, return_counts=True)

    def total(values: Array) -> Array:
        return np.asarray(np.bincount(label, values, len(present)), dtype=np.float64)

    def mean(vectors: Array) -> Array:
        return np.stack([total(mass * axis) for axis in vectors.T], axis=1) / whole[:, None]

    whole = total(mass)
    order, start = np.argsort(label, kind="stable"), np.cumsum(nodes) - nodes
    low, high = (bound.reduceat(rest[order], start) for bound in (np.minimum, np.maximum))
    return Pieces(
        number=present,
        nodes=nodes,
        volume=total(_volumes(lattice)[exists]),
        mass=whole,
        centre=mean(rest + displacement[exists]),
        velocity=mean(velocity[exists]),
        extent=np.where((present == DEBRIS)[:, None], 0.0, high - low),
        edge=lattice.spacing,
    )
