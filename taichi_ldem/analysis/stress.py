"""Cauchy stress and damage of modules, from what their bars carry.

A bar with the axial force F and the vector l from end to end holds the virial F l l / |l|. It is
shared out among the modules that the bar lies in, by its length in each: equally among up to four
for an edge of modules, half and half for a bar between two centres. A module's stress is the sum of
its shares over its volume.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.model.lattice import Lattice

Array = NDArray[np.float64]

COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""The six components of a symmetric tensor in VTK's order: xx, yy, zz, xy, yz, xz."""


class ModuleSums:
    """Sums over the bars of each module.

    Attributes:
        virial: (modules, 6) sum of F l l / |l|, J. whole, left: (modules,) stiffness of its bars
            when whole, and in tension now, N/m. failed: (modules,) number of those that have
            nothing left. Modules are in the order of the mask's sites.
    """

    def __init__(
        self, lattice: Lattice, displacement: Array, layers: Iterable[tuple[int, Array]]
    ) -> None:
        """Add up the bars.

        Args:
            displacement: (sublattices, *S, 3), m.
            layers: a layer of sites, and (3, bars, ny + 3, nx + 3) of the bars that start there:
                axial force over length, stiffness when whole, and what is left of it, N/m.
        """
        self.lattice, self.displacement = lattice, displacement
        # one more layer of sites all around, so that no bar is a special case
        self.exists = np.pad(lattice.mask, ((2, 3),) * 3)
        self.sums = np.zeros((9, *self.exists.shape))
        for k, values in layers:
            for bar in range(lattice.cell.bars):
                self._add(k, bar, *values[:, bar, 1:-1, 1:-1])
        inner = self.sums[:, 2:-3, 2:-3, 2:-3][:, lattice.mask]
        self.virial, (self.whole, self.left, self.failed) = inner[:6].T, inner[6:]

    def _add(self, k: int, bar: int, pull: Array, whole: Array, left: Array) -> None:
        """Add the shares of the bars of one number that start in a layer of sites."""
        parts = self.lattice.cell.lies_in[bar]
        where = [self._sites(k, offset, 1) for offset, _ in parts]
        held = np.sum([p * self.exists[w] for (_, p), w in zip(parts, where, strict=True)], axis=0)
        over = np.divide(1.0, held, out=np.zeros_like(held), where=held > 0)
        vector = self._vector(k, bar)
        tensor = [pull * vector[..., a] * vector[..., b] for a, b in COMPONENTS]
        own = np.stack([*tensor, whole, left, ((whole > 0) & (left == 0)) * 1.0])
        own[:8] *= over
        for (_, part), place in zip(parts, where, strict=True):
            share = np.full(9, part)
            share[8] = 1.0  # a bar that has failed counts in each of its modules
            self.sums[(slice(None), *place)] += share[:, None, None] * own

    def _sites(self, k: int, offset: tuple[int, int, int], more: int) -> tuple[int, slice, slice]:
        """The inner sites of a layer, moved by an offset, where arrays have so many more around."""
        dz, dy, dx = (o + more for o in offset)
        _, ny, nx = self.lattice.sites
        return k + dz, slice(1 + dy, ny - 1 + dy), slice(1 + dx, nx - 1 + dx)

    def _vector(self, k: int, bar: int) -> Array:
        """Vectors along the bars now, m."""
        cell, lattice = self.lattice.cell, self.lattice
        (first, a), (second, b) = cell.ends[bar]
        far, near = self._sites(k, b, 0), self._sites(k, a, 0)
        vector = cell.vectors[bar] * lattice.spacing
        if lattice.offsets is not None:
            vector = vector + (lattice.offsets[second][far] - lattice.offsets[first][near])
        moved = self.displacement[second][far] - self.displacement[first][near]
        return np.asarray(vector + moved)

    @property
    def damage(self) -> Array:
        """(modules,) share of the stiffness of a module's bars that is lost in tension, 0 to 1."""
        whole = np.where(self.whole > 0, self.whole, 1.0)
        return np.asarray(np.clip(1 - self.left / whole, 0.0, 1.0))

    def stress(self, volume: Array, swelling: Array) -> Array:
        """(modules, 6) Cauchy stress of the bars, Pa.

        The volume is that now; that at rest in modules with a failed bar, where the corners' volume
        has the opening of the crack in it.

        Args:
            volume: (modules,) at rest, m3. swelling: (modules,) J - 1.
        """
        grown = np.where(self.failed > 0, 1.0, 1 + swelling)
        return np.asarray(self.virial / (volume * grown)[:, None])


def volumetric_stress(modulus: Array | float, swelling: Array) -> Array:
    """(modules, 6) Cauchy stress of the energy 1/2 (lambda - mu) (J - 1)^2 a volume, Pa.

    Args:
        modulus: lambda - mu, Pa, of all or of (modules,). swelling: (modules,) J - 1.
    """
    stress = np.zeros((len(swelling), 6))
    stress[:, :3] = (modulus * swelling)[:, None]
    return stress


def as_matrices(tensors: Array) -> Array:
    """(n, 3, 3) matrices of (n, 6) symmetric tensors."""
    matrices = np.empty((len(tensors), 3, 3))
    for n, (a, b) in enumerate(COMPONENTS):
        matrices[:, a, b] = matrices[:, b, a] = tensors[:, n]
    return matrices


def as_components(matrices: Array) -> Array:
    """(n, 6) components of (n, 3, 3) symmetric matrices."""
    return np.stack([matrices[:, a, b] for a, b in COMPONENTS], axis=1)


def largest_principal(tensors: Array) -> Array:
    """(n,) largest principal values of (n, 6) symmetric tensors."""
    return np.asarray(np.linalg.eigvalsh(as_matrices(tensors))[:, 2])
