"""Single nodes, named by sublattice and site, for kernels that visit them one by one."""

import taichi as ti

from taichi_ldem.model.cell import CENTRE, CORNER
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.state import State


@ti.data_oriented
class NodeAccess:
    """Single nodes, named by sublattice and site (s, k, j, i), for kernels of rigid bodies."""

    def __init__(self, state: State):
        self.state = state

    @ti.func
    def column_of(self, i):
        """Column that owns site i of a row, and its lane there."""
        lane = (i - 1) // self.state.lanes.length
        return i - 1 - lane * self.state.lanes.length + HALO, lane

    @ti.func
    def owner_of(self, m, lane):
        """Column that owns the node at a place of a row, halos included, and its lane there.

        As ``column_of``, without a division: for places in or next to a column that exists.
        """
        length = ti.static(self.state.lanes.length)
        column, own = m, lane
        if m < HALO:
            column, own = m + length, lane - 1
        elif m >= HALO + length:
            column, own = m - length, lane + 1
        return column, own

    @ti.func
    def site_of(self, m, lane):
        """Site at a place of a row (ghosts beyond either end are clipped)."""
        site = 1 + lane * self.state.lanes.length + m - HALO
        return ti.max(0, ti.min(site, ti.static(self.state.sites[2] - 1)))

    @ti.func
    def site_of_end(self, end, at: ti.template(), lane):
        """Site (k, j, i) of an end of a bar (``LatticeBars.ends``) that starts in a column."""
        return at.k + end[1], at.j + end[2], self.site_of(at.m, lane) + end[3]

    @ti.func
    def value(self, field: ti.template(), k, j, i):
        """Value of a field of columns at a site."""
        m, lane = self.column_of(i)
        return field[k, j, m][lane]

    @ti.func
    def mass(self, s, k, j, i):
        """Mass of a node, kg; 0 where there is none."""
        m, lane = self.column_of(i)
        mass = self.state.mass[int(self.state.code[k, j, m][lane])]
        if ti.static(self.state.features.density):
            for sublattice in ti.static(range(self.state.cell.sublattices)):
                mass[sublattice] = self.state.own_mass[sublattice][k, j, m][lane]
        chosen = mass[CORNER]
        if ti.static(self.state.cell.sublattices > 1):
            if s == CENTRE:
                chosen = mass[CENTRE]
        return chosen

    @ti.func
    def displacement(self, now, s, k, j, i):
        """Displacement of a node, m."""
        m, lane = self.column_of(i)
        place = ti.Vector([now, k, j, m])
        return self.state.node_vector(self.state.displacement, s, place, lane)

    @ti.func
    def offset(self, s, k, j, i, spacing):
        """Distance of a node from its place in the regular lattice, m, in f64."""
        offset = ti.Vector.zero(ti.f64, 3)
        if ti.static(self.state.features.perturbed):
            m, lane = self.column_of(i)
            own = self.state.node_vector(self.state.offset, s, ti.Vector([k, j, m]), lane)
            offset += ti.cast(own, ti.f64)
        return ti.cast(spacing, ti.f64) * offset

    @ti.func
    def velocity(self, s, k, j, i):
        """Velocity of a node, m/s."""
        m, lane = self.column_of(i)
        return self.state.node_vector(self.state.velocity, s, ti.Vector([k, j, m]), lane)

    @ti.func
    def put(self, now, s, k, j, i, displacement, velocity):
        """Set a node's displacement (m) and velocity (m/s)."""
        m, lane = self.column_of(i)
        length, width = ti.static(self.state.lanes.length, self.state.lanes.width)
        for sublattice, axis in ti.static(self.state.cell.node_axes):
            if s == sublattice:
                self.state.velocity[sublattice][axis][k, j, m][lane] = velocity[axis]
                u = ti.static(self.state.displacement[sublattice][axis])
                u[now, k, j, m][lane] = displacement[axis]
                if m < 2 * HALO and lane > 0:
                    u[now, k, j, m + length][lane - 1] = displacement[axis]
                if m >= length and lane < width - 1:
                    u[now, k, j, m - length][lane + 1] = displacement[axis]

    @ti.func
    def add_damping_loss(self, s, k, j, i, energy):
        """Add to the energy that a node has lost by damping, J."""
        m, lane = self.column_of(i)
        for sublattice in ti.static(range(self.state.cell.sublattices)):
            if s == sublattice:
                loss = self.state.damped[sublattice][k, j, m][lane] + energy
                self.state.damped[sublattice][k, j, m][lane] = loss
