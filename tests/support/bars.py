"""Reads what single bars carry; import it once Taichi has started."""

import numpy as np
import taichi as ti

from taichi_ldem.solver.contact.kernels.body import Layout, RigidBody
from taichi_ldem.solver.dynamics import Dynamics
from taichi_ldem.solver.lanes import HALO


@ti.data_oriented
class BarForces:
    """Pass 1 alone, row by row."""

    def __init__(self, dynamics: Dynamics):
        self.dynamics = dynamics

    @ti.kernel
    def row(
        self,
        j: int,
        now: int,
        spacing: float,
        time_step: float,
        peak: float,
        values: ti.types.ndarray(),
    ):
        """Copy the scalars of a row of sites into (S, 14) values."""
        row = self.dynamics.driver.bar_row(0, j)
        for k in range(1, self.dynamics.sites[0] - 1):
            for m in range(HALO, HALO + self.dynamics.lanes.length):
                at = ti.Struct(row=row, k=k, j=j, m=m)
                step = ti.Struct(
                    now=now, spacing=spacing, kick=time_step, drift=time_step, peak_strain=peak
                )
                self.dynamics.bar_forces.column_forces(at, step)
                for lane in ti.static(range(self.dynamics.lanes.width)):
                    site = self.dynamics.site_of(m, lane)
                    for bar in ti.static(range(self.dynamics.cell.bars)):
                        values[k, j, site, bar] = self.dynamics.axial[bar][row, k, m][lane]

    def read(self, now: int, time_step: float = 0.0) -> np.ndarray:
        """(S, 14) axial force over current length, N/m, after a step that took so long."""
        d = self.dynamics
        values = np.zeros((*d.sites, d.cell.bars))
        for j in range(1, d.sites[1] - 1):
            self.row(j, now, d.lattice.spacing, time_step, d.peak_strain, values)
        return values


@ti.data_oriented
class Places:
    """Where rigid bodies take the nodes to be at rest."""

    def __init__(self, dynamics: Dynamics):
        self.sites = dynamics.sites
        self.body = RigidBody(dynamics, Layout((0.0,), 1))

    @ti.kernel
    def fill(self, spacing: float, values: ti.types.ndarray()):
        """Copy the places of all nodes into (2, S, 3) values; ghosts are left."""
        nz, ny, nx = ti.static(self.sites)
        for k, j, i in ti.ndrange((1, nz - 1), (1, ny - 1), (1, nx - 1)):
            for s in range(2):
                place = self.body.rest_position(s, k, j, i, spacing)
                for axis in ti.static(range(3)):
                    values[s, k, j, i, axis] = place[axis]

    def read(self) -> np.ndarray:
        """(2, S, 3) m."""
        values = np.zeros((2, *self.sites, 3))
        self.fill(self.body.dynamics.lattice.spacing, values)
        return values


@ti.data_oriented
class BothWays:
    """Stiffness and q of bars, by the functions for every lane and by those for one lane."""

    def __init__(self, dynamics: Dynamics):
        self.dynamics, self.bars = dynamics, dynamics.bars

    @ti.kernel
    def _read(self, spacing: float, lanes: ti.types.ndarray(), one: ti.types.ndarray()):
        width = ti.static(self.dynamics.lanes.width)
        for k, j in ti.ndrange(*[(1, n - 1) for n in ti.static(self.dynamics.sites[:2])]):
            for m in range(HALO, HALO + self.dynamics.lanes.length):
                at, step = ti.Struct(k=k, j=j, m=m), ti.Struct(now=0, spacing=spacing)
                for bar in ti.static(range(self.dynamics.cell.bars)):
                    whole = self.bars.stiffness_of_lanes(bar, at)
                    q = self.bars.twice_green_strain_of_lanes(bar, at, step)
                    for lane in ti.static(range(width)):
                        lanes[k, j, m, lane, bar, 0] = whole[lane]
                        lanes[k, j, m, lane, bar, 1] = q[lane]
                for lane, bar in ti.ndrange(width, self.dynamics.cell.bars):
                    one[k, j, m, lane, bar, 0] = self.bars.stiffness(bar, at, lane)
                    one[k, j, m, lane, bar, 1] = self.bars.twice_green_strain(bar, at, step, lane)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """(columns, lanes, bars, 2) stiffness in N/m and q, by every lane and by one."""
        d = self.dynamics
        shape = (*d.shape, d.lanes.width, d.cell.bars, 2)
        lanes, one = np.zeros(shape), np.zeros(shape)
        self._read(d.lattice.spacing, lanes, one)
        return lanes, one
