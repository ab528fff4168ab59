"""Pass 2 of the step: bar forces gathered at the nodes and integrated in time (Eq. (3)).

Central differences: velocities are half a step behind displacements. The new displacement goes
into the other of two buffers, so no node sees a neighbour that has already been updated. Both
passes are gathers: nothing is summed atomically, and results do not depend on the number of
threads.

``at`` and ``step`` are the structs of ``bars``. In strips, ``at`` also has the ``strip`` that keeps
the velocities of a measured row. ``rows`` holds the rows of ``State.axial`` for the sites at
j - 1, j and j + 1.
"""

import taichi as ti

from taichi_ldem.model.cell import CORNER
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.state import State
from taichi_ldem.solver.volume import ModuleVolumes


@ti.func
def in_pairs(values: ti.template()):
    """Sum of a list: of halves, the first of which has a power of two of its values."""
    half = ti.static((1 << (len(values) - 1).bit_length()) // 2)
    if ti.static(half == 0):
        return values[0]
    else:
        return in_pairs(values[:half]) + in_pairs(values[half:])


@ti.data_oriented
class NodeUpdate:
    """Forces on nodes, their integration, and the energies that go with it."""

    def __init__(self, state: State, volumes: ModuleVolumes):
        self.state, self.volumes = state, volumes

    @ti.func
    def displacement_from_grid(
        self,
        s: ti.template(),
        axis: ti.template(),
        at: ti.template(),
        offset: ti.template(),
        step: ti.template(),
    ):
        """Displacement of nodes from their places in the regular lattice, m.

        Args:
            offset: (dz, dy, dx) of the nodes' column from ``at``.
        """
        k, j, m = at.k + offset[0], at.j + offset[1], at.m + offset[2]
        u = self.state.displacement[s][axis][step.now, k, j, m]
        if ti.static(self.state.features.perturbed):
            u += step.spacing * self.state.offset[s][axis][k, j, m]
        return u

    @ti.func
    def force(
        self, s: ti.template(), axis: ti.template(), rows, at: ti.template(), step: ti.template()
    ):
        """Sum of the bar forces on a column's corner or centre nodes along an axis, N.

        A bar with scalar a and vector X to its other node pulls with a (X + u' - u). The sums of
        a u', of a and of a X are computed separately, each in pairs.
        """
        a = [
            self.state.axial[bar][rows[home[1] + 1], at.k + home[0], at.m + home[2]]
            for bar, home in ti.static(self.state.cell.scalars[s])
        ]
        u = [
            self.displacement_from_grid(other, axis, at, there, step)
            for other, there in ti.static(self.state.cell.neighbours[s])
        ]
        ups, downs = ti.static(self.state.cell.levers[s][axis])
        pulls = in_pairs([scalar * far for scalar, far in ti.static(zip(a, u, strict=True))])
        lever = in_pairs([a[p] - a[q] for p, q in ti.static(zip(ups, downs, strict=True))])
        edges = a[ti.static(2 * axis)] - a[ti.static(2 * axis + 1)]
        here = self.displacement_from_grid(s, axis, at, (0, 0, 0), step)
        whole = edges + ti.static(self.state.cell.reach) * lever
        total = pulls + (step.spacing * whole - in_pairs(a) * here)
        if ti.static(self.state.features.volumetric and s == CORNER):
            total += self.volumes.force(axis, rows, at)
        return total

    @ti.func
    def free_velocity(
        self, s: ti.template(), axis: ti.template(), rows, at: ti.template(), step: ti.template()
    ):
        """Velocity along an axis after the time ``step.kick`` without rigid bodies, m/s."""
        inverse_mass = self.state.lane_inverse_masses(s, at.k, at.j, at.m)
        force = self.force(s, axis, rows, at, step)
        before = self.state.velocity[s][axis][at.k, at.j, at.m]
        after = before + (step.kick * inverse_mass) * force
        if ti.static(self.state.features.gravity):
            # the same in all nodes to the last bit, so that a body in free fall is not strained
            fall = step.kick * self.state.gravity[0][axis]
            for lane in ti.static(range(self.state.lanes.width)):
                if inverse_mass[lane] > 0:
                    after[lane] += fall
        if ti.static(self.state.features.damping):
            # C = alpha M at the mean of the two velocities: implicit, but diagonal
            half = 0.5 * step.damping * step.kick
            after = (after - half * before) / (1 + half)
        return after

    @ti.func
    def update_column(self, rows, at: ti.template(), step: ti.template(), measure: ti.template()):
        """Pass 2 for a column.

        Returns:
            with ``measure``, its kinetic energy and energy lost by damping at t_n, J.
        """
        k, j, m = at.k, at.j, at.m
        sums = ti.Vector.zero(ti.f64, 2)
        for s in ti.static(range(self.state.cell.sublattices)):
            for axis in ti.static(range(3)):
                after = self.free_velocity(s, axis, rows, at, step)
                if ti.static(measure or self.state.features.damping):
                    before = self.state.velocity[s][axis][k, j, m]
                    if ti.static(self.state.features.damping):
                        loss = self.damping_loss(s, at, before, after, step)
                        self.state.damped[s][k, j, m] = self.state.damped[s][k, j, m] + loss
                    if ti.static(measure):
                        sums += self.energies_between(s, at, before, after, step)
                self.state.velocity[s][axis][k, j, m] = after
                self.state.displacement[s][axis][1 - step.now, k, j, m] = (
                    self.state.displacement[s][axis][step.now, k, j, m] + step.drift * after
                )
            if ti.static(measure):
                sums += self.damping_loss_so_far(s, at)
        self.repeat_halo(1 - step.now, k, j, m)
        return sums

    @ti.func
    def store_velocities(self, strip, k, j, m):
        """Keep a column's velocities for ``column_energies``."""
        for s, axis in ti.static(self.state.cell.node_axes):
            self.state.velocity_before[s][axis][strip, k, m] = self.state.velocity[s][axis][k, j, m]

    @ti.func
    def column_energies(self, at: ti.template(), step: ti.template()):
        """Kinetic energy and energy lost by damping of a column that was just updated, at t_n, J.

        The velocities before the update are those of ``store_velocities``.
        """
        k, j, m = at.k, at.j, at.m
        sums = ti.Vector.zero(ti.f64, 2)
        for s in ti.static(range(self.state.cell.sublattices)):
            for axis in ti.static(range(3)):
                before = self.state.velocity_before[s][axis][at.strip, k, m]
                after = self.state.velocity[s][axis][k, j, m]
                sums += self.energies_between(s, at, before, after, step)
            sums += self.damping_loss_so_far(s, at)
        return sums

    @ti.func
    def damping_loss(self, s: ti.template(), at: ti.template(), before, after, step: ti.template()):
        """Energy that a column's nodes lose by damping along an axis in a step, J."""
        mean = 0.5 * (before + after)
        mass = self.state.lane_masses(s, at.k, at.j, at.m)
        return (step.damping * step.kick) * mass * mean * mean

    @ti.func
    def energies_between(
        self, s: ti.template(), at: ti.template(), before, after, step: ti.template()
    ):
        """A column's energies along an axis at t_n, from the velocities before and after it, J.

        Returns:
            its kinetic energy; less than zero, the part of this step's loss by damping that belongs
            after t_n.
        """
        mass = self.state.lane_masses(s, at.k, at.j, at.m)
        sums = ti.Vector.zero(ti.f64, 2)
        for lane in ti.static(range(self.state.lanes.width)):
            sums[0] += 0.5 * mass[lane] * before[lane] * after[lane]
        if ti.static(self.state.features.damping):
            mean = 0.5 * (before + after)
            loss = self.damping_loss(s, at, before, after, step)
            half = (0.5 * step.damping * step.kick) * mass * mean * before - loss
            for lane in ti.static(range(self.state.lanes.width)):
                sums[1] += half[lane]
        return sums

    @ti.func
    def damping_loss_so_far(self, s: ti.template(), at: ti.template()):
        """Energy lost by damping in a column, this step's included, as the second sum, J."""
        sums = ti.Vector.zero(ti.f64, 2)
        if ti.static(self.state.features.damping):
            for lane in ti.static(range(self.state.lanes.width)):
                sums[1] += ti.cast(self.state.damped[s][at.k, at.j, at.m][lane], ti.f64)
        return sums

    @ti.func
    def repeat_halo(self, buffer, k, j, m):
        """Copy a column's displacement to the columns that repeat it for another lane."""
        length, width = ti.static(self.state.lanes.length, self.state.lanes.width)
        if m < 2 * HALO:
            for s, axis in ti.static(self.state.cell.node_axes):
                u = ti.static(self.state.displacement[s][axis])
                for lane in ti.static(range(1, width)):
                    u[buffer, k, j, m + length][lane - 1] = u[buffer, k, j, m][lane]
        if m >= length:
            for s, axis in ti.static(self.state.cell.node_axes):
                u = ti.static(self.state.displacement[s][axis])
                for lane in ti.static(range(width - 1)):
                    u[buffer, k, j, m - length][lane + 1] = u[buffer, k, j, m][lane]
