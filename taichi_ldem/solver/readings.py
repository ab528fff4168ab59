"""What the bars of a lattice carry and have lost, read without changing their history.

``solver.bar_forces`` keeps the forces of a few rows only, so they are worked out again here, a
layer of sites at a time.
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.model.lattice import Part
from taichi_ldem.solver.bars import TINY
from taichi_ldem.solver.dynamics import Dynamics

PULL, WHOLE, LEFT = range(3)


@ti.data_oriented
class BarReadings:
    """Reads the bars of a lattice as they are at a displacement, with their latest history."""

    def __init__(self, dynamics: Dynamics):
        self.state, self.bars, self.access = dynamics, dynamics.bars, dynamics.access

    @ti.func
    def read(self, bar, at: ti.template(), lane, step: ti.template()):
        """Axial force over current length; stiffness when whole, and what is left of it in tension.

        All are in N/m.
        """
        whole = self.bars.stiffness(bar, at, lane)
        q = self.bars.twice_green_strain(bar, at, step, lane)
        square = ti.max(1 + q, TINY)
        pull, left = (whole * q) / (square + ti.sqrt(square)), whole
        if ti.static(self.state.features.damage):
            peak = self.state.peak[bar, at.k, at.j, at.m][lane]
            pull *= self.bars.integrity(bar, self.bars.strain(q), peak)
            left *= self.bars.integrity(bar, 1.0, peak)
        if ti.static(self.state.features.notch):
            if self.bars.is_removed(bar, at, lane):
                pull, left = 0.0, 0.0
        return ti.Vector([pull, whole, left])

    @ti.kernel
    def _layer(
        self, k: int, first_j: int, first_i: int, now: int, spacing: float,
        values: ti.types.ndarray(),
    ):  # fmt: skip
        for j, i in ti.ndrange((1, values.shape[2] - 1), (1, values.shape[3] - 1)):
            m, lane = self.access.column_of(first_i + i)
            at, step = ti.Struct(k=k, j=first_j + j, m=m), ti.Struct(now=now, spacing=spacing)
            for bar in range(self.state.cell.bars):
                found = self.read(bar, at, lane, step)
                for n in ti.static(range(3)):
                    values[n, bar, j, i] = found[n]

    def layers(
        self, now: int, part: Part | None = None
    ) -> Iterator[tuple[int, npt.NDArray[np.float64]]]:
        """Each layer k of sites, and (3, bars, ny + 3, nx + 3) values of the bars that start there.

        They are PULL, the axial force over current length; WHOLE, the stiffness of a whole bar; and
        LEFT, that in tension now; all in N/m, and zero where there is no bar.

        Args:
            now: buffer of the displacement.
            part: of the lattice, whose sites these are; None: the whole lattice.
        """
        nz, ny, nx = self.state.sites if part is None else part.sites
        first_k, first_j, first_i = (0, 0, 0) if part is None else part.first
        values = np.zeros((3, self.state.cell.bars, ny, nx))
        for k in range(1, nz - 1):
            self._layer(first_k + k, first_j, first_i, now, self.state.lattice.spacing, values)
            yield k, values
