"""An extensometer: strains along and across the middle part of a specimen in tension."""

import math
from typing import Any

import numpy as np
import taichi as ti

from taichi_ldem.model.cell import CORNER
from taichi_ldem.solver.dynamics import Dynamics
from taichi_ldem.solver.state import field_apart


@ti.data_oriented
class Gauge:
    """Four bands of corner nodes, whose mean displacements are read at every sample.

    Two lie across the specimen: the nodes within half a module of either end of the gauge length.
    Two lie along it: the nodes of the gauge length within half a module of either side. Means are
    weighted with the nodes' masses.

    Args:
        angle: of the specimen's long side to x, radians.
        length: nominal gauge length, m.

    Attributes:
        length: distance between the two bands across, m.
        width: distance between the two bands along, m.
        section: mean cross-section of the specimen within the gauge length, m2.
    """

    def __init__(self, dynamics: Dynamics, angle: float, length: float):
        self.dynamics = dynamics
        self.nodes: Any = None  # allocated when the number of nodes is known
        self.place(angle, length)

    def place(self, angle: float, length: float) -> None:
        """Choose the bands on the lattice as it is now.

        Raises:
            ValueError: they have another number of nodes than before.
        """
        lattice, spacing = self.dynamics.lattice, self.dynamics.lattice.spacing
        turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
        along, across = turn @ lattice.grid()[..., :2].reshape(-1, 2).T
        mass = self.dynamics.masses().ravel()
        corner = (mass > 0) & (np.arange(len(mass)) < math.prod(lattice.sites))
        half_band = (0.5 + 1e-6) * spacing
        middle = corner & (np.abs(along) <= 0.5 * length + 1e-6 * spacing)
        side = np.abs(across[middle]).max()
        bands = [corner & (np.abs(along - sign * 0.5 * length) <= half_band) for sign in (-1, 1)]
        bands += [middle & (np.abs(across - sign * side) <= half_band) for sign in (-1, 1)]
        number = np.flatnonzero(np.any(bands, axis=0))
        shares = [np.where(band, mass, 0.0)[number] for band in bands]
        if self.nodes is None:
            self.nodes = field_apart(ti.i32, len(number))
        if self.nodes.shape[0] != len(number):
            raise ValueError(f"the gauge has {self.nodes.shape[0]} nodes, not {len(number)}")
        self.nodes.from_numpy(number.astype(np.int32))
        self._means = np.array([share / share.sum() for share in shares])
        self._turn = turn
        self.section = self._section(turn, length)
        along, across = turn @ lattice.positions()[..., :2].reshape(-1, 2).T
        self.length = float((self._means[1] - self._means[0]) @ along[number])
        self.width = float((self._means[3] - self._means[2]) @ across[number])

    def _section(self, turn: np.ndarray, length: float) -> float:
        """Volume over length of the planes of modules whose centres are in the gauge length, m2."""
        lattice = self.dynamics.lattice
        corners = lattice.grid()[CORNER, 1:-2, 1:-2, 1:-2][lattice.mask]
        centres = (corners[:, :2] + 0.5 * lattice.spacing) @ turn[0]
        inside = centres[np.abs(centres) <= 0.5 * length]
        step = 1e-6 * lattice.spacing
        planes = np.unique(np.rint(inside / step))
        between = step * (planes[-1] - planes[0]) / (len(planes) - 1)
        return float(len(inside) * lattice.spacing**3 / (len(planes) * between))

    @ti.kernel
    def _gather(self, now: int, values: ti.types.ndarray()):
        nz, ny, nx = ti.static(self.dynamics.sites)
        for number in self.nodes:
            node = self.nodes[number]
            k, j, i = node // (ny * nx) % nz, node // nx % ny, node % nx
            displacement = self.dynamics.access.displacement(now, CORNER, k, j, i)
            for axis in ti.static(range(2)):
                values[number, axis] = ti.cast(displacement[axis], ti.f64)

    def strains(self, now: int) -> tuple[float, float]:
        """Engineering strains along and across the specimen at the displacement ``now``."""
        displacement = np.zeros((self.nodes.shape[0], 2))
        self._gather(now, displacement)
        along, across = self._turn @ displacement.T
        extension = float((self._means[1] - self._means[0]) @ along)
        widening = float((self._means[3] - self._means[2]) @ across)
        return extension / self.length, widening / self.width
