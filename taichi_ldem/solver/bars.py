"""Bars: their stiffness, strain and law, from the fields of a lattice.

Functions take the place of a column as a struct ``at`` with the integers ``k``, ``j``, ``m`` (the
column) and, where bar scalars are stored, ``row`` (of ``State.axial``). The struct ``step`` holds
the buffer ``now`` and the numbers of the step (see ``solver.step``).
"""

from typing import Any

import taichi as ti

from taichi_ldem.solver.access import NodeAccess
from taichi_ldem.solver.state import State

ALL = None
"""In place of a lane: every lane of a column at once."""

TINY = 1e-12
"""Least square of a bar's length ratio, as the direction of a bar of zero length is undefined."""


def _every(lane: Any) -> bool:
    return lane is ALL


@ti.data_oriented
class LatticeBars:
    """Stiffness, strain and law of bars, from the fields of a lattice."""

    def __init__(self, state: State, access: NodeAccess):
        self.state, self.access = state, access

    # -- a bar's own properties --------------------------------------------------------------------

    @ti.func
    def stiffness_of_lanes(self, bar: ti.template(), at: ti.template()):
        """EA/L0 of a bar in every lane, N/m; 0 where there is none."""
        k, j, m = at.k, at.j, at.m
        kind = ti.static(self.state.cell.stiffness_kind[bar])
        whole = self.state.lane_entries(self.state.stiffness, self.state.code[k, j, m], kind)
        if ti.static(self.state.features.modulus):
            whole *= self.state.modulus[bar][k, j, m]
        if ti.static(self.state.features.perturbed):
            whole *= ti.sqrt(self.square_of_length_ratio(bar, at, ALL))
        return whole

    @ti.func
    def stiffness(self, bar: ti.template(), at: ti.template(), lane):
        """EA/L0 of a bar in one lane, N/m; 0 where there is none."""
        k, j, m = at.k, at.j, at.m
        kind = ti.static(self.state.cell.stiffness_kind[bar])
        whole = self.state.stiffness[int(self.state.code[k, j, m][lane])][kind]
        if ti.static(self.state.features.modulus):
            whole *= self.state.modulus[bar][k, j, m][lane]
        if ti.static(self.state.features.perturbed):
            whole *= ti.sqrt(self.square_of_length_ratio(bar, at, lane))
        return whole

    @ti.func
    def perturbed_vector(
        self, bar: ti.template(), axis: ti.template(), at: ti.template(), lane: ti.template()
    ):
        """Component of the vector along a bar of a perturbed lattice at rest, in module edges."""
        k, j, m = at.k, at.j, at.m
        first, second = ti.static(self.state.cell.ends[bar])
        a, b = ti.static(first[1], second[1])
        far = ti.static(self.state.offset[second[0]][axis])
        near = ti.static(self.state.offset[first[0]][axis])
        along = ti.static(float(self.state.cell.vectors[bar][axis]))
        if ti.static(_every(lane)):
            return along + (far[k + b[0], j + b[1], m + b[2]] - near[k + a[0], j + a[1], m + a[2]])
        else:
            return along + (
                far[k + b[0], j + b[1], m + b[2]][lane] - near[k + a[0], j + a[1], m + a[2]][lane]
            )

    @ti.func
    def square_of_length_ratio(self, bar: ti.template(), at: ti.template(), lane: ti.template()):
        """Square of a bar's length in the regular lattice over that in the perturbed one."""
        x, y, z = [self.perturbed_vector(bar, axis, at, lane) for axis in ti.static(range(3))]
        return ti.static(self.state.cell.length_squared[bar]) / ((x * x + y * y) + z * z)

    @ti.func
    def length_at_rest(self, bar: ti.template(), at: ti.template(), step: ti.template(), lane):
        """L0 of a bar, m."""
        length = step.spacing * ti.static(self.state.cell.length_squared[bar] ** 0.5)
        if ti.static(self.state.features.perturbed):
            length /= ti.sqrt(self.square_of_length_ratio(bar, at, lane))
        return length

    @ti.func
    def peak_strain(self, bar: ti.template(), at: ti.template(), lane, family):
        """A bar's eps_p, given that of its family."""
        own = family
        if ti.static(self.state.features.strength):
            own = family * self.state.strength[bar][at.k, at.j, at.m][lane]
        return own

    @ti.func
    def is_removed(self, bar: ti.template(), at: ti.template(), lane):
        """Whether a notch has removed a bar."""
        return (self.state.removed[at.k, at.j, at.m][lane] >> bar) & 1 != 0

    @ti.func
    def ends(self, bar):
        """Both ends of a bar and the vector between them; its number may be a run-time one.

        An end is (4,) sublattice and offset (dz, dy, dx) of its site. They come from tables, as a
        branch for each bar would take long to compile.
        """
        return self.state.ends[bar, 0], self.state.ends[bar, 1], self.state.vector[bar]

    # -- strain ------------------------------------------------------------------------------------

    @ti.func
    def relative_displacement(
        self,
        bar: ti.template(),
        axis: ti.template(),
        at: ti.template(),
        step: ti.template(),
        lane: ti.template(),
    ):
        """Displacement of a bar's second node less that of its first, along an axis, m."""
        now, k, j, m = step.now, at.k, at.j, at.m
        first, second = ti.static(self.state.cell.ends[bar])
        a, b = ti.static(first[1], second[1])
        far = ti.static(self.state.displacement[second[0]][axis])
        near = ti.static(self.state.displacement[first[0]][axis])
        if ti.static(_every(lane)):
            return far[now, k + b[0], j + b[1], m + b[2]] - near[now, k + a[0], j + a[1], m + a[2]]
        else:
            return (
                far[now, k + b[0], j + b[1], m + b[2]][lane]
                - near[now, k + a[0], j + a[1], m + a[2]][lane]
            )

    @ti.func
    def square_difference(
        self,
        bar: ti.template(),
        axis: ti.template(),
        at: ti.template(),
        step: ti.template(),
        lane: ti.template(),
    ):
        """(2 X + d) d: the square of a bar's component along an axis less that at rest, m2."""
        d = self.relative_displacement(bar, axis, at, step, lane)
        twice = ti.static(float(2 * self.state.cell.vectors[bar][axis]))
        result = d * d
        if ti.static(self.state.features.perturbed):
            result = (d + (2 * step.spacing) * self.perturbed_vector(bar, axis, at, lane)) * d
        elif ti.static(twice != 0):
            result = (d + twice * step.spacing) * d
        return result

    @ti.func
    def twice_green_strain(
        self, bar: ti.template(), at: ti.template(), step: ti.template(), lane: ti.template()
    ):
        """q = (l^2 - L0^2) / L0^2 = (2 X + d).d / L0^2 of a bar, in one lane or in ALL.

        The engineering strain is q / (1 + sqrt(1 + q)): no cancellation at small strain, and exact
        at any rotation.
        """
        x, y, z = ti.static(range(3))
        square = (
            self.square_difference(bar, x, at, step, lane)
            + self.square_difference(bar, y, at, step, lane)
        ) + self.square_difference(bar, z, at, step, lane)
        inverse = ti.static(1 / self.state.cell.length_squared[bar])
        result = square * (inverse / (step.spacing * step.spacing))
        if ti.static(self.state.features.perturbed):
            result *= self.square_of_length_ratio(bar, at, lane)
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
            bar: its number, not known when the kernel is compiled.
            strain: its engineering strain at the step.
        """
        near, far, rest = self.ends(bar)
        k, j, i, now = at.k, at.j, self.access.site_of(at.m, lane), step.now
        s, a, b, c = near[0], k + near[1], j + near[2], i + near[3]
        t, d, e, f = far[0], k + far[1], j + far[2], i + far[3]
        v = self.access.velocity(t, d, e, f) - self.access.velocity(s, a, b, c)
        x = step.spacing * rest
        x += self.access.displacement(now, t, d, e, f) - self.access.displacement(now, s, a, b, c)
        if ti.static(self.state.features.perturbed):
            offset = self.access.offset(t, d, e, f, step.spacing)
            x += ti.cast(offset - self.access.offset(s, a, b, c, step.spacing), float)
        return step.drift * x.dot(v) * (1 + strain) / ti.max(x.dot(x), TINY * step.spacing**2)

    # -- the softening law -------------------------------------------------------------------------

    @ti.func
    def failure(self, bar: ti.template()):
        """Peak strain over eps_p at which a bar fails."""
        return self.state.softening[ti.static(self.state.cell.family[bar])][0]

    @ti.func
    def has_failed(self, bar: ti.template(), peak):
        """Whether a bar with a peak strain over eps_p has failed; less than 0: at a crack's tip."""
        failed = peak >= self.failure(bar)
        if ti.static(self.state.features.crack):
            failed |= peak < 0
        return failed

    @ti.func
    def integrity(self, bar: ti.template(), strain, peak):
        """Share of its stiffness that a bar has at a strain, given its peak strain over eps_p.

        A bar is whole in compression until it fails, and with ``closing`` also afterwards.
        """
        family = ti.static(self.state.cell.family[bar])
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
    def dissipated(self, bar: ti.template(), peak):
        """Energy that a bar has dissipated at a peak strain, in units of EA eps_p^2 L0."""
        family = ti.static(self.state.cell.family[bar])
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
    def energy(self, bar: ti.template(), strain, peak, own):
        """Energy that a bar stores and has dissipated over EA L0, f64.

        Args:
            peak: peak strain over its eps_p; own: its eps_p.
        """
        e, p = ti.cast(strain, ti.f64), ti.cast(peak, ti.f64)
        return 0.5 * self.integrity(bar, e, p) * e * e + self.dissipated(bar, p) * own * own
