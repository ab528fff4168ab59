"""Exchange of nodes and bars with the host, in the order of the lattice's sites."""

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.solver.access import NodeAccess
from taichi_ldem.solver.bars import LatticeBars
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.state import State
from taichi_ldem.solver.step import Step

BATCH = 65536
"""Number of broken bars that are fetched from the device at a time."""


@ti.data_oriented
class Exchange:
    """Copies fields to and from NumPy arrays, and lists broken bars."""

    def __init__(self, state: State, bars: LatticeBars, access: NodeAccess, step: Step):
        self.state, self.bars, self.access, self.step = state, bars, access, step

    @ti.kernel
    def set_displacement(self, now: int, values: ti.types.ndarray()):
        """Copy (sublattices, *S, 3) values into a buffer, m; ghosts must be zero."""
        for k, j, m in ti.ndrange(*self.state.shape):
            for lane in range(self.state.lanes.width):
                for s, axis in ti.static(self.state.cell.node_axes):
                    value = ti.cast(values[s, k, j, self.access.site_of(m, lane), axis], float)
                    self.state.displacement[s][axis][now, k, j, m][lane] = value

    @ti.kernel
    def get_displacement(self, now: int, values: ti.types.ndarray()):
        """Copy a buffer into (sublattices, *S, 3) values, m; ghosts are left."""
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in ti.static(self.state.sites)]):
            m, lane = self.access.column_of(i)
            for s, axis in ti.static(self.state.cell.node_axes):
                values[s, k, j, i, axis] = self.state.displacement[s][axis][now, k, j, m][lane]

    @ti.kernel
    def _set_velocity(self, values: ti.types.ndarray()):
        for k, j, m in ti.ndrange(*self.state.shape):
            for lane in range(self.state.lanes.width):
                for s, axis in ti.static(self.state.cell.node_axes):
                    value = ti.cast(values[s, k, j, self.access.site_of(m, lane), axis], float)
                    self.state.velocity[s][axis][k, j, m][lane] = value

    @ti.kernel
    def _get_velocity(self, values: ti.types.ndarray()):
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in ti.static(self.state.sites)]):
            m, lane = self.access.column_of(i)
            for s, axis in ti.static(self.state.cell.node_axes):
                values[s, k, j, i, axis] = self.state.velocity[s][axis][k, j, m][lane]

    def set_velocity(self, values: npt.NDArray[np.float64]) -> None:
        """Set all velocities from (sublattices, *S, 3) values, m/s; ghosts zero."""
        self._set_velocity(np.ascontiguousarray(values, dtype=np.float64))

    def get_velocity(
        self, values: npt.NDArray[np.float64] | None = None
    ) -> npt.NDArray[np.float64]:
        """(sublattices, *S, 3) velocities of all nodes, m/s, put into ``values``."""
        if values is None:
            values = np.zeros((self.state.cell.sublattices, *self.state.sites, 3))
        self._get_velocity(values)
        return values

    def get_acceleration(self, now: int) -> npt.NDArray[np.float64]:
        """(sublattices, *S, 3) M^-1 F of the bar forces at a buffer's displacement, m/s2.

        A step of one second from rest evaluates it, so it is the run's own operator.
        The history of the bars is updated; the other buffer becomes a copy of this one.
        """
        kept = self.get_velocity()
        self.set_velocity(np.zeros_like(kept))
        with self.state.weightless():
            self.step.kick(now, 1.0)
        acceleration = self.get_velocity()
        self.set_velocity(kept)
        return acceleration

    def get_force(self, now: int) -> npt.NDArray[np.float64]:
        """(sublattices, *S, 3) sum of the bar forces on all nodes, N.

        It has the side effects of ``get_acceleration``.
        """
        return self.state.masses()[..., None] * self.get_acceleration(now)

    # -- broken bars -------------------------------------------------------------------------------

    @ti.kernel
    def _collect_broken(self, found: ti.types.ndarray(), count: ti.types.ndarray()):
        nz, ny, _ = ti.static(self.state.shape)
        for k, j, m in ti.ndrange(nz, ny, (HALO, HALO + self.state.lanes.length)):
            if self.state.touched[k, j, m] != 0:
                for lane in range(self.state.lanes.width):
                    self._collect_at(ti.Struct(k=k, j=j, m=m), lane, found, count)

    @ti.func
    def _collect_at(self, at, lane, found: ti.template(), count: ti.template()):
        """Append a site's bars that broke since the last call, in any order."""
        k, j, m = at.k, at.j, at.m
        recorded = int(self.state.recorded[k, j, m][lane])
        whole = self.state.stiffness[int(self.state.code[k, j, m][lane])]
        for bar in range(self.state.cell.bars):
            broken = whole[self.state.kinds[bar][1]] > 0
            broken &= self.bars.has_failed(bar, self.state.peak[bar, k, j, m][lane])
            if broken and (recorded >> bar) & 1 == 0:
                place = ti.atomic_add(count[0], 1)
                if place < found.shape[0]:
                    found[place, 0], found[place, 1] = k, j
                    found[place, 2], found[place, 3] = self.access.site_of(m, lane), bar
                    recorded |= 1 << bar
        self.state.recorded[k, j, m][lane] = ti.cast(recorded, ti.u16)

    def new_broken(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Sites (n, 3) as k, j, i and numbers (n,) of bars broken since the last call, in order."""
        rows = []
        while True:
            found = np.zeros((BATCH, 4), dtype=np.int32)
            count = np.zeros(1, dtype=np.int32)
            self._collect_broken(found, count)
            rows.append(found[: count[0]])
            if count[0] <= len(found):
                break
        broken = np.concatenate(rows).astype(np.int64)
        broken = broken[np.lexsort(broken.T[::-1])]
        return broken[:, :3], broken[:, 3]

    def recorded_bits(self) -> npt.NDArray[np.uint16]:
        """(nz + 3, ny + 3, nx + 3) one bit for each bar reported broken."""
        return self.state.lanes.gather(self.state.recorded.to_numpy())
