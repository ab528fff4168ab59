"""Bars: their stiffness, strain and law, from the fields of a lattice.

Functions take the place of a column as a struct ``at`` with the integers ``k``, ``j``, ``m`` (the
column) and, where bar scalars are stored, ``row`` (of ``State.axial``). The struct ``step`` holds
the buffer ``now`` and the numbers of the step (see ``solver.step``).
"""

import taichi as ti

from taichi_ldem.solver.access import NodeAccess
from taichi_ldem.solver.state import State

TINY = 1e-12
"""Least square of a bar's length ratio, as the direction of a bar of zero length is undefined."""


@ti.data_oriented
class LatticeBars:
    """Stiffness, strain and law of bars, from the fields of a lattice.

    Functions ``of_lanes`` take every lane of a column at once, and know the bar when they are
    compiled: the step takes them for every bar. The others take one lane, and look up what the bar
    is in tables, so that they stand in a kernel once and not once for each bar. Both give the same
    bits.
    """

    def __init__(self, state: State, access: NodeAccess):
        self.state, self.access = state, access

    # -- every lane of a column --------------------------------------------------------------------

    @ti.func
    def stiffness_of_lanes(self, bar: ti.template(), at: ti.template()):
        """EA/L0 of a bar in every lane, N/m; 0 where there is none."""
        k, j, m = at.k, at.j, at.m
        kind = ti.static(self.state.cell.stiffness_kind[bar])
        whole = self.state.lane_entries(self.state.stiffness, self.state.code[k, j, m], kind)
        if ti.static(self.state.features.modulus):
            whole *= self.state.modulus[bar, k, j, m]
        if ti.static(self.state.features.perturbed):
            whole *= ti.sqrt(self.square_of_length_ratio_of_lanes(bar, at))
        return whole

    @ti.func
    def vector_of_lanes(self, bar: ti.template(), axis: ti.template(), at: ti.template()):
        """Component of the vector along a bar of a perturbed lattice at rest, in module edges."""
        k, j, m = at.k, at.j, at.m
        first, second = ti.static(self.state.cell.ends[bar])
        a, b = ti.static(first[1], second[1])
        far = ti.static(self.state.offset[second[0]][axis])
        near = ti.static(self.state.offset[first[0]][axis])
        along = ti.static(float(self.state.cell.vectors[bar][axis]))
        return along + (far[k + b[0], j + b[1], m + b[2]] - near[k + a[0], j + a[1], m + a[2]])

    @ti.func
    def square_of_length_ratio_of_lanes(self, bar: ti.template(), at: ti.template()):
        """Square of a bar's length in the regular lattice over that in the perturbed one."""
        x, y, z = [self.vector_of_lanes(bar, axis, at) for axis in ti.static(range(3))]
        return ti.static(self.state.cell.length_squared[bar]) / ((x * x + y * y) + z * z)

    @ti.func
    def square_difference_of_lanes(
        self, bar: ti.template(), axis: ti.template(), at: ti.template(), step: ti.template()
    ):
        """(2 X + d) d: the square of a bar's component along an axis less that at rest, m2."""
        now, k, j, m = step.now, at.k, at.j, at.m
        first, second = ti.static(self.state.cell.ends[bar])
        a, b = ti.static(first[1], second[1])
        far = ti.static(self.state.displacement[second[0]][axis])
        near = ti.static(self.state.displacement[first[0]][axis])
        d = far[now, k + b[0], j + b[1], m + b[2]] - near[now, k + a[0], j + a[1], m + a[2]]
        twice = ti.static(float(2 * self.state.cell.vectors[bar][axis]))
        result = d * d
        if ti.static(self.state.features.perturbed):
            result = (d + (2 * step.spacing) * self.vector_of_lanes(bar, axis, at)) * d
        elif ti.static(twice != 0):
            result = (d + twice * step.spacing) * d
        return result

    @ti.func
    def twice_green_strain_of_lanes(
        self, bar: ti.template(), at: ti.template(), step: ti.template()
    ):
        """q = (l^2 - L0^2) / L0^2 = (2 X + d).d / L0^2 of a bar in every lane.

        The engineering strain is q / (1 + sqrt(1 + q)): no cancellation at small strain, and exact
        at any rotation.
        """
        x, y, z = [
            self.square_difference_of_lanes(bar, axis, at, step) for axis in ti.static(range(3))
        ]
        inverse = ti.static(1 / self.state.cell.length_squared[bar])
        result = ((x + y) + z) * (inverse / (step.spacing * step.spacing))
        if ti.static(self.state.features.perturbed):
            result *= self.square_of_length_ratio_of_lanes(bar, at)
        return result

    # -- one lane ----------------------------------------------------------------------------------

    @ti.func
    def stiffness(self, bar, at: ti.template(), lane):
        """EA/L0 of a bar, N/m; 0 where there is none."""
        k, j, m = at.k, at.j, at.m
        whole = self.state.stiffness[int(self.state.code[k, j, m][lane])][self.state.kinds[bar][1]]
        if ti.static(self.state.features.modulus):
            whole *= self.state.modulus[bar, k, j, m][lane]
        if ti.static(self.state.features.perturbed):
            whole *= ti.sqrt(self.square_of_length_ratio(bar, self.vector(bar, at, lane)))
        return whole

    @ti.func
    def family(self, bar):
        """Number of a bar's family."""
        return self.state.kinds[bar][0]

    @ti.func
    def ends(self, bar):
        """Both ends of a bar and the vector between them, in module edges.

        An end is (4,) sublattice and offset (dz, dy, dx) of its site.
        """
        return self.state.ends[bar, 0], self.state.ends[bar, 1], self.state.vector[bar]

    @ti.func
    def vector(self, bar, at: ti.template(), lane):
        """Vector along a bar at rest, in module edges."""
        near, far, along = self.ends(bar)
        if ti.static(self.state.features.perturbed):
            along += self.offset_of(far, at, lane) - self.offset_of(near, at, lane)
        return along

    @ti.func
    def offset_of(self, end, at: ti.template(), lane):
        """Distance of a bar's end from its place in the regular lattice, in module edges."""
        place = ti.Vector([at.k + end[1], at.j + end[2], at.m + end[3]])
        return self.state.node_vector(self.state.offset, end[0], place, lane)

    @ti.func
    def displacement_of(self, end, at: ti.template(), step: ti.template(), lane):
        """Displacement of a bar's end, m."""
        place = ti.Vector([step.now, at.k + end[1], at.j + end[2], at.m + end[3]])
        return self.state.node_vector(self.state.displacement, end[0], place, lane)

    @ti.func
    def velocity_of(self, end, at: ti.template(), lane):
        """Velocity of a bar's end, m/s; columns that repeat a node do not have it."""
        m, own = self.access.owner_of(at.m + end[3], lane)
        place = ti.Vector([at.k + end[1], at.j + end[2], m])
        return self.state.node_vector(self.state.velocity, end[0], place, own)

    @ti.func
    def square_of_length_ratio(self, bar, x):
        """Square of a bar's length in the regular lattice over that of its ``vector`` x."""
        return self.state.lengths[bar][1] / ((x[0] * x[0] + x[1] * x[1]) + x[2] * x[2])

    @ti.func
    def length_at_rest(self, bar, at: ti.template(), step: ti.template(), lane):
        """L0 of a bar, m."""
        length = step.spacing * self.state.lengths[bar][0]
        if ti.static(self.state.features.perturbed):
            length /= ti.sqrt(self.square_of_length_ratio(bar, self.vector(bar, at, lane)))
        return length

    @ti.func
    def peak_strain(self, bar, at: ti.template(), lane, family):
        """A bar's eps_p, given that of its family."""
        own = family
        if ti.static(self.state.features.strength):
            own = family * self.state.strength[bar, at.k, at.j, at.m][lane]
        return own

    @ti.func
    def is_removed(self, bar, at: ti.template(), lane):
        """Whether a notch has removed a bar."""
        return (self.state.removed[at.k, at.j, at.m][lane] >> bar) & 1 != 0

    @ti.func
    def twice_green_strain(self, bar, at: ti.template(), step: ti.template(), lane):
        """q of a bar (``twice_green_strain_of_lanes``)."""
        near, far, _ = self.ends(bar)
        d = self.displacement_of(far, at, step, lane) - self.displacement_of(near, at, step, lane)
        x = self.vector(bar, at, lane)
        part = (d + (2 * step.spacing) * x) * d
        inverse = self.state.lengths[bar][2]
        result = ((part[0] + part[1]) + part[2]) * (inverse / (step.spacing * step.spacing))
        if ti.static(self.state.features.perturbed):
            result *= self.square_of_length_ratio(bar, x)
        return result

    @ti.func
    def strain(self, q):
        """Engineering strain l / L0 - 1 from q, twice the Green strain."""
        return q / (1 + ti.sqrt(ti.max(1 + q, TINY)))

    @ti.func
    def last_stretching(self, bar, strain, at: ti.template(), step: ti.template(), lane):
        """Strain of a bar at the step less that one step before, from the velocities between.

        No node may have been moved in this step yet.

        Args:
            strain: its engineering strain at the step.
        """
        near, far, rest = self.ends(bar)
        v = self.velocity_of(far, at, lane) - self.velocity_of(near, at, lane)
        x = step.spacing * rest
        x += self.displacement_of(far, at, step, lane) - self.displacement_of(near, at, step, lane)
        if ti.static(self.state.features.perturbed):
            spacing = ti.cast(step.spacing, ti.f64)
            offset = spacing * ti.cast(self.offset_of(far, at, lane), ti.f64)
            offset -= spacing * ti.cast(self.offset_of(near, at, lane), ti.f64)
            x += ti.cast(offset, float)
        return step.drift * x.dot(v) * (1 + strain) / ti.max(x.dot(x), TINY * step.spacing**2)

    # -- the softening law -------------------------------------------------------------------------

    @ti.func
    def failure(self, bar):
        """Peak strain over eps_p at which a bar fails."""
        return self.state.softening[self.family(bar)][0]

    @ti.func
    def has_failed(self, bar, peak):
        """Whether a bar with a peak strain over eps_p has failed; less than 0: at a crack's tip."""
        failed = peak >= self.failure(bar)
        if ti.static(self.state.features.crack):
            failed |= peak < 0
        return failed

    @ti.func
    def integrity(self, bar, strain, peak):
        """Share of its stiffness that a bar has at a strain, given its peak strain over eps_p.

        A bar is whole in compression until it fails, and with ``closing`` also afterwards.
        """
        family = self.family(bar)
        failure, parameter = self.state.softening[family][0], self.state.softening[family][1]
        share = 1 + 0 * peak  # of the same precision
        if self.has_failed(bar, peak):
            share = 0.0
            if ti.static(self.state.features.closing):
                if strain < 0:
                    share = 1.0
        elif peak > 1 and strain > 0:
            share = self.state.law.softening(peak, failure, parameter) / peak
        return share

    @ti.func
    def dissipated(self, bar, peak):
        """Energy that a bar has dissipated at a peak strain, in units of EA eps_p^2 L0."""
        family = self.family(bar)
        failure, parameter = self.state.softening[family][0], self.state.softening[family][1]
        energy = 0 * peak  # of the same precision
        if peak >= failure:
            energy = 0.5
            if failure > 1:
                energy += self.state.law.area(failure, failure, parameter)
        elif peak > 1:
            force = self.state.law.softening(peak, failure, parameter)
            energy = 0.5 + self.state.law.area(peak, failure, parameter) - 0.5 * force * peak
        if ti.static(self.state.features.crack):
            if peak < 0:
                energy = -peak
        return energy

    @ti.func
    def energy(self, bar, strain, peak, own):
        """Energy that a bar stores and has dissipated over EA L0, f64.

        Args:
            peak: peak strain over its eps_p; own: its eps_p.
        """
        e, p = ti.cast(strain, ti.f64), ti.cast(peak, ti.f64)
        return 0.5 * self.integrity(bar, e, p) * e * e + self.dissipated(bar, p) * own * own
