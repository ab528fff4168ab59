"""Waves of the infinite lattice and of an infinite bar cut from it, exactly (NumPy only).

All nodes have the same mass and the same bars. The corner and centre nodes of the paper's module
are together one body-centred cubic Bravais lattice with first and second neighbours; the nodes of
"cubic-26" are a simple cubic one. So a wave u exp(i (k.x - omega t)) obeys

    omega^2 u = D(k) u,   D(k) = (1/m) sum over the bars at a node  s (1 - cos k.r) n n^T,

with bar vector r, unit vector n and stiffness s = EA / length: a real 3 x 3 matrix for wave vectors
of the lattice's Brillouin zone. (Seen as two sublattices of a cubic lattice the paper's is a
6 x 6 matrix: its six branches are these three at k and at k + (2 pi / L, 0, 0).)

Where modules have an energy of their volume (``solver.volume``), corner and centre nodes differ:
only corners feel it. Then the matrix of all nodes of a site is needed (``Bulk.of_site``), and the
three waves of a wave vector are those in which the nodes of a site move together most.

Central differences with a step dt follow sin(omega dt / 2) = omega_0 dt / 2 with omega_0 of the
equation above, exactly: ``discrete_frequency``.

A bar with free sides is the same sum over the nodes of one period of its section (``Waveguide``):
the lattice's counterpart of the Pochhammer-Chree modes.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from taichi_ldem.model.cell import CELLS, CORNER, MODULE, MODULES, UnitCell
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.model.material import bar_families, volumetric_modulus
from taichi_ldem.scene import Material

Array = npt.NDArray[np.float64]

CORNERS = 2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1
"""(8, 3) places of a module's corners from its middle, in halves of its edge."""


@dataclass(frozen=True)
class Bulk:
    """The infinite lattice.

    Attributes:
        stiffness: EA / length of the bar families, N/m.
        mass: of a node, kg.
        spacing: module edge L, m.
        cell: the bars of a site; all nodes have the same star of bars.
        volumetric: lambda - mu of the modules' volumes, Pa (``solver.volume``).
    """

    stiffness: tuple[float, ...]
    mass: float
    spacing: float
    cell: UnitCell = MODULE
    volumetric: float = 0.0

    @cached_property
    def _rays(self) -> Array:
        # (n, 3) vectors of the bars at a node, in module edges
        return self.cell.rays[0]

    @cached_property
    def _units(self) -> Array:
        return np.asarray(self._rays / np.linalg.norm(self._rays, axis=1)[:, None])

    @cached_property
    def _shares(self) -> Array:
        # (n,) stiffness over mass of the bars at a node
        families = [self.cell.family[bar] for bar, _ in self.cell.scalars[0]]
        return np.array([self.stiffness[family] for family in families]) / self.mass

    def matrix(self, k: npt.ArrayLike) -> Array:
        """Dynamical matrices D(k) of bars alone, (..., 3, 3) in 1/s2, of k (..., 3) in 1/m."""
        phase = np.asarray(k) @ (self.spacing * self._rays.T)
        swing = self._shares * (1 - np.cos(phase))
        return np.asarray(np.einsum("...b,bi,bj->...ij", swing, self._units, self._units))

    def of_site(self, k: npt.ArrayLike) -> Array:
        """Dynamical matrices of all nodes of a site, (..., nodes, 3, nodes, 3) in 1/s2.

        A wave has its phase at the place of each node, so that the matrix is real: every node is a
        centre of inversion. A module adds (lambda - mu) L^3 (h.u)^2 to the squares of frequencies,
        with h = sum over the corners of s sin(k.s L / 2) / (4 L), s = (+-1, +-1, +-1).
        """
        phases = self.spacing * np.asarray(k)
        nodes = self.cell.sublattices
        matrix = np.zeros((*phases.shape[:-1], nodes, 3, nodes, 3))
        for ((a, _), (b, _)), vector, family in zip(
            self.cell.ends, self.cell.vectors, self.cell.family, strict=True
        ):
            pull = self.stiffness[family] * np.outer(vector, vector) / (vector @ vector)
            turned = np.cos(phases @ vector)[..., None, None] * pull
            matrix[..., a, :, a, :] += pull
            matrix[..., b, :, b, :] += pull
            matrix[..., a, :, b, :] -= turned
            matrix[..., b, :, a, :] -= turned
        swing = np.sin(0.5 * phases @ CORNERS.T) @ CORNERS / 4
        of_volume = self.volumetric * self.spacing * swing[..., :, None] * swing[..., None, :]
        matrix[..., CORNER, :, CORNER, :] += of_volume
        return matrix / self.mass

    def waves_of_site(self, k: npt.ArrayLike) -> tuple[Array, Array]:
        """The three waves in which the nodes of a site move together most.

        Angular frequencies (..., 3), ascending, 1/s; shapes (..., nodes, 3, 3), columns of unit
        square.
        """
        matrix = self.of_site(k)
        size = 3 * self.cell.sublattices
        squares, shapes = np.linalg.eigh(matrix.reshape(*matrix.shape[:-4], size, size))
        shapes = shapes.reshape(*matrix.shape[:-2], size)
        together = (shapes.mean(axis=-3) ** 2).sum(axis=-2)
        chosen = np.sort(np.argsort(-together, axis=-1, kind="stable")[..., :3], axis=-1)
        squares = np.take_along_axis(squares, chosen, -1)
        shapes = np.take_along_axis(shapes, chosen[..., None, None, :], -1)
        return np.sqrt(np.maximum(squares, 0.0)), shapes

    def waves(self, k: npt.ArrayLike) -> tuple[Array, Array]:
        """Angular frequencies (..., 3), ascending, 1/s; polarisations (..., 3, 3), columns.

        With volumes, a polarisation is that of the mean over a site's nodes.
        """
        if self.volumetric:
            omega, shapes = self.waves_of_site(k)
            mean = shapes.mean(axis=-3)
            return omega, np.asarray(mean / np.linalg.norm(mean, axis=-2, keepdims=True))
        squares, shapes = np.linalg.eigh(self.matrix(k))
        return np.sqrt(np.maximum(squares, 0.0)), shapes

    def frequencies(self, k: npt.ArrayLike) -> Array:
        """Angular frequencies (..., 3) of wave vectors (..., 3) in 1/m, ascending, 1/s."""
        return self.waves(k)[0]

    def phase_velocities(self, k: npt.ArrayLike) -> Array:
        """omega / |k|, (..., 3), m/s."""
        length = np.linalg.norm(np.asarray(k), axis=-1)
        return np.asarray(self.frequencies(k) / length[..., None])

    def group_velocities(self, k: npt.ArrayLike) -> Array:
        """d omega / d k, (..., 3, 3): branch, then component, m/s.

        From 2 omega d omega = u^T dD u. In a degenerate pair the two polarisations are any of their
        plane: along a symmetry axis both give the same component along k.
        """
        if self.volumetric:
            omega, shapes = self.waves_of_site(k)
            middle, step = np.asarray(k, dtype=float), 1e-5 / self.spacing
            slopes = [
                (self.of_site(middle + step * e) - self.of_site(middle - step * e)) / (2 * step)
                for e in np.eye(3)
            ]
            rise = np.stack(
                [np.einsum("...ain,...aibj,...bjn->...n", shapes, d, shapes) for d in slopes], -1
            )
            return np.asarray(rise / (2 * omega[..., None]))
        omega, shapes = self.waves(k)
        bars = self.spacing * self._rays
        slope = self._shares * np.sin(np.asarray(k) @ bars.T)
        along = np.einsum("bi,...in->...bn", self._units, shapes) ** 2
        rise = np.einsum("...b,...bn,bi->...ni", slope, along, bars)
        return np.asarray(rise / (2 * omega[..., None]))

    def branch(self, k: npt.ArrayLike, polarisation: npt.ArrayLike) -> tuple[Array, Array]:
        """Frequency (...,) and unit polarisation (..., 3) of the branch nearest to a direction.

        In a degenerate pair the polarisation is the part of the wanted direction in its plane.
        """
        omega, shapes = self.waves(k)
        wanted = np.asarray(polarisation, dtype=float)
        overlap = np.einsum("i,...in->...n", wanted, shapes)
        chosen = np.abs(overlap).argmax(axis=-1)[..., None]
        value = np.take_along_axis(omega, chosen, -1)
        same = np.abs(omega - value) <= 1e-9 * np.abs(omega).max(axis=-1, keepdims=True)
        shape = np.einsum("...n,...in->...i", overlap * same, shapes)
        return value[..., 0], shape / np.linalg.norm(shape, axis=-1, keepdims=True)

    def straight(self, k: npt.ArrayLike, polarisation: npt.ArrayLike) -> tuple[Array, Array]:
        """Waves all of whose motion is along one direction, as along and across a cube's edge.

        Frequencies (...,), 1/s, and amplitudes (..., nodes of a site) of unit mean square. Without
        volumes, and in waves that change none, all nodes of a site move alike.
        """
        if not self.volumetric:
            omega, _ = self.branch(k, polarisation)
            return omega, np.ones((*omega.shape, self.cell.sublattices))
        along = np.asarray(polarisation, dtype=float)
        block = np.einsum("i,...aibj,j->...ab", along, self.of_site(k), along)
        squares, shapes = np.linalg.eigh(block)
        together = shapes.sum(axis=-2)
        chosen = np.abs(together).argmax(axis=-1)[..., None]
        sign = np.where(np.take_along_axis(together, chosen, -1) < 0, -1.0, 1.0)
        shape = np.take_along_axis(shapes, chosen[..., None], -1)[..., 0]
        square = np.take_along_axis(squares, chosen, -1)[..., 0]
        root = np.sqrt(self.cell.sublattices)
        return np.sqrt(np.maximum(square, 0.0)), np.asarray(root * sign * shape)

    @cached_property
    def highest_frequency(self) -> float:
        """Largest angular frequency over the Brillouin zone, 1/s.

        On a grid that holds the zone's points of high symmetry, where the maximum lies.
        """
        steps = np.linspace(0.0, 2 * np.pi / self.spacing, 25)
        k = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
        if self.volumetric:
            # zero at the zone's centre, to rounding
            return float(np.sqrt(self.every_branch(k)[..., -1].max()))
        return float(self.frequencies(k).max())

    def every_branch(self, k: npt.ArrayLike) -> Array:
        """Squares of angular frequencies, (..., 3 x nodes of a site), ascending, 1/s2."""
        matrix, size = self.of_site(k), 3 * self.cell.sublattices
        return np.asarray(np.linalg.eigvalsh(matrix.reshape(*matrix.shape[:-4], size, size)))

    @cached_property
    def fastest(self) -> float:
        """Largest long-wave speed over the directions [100], [110], [111], m/s."""
        directions = np.array([(1, 0, 0), (1, 1, 0), (1, 1, 1)]) / np.sqrt([[1], [2], [3]])
        return float(self.phase_velocities(1e-4 / self.spacing * directions).max())


def _bar_stiffness(
    material: Material, spacing: float, variant: str, lattice: str
) -> tuple[float, ...]:
    """EA / length of the bar families, N/m."""
    bars = bar_families(material, spacing, variant, lattice=lattice)
    return tuple(family.axial_stiffness / family.length for family in bars)


def _volumetric(material: Material, variant: str) -> float:
    """lambda - mu of the modules' volumes, Pa; zero where they have no energy."""
    if variant != "volumetric":
        return 0.0
    return volumetric_modulus(material.youngs_modulus, material.poisson_ratio)


def bulk(
    material: Material, spacing: float, variant: str = "equation-2", lattice: str = "module"
) -> Bulk:
    """The infinite lattice of a material at a module edge (m), of a unit cell by its name."""
    stiffness, cell = _bar_stiffness(material, spacing, variant, lattice), CELLS[lattice]
    mass = material.density * spacing**3 / cell.sublattices
    return Bulk(stiffness, mass, spacing, cell, _volumetric(material, variant))


def discrete_frequency(omega: npt.ArrayLike, time_step: float) -> Array:
    """Frequency of central differences: (2 / dt) asin(omega_0 dt / 2), 1/s.

    Raises:
        ValueError: a frequency beyond the stable 2 / dt.
    """
    half = 0.5 * time_step * np.asarray(omega)
    if np.any(half > 1):
        raise ValueError("the time step is above 2 / omega: central differences are unstable")
    return np.asarray(2 / time_step * np.arcsin(half))


@dataclass(frozen=True)
class Waveguide:
    """An infinite straight bar of the lattice with free sides.

    Attributes:
        lattice: a piece of the bar, at least five modules long along ``axis``.
        axis: 0, 1, 2 for a bar along x, y, z.
        stiffness: EA / length of the bar families, N/m.
        density: kg/m3.
        volumetric: lambda - mu of the modules' volumes, Pa.
    """

    lattice: Lattice
    axis: int
    stiffness: tuple[float, ...]
    density: float
    volumetric: float = 0.0
    _site: int = field(default=3, init=False)  # away from the ends of the piece

    @cached_property
    def code(self) -> npt.NDArray[np.uint8]:
        """(A, B) site bytes of one period of the section."""
        return np.asarray(np.take(self.lattice.code, self._site, axis=2 - self.axis))

    @cached_property
    def nodes(self) -> npt.NDArray[np.bool_]:
        """(sublattices, A, B) where one period has nodes."""
        return np.moveaxis(self._masses > 0, -1, 0)

    @property
    def _masses(self) -> Array:
        return self.lattice.cell.node_shares[self.code] * self.density * self.lattice.spacing**3

    @cached_property
    def mass(self) -> Array:
        """(n,) masses of the period's nodes in the order of ``nodes``, kg."""
        return np.moveaxis(self._masses, -1, 0)[self.nodes]

    @cached_property
    def _blocks(self) -> tuple[Array, dict[float, Array]]:
        """Own terms (3n, 3n), and couplings by distance along the bar, in units of root masses."""
        n = len(self.mass)
        number = np.full(self.nodes.shape, -1)
        number[self.nodes] = np.arange(n)
        cell = self.lattice.cell
        weights = cell.weights(self.lattice.surface_weights)[self.code]
        units = cell.vectors / np.linalg.norm(cell.vectors, axis=1)[:, None]
        across = [a for a in (2, 1, 0) if a != self.axis]  # arrays are in the order z, y, x
        own = np.zeros((n, n, 3, 3))
        coupling: dict[float, Array] = {}
        for bar, vector in enumerate(cell.vectors):
            (first, _), (second, there) = cell.ends[bar]
            step = there[::-1]
            a, b = np.nonzero(weights[..., bar])
            i = number[first, a, b]
            j = number[second, a + step[across[0]], b + step[across[1]]]
            pull = self.stiffness[cell.family[bar]] * np.outer(units[bar], units[bar])
            part = weights[a, b, bar][:, None, None] * pull
            for node in (
                i,
                j,
            ):  # a node is first end of one bar of a kind at most, and second of one
                own[node, node] += part / self.mass[node, None, None]
            block = coupling.setdefault(float(vector[self.axis]), np.zeros((n, n, 3, 3)))
            block[i, j] += part / np.sqrt(self.mass[i] * self.mass[j])[:, None, None]

        def flat(block: Array) -> Array:
            return block.transpose(0, 2, 1, 3).reshape(3 * n, 3 * n)

        return flat(own), {key: flat(block) for key, block in coupling.items()}

    @cached_property
    def _swellings(self) -> dict[int, Array]:
        """What nodes behind (-1) and ahead (1) add to the volumes of a period's modules.

        (modules, 3n) each, in units of root masses: the square of their sum is that of a frequency.
        """
        n = len(self.mass)
        corners = np.full(self.code.shape, -1)
        corners[self.nodes[CORNER]] = np.arange(np.count_nonzero(self.nodes[CORNER]))
        a, b = np.nonzero(MODULES[self.code, 7])
        across = [axis for axis in (2, 1, 0) if axis != self.axis]
        found = {side: np.zeros((len(a), n, 3)) for side in (-1, 1)}
        for sign in CORNERS:
            ahead = (sign > 0).astype(int)
            node = corners[a + ahead[across[0]], b + ahead[across[1]]]
            share = sign / 4 / np.sqrt(self.mass[node])[:, None]
            found[int(sign[self.axis])][np.arange(len(a)), node] += share
        return {side: part.reshape(len(a), 3 * n) for side, part in found.items()}

    def matrix(self, k: float) -> npt.NDArray[np.complex128]:
        """(3n, 3n) Hermitian dynamical matrix at a wave number along the bar (1/m), 1/s2."""
        own, coupling = self._blocks
        total = own.astype(complex)
        for distance, block in coupling.items():
            term = np.exp(1j * k * distance * self.lattice.spacing) * block
            total -= term + term.conj().T
        if self.volumetric:
            turn = np.exp(0.5j * k * self.lattice.spacing)
            swing = turn.conj() * self._swellings[-1] + turn * self._swellings[1]
            total += self.volumetric * self.lattice.spacing * swing.conj().T @ swing
        return total

    @cached_property
    def corner_shares(self) -> Array:
        """(n,) weights of a section's mean over its corner nodes, by mass."""
        corner = np.arange(len(self.mass)) < np.count_nonzero(self.nodes[0])
        return np.asarray(self.mass * corner / self.mass[corner].sum())

    def longitudinal(self, k: npt.ArrayLike) -> tuple[Array, npt.NDArray[np.complex128]]:
        """The fundamental longitudinal mode at rising wave numbers (m,), from long waves on.

        Frequencies (m,), 1/s, and shapes (m, n, 3) that multiply exp(i (k x - omega t)) at every
        node's own x, of unit mean square by mass. The first is the mode most like a uniform axial
        motion, every other the one most like that before it, so the branch is followed through
        crossings where the steps in k are small; phases follow in the same way.
        """
        root = np.sqrt(self.mass / self.mass.sum())
        before = np.zeros((len(root), 3), dtype=complex)
        before[:, self.axis] = root
        frequencies: list[float] = []
        shapes: list[npt.NDArray[np.complex128]] = []
        last = before.ravel()
        for one in np.atleast_1d(np.asarray(k, dtype=float)):
            squares, vectors = np.linalg.eigh(self.matrix(float(one)))
            likeness = last.conj() @ vectors
            best = int(np.abs(likeness).argmax())
            last = vectors[:, best] * (abs(likeness[best]) / likeness[best])
            frequencies.append(float(np.sqrt(max(squares[best], 0.0))))
            shapes.append(last.reshape(-1, 3) / root[:, None])
        return np.array(frequencies), np.array(shapes)


def waveguide(
    material: Material, lattice: Lattice, axis: int, variant: str = "equation-2"
) -> Waveguide:
    """The infinite bar that a piece of lattice (uniform along ``axis``) is cut from."""
    stiffness = _bar_stiffness(material, lattice.spacing, variant, lattice.cell.name)
    return Waveguide(lattice, axis, stiffness, material.density, _volumetric(material, variant))
