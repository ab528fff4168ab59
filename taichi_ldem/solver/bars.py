"""Pass 1 of the step: the axial force of every bar, and the history of those that soften.

A bar is evaluated once; what is stored is one scalar, its axial force over its current length. All
lanes of a column are worked on at once. Damage is computed bar by bar, and only in lanes where the
elastic force comes close to that at eps_p or a bit marks a bar as no longer elastic.

Central differences let the force F of a bar change on a straight line within a step, so over a
change D of its length they count the energy (F_before + F_now) D / 2. That is exact while the law
is a straight line. Where it bends within a step (at eps_p, where a bar fails, where it is stretched
beyond its peak strain again, where a damaged one closes), energy would appear or vanish, and on
average always in the same direction. What is missing is given back at once, by a force in this step
that does just this work (``add_kink_force``): the energy decides over the force, as in a discrete
gradient (Gonzalez 1996).

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

CLOSE = 1 - 1e-5
"""Share of the force at eps_p from which a bar's strain is compared with it: within the rounding of
f32, so that the test of the force only spares bars that are well below."""


def _every(lane: Any) -> bool:
    return lane is ALL


@ti.data_oriented
class BarForces:
    """Stiffness, strain, damage and force of bars, from the fields of a lattice."""

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
    def peak_strain(self, bar: ti.template(), at: ti.template(), lane, family):
        """A bar's eps_p, given that of its family."""
        own = family
        if ti.static(self.state.features.strength):
            own = family * self.state.strength[bar][at.k, at.j, at.m][lane]
        return own

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
    def is_removed(self, bar: ti.template(), at: ti.template(), lane):
        """Whether a notch has removed a bar."""
        return (self.state.removed[at.k, at.j, at.m][lane] >> bar) & 1 != 0

    # -- damage ------------------------------------------------------------------------------------

    @ti.func
    def apply_damage(self, lanes, at: ti.template(), step: ti.template()):
        """Update the history of the chosen lanes' bars and reduce their stored forces.

        Args:
            lanes: a bit for each lane.
        """
        for lane in range(self.state.lanes.width):
            if (lanes >> lane) & 1:
                bends, strains = 0, ti.Vector.zero(float, self.state.cell.bars)
                peaks = ti.Vector.zero(float, self.state.cell.bars)
                for bar in ti.static(range(self.state.cell.bars)):
                    whole = self.state.axial[bar][at.row, at.k, at.m][lane]
                    if self.may_soften(bar, whole, at, step, lane):
                        strain = self.strain(self.twice_green_strain(bar, at, step, lane))
                        strains[bar] = strain
                        if ti.static(self.state.features.damage):
                            peaks[bar] = self.state.peak[bar][at.k, at.j, at.m][lane]
                        share = self.updated_integrity(bar, strain, at, step, lane)
                        self.state.axial[bar][at.row, at.k, at.m][lane] = share * whole
                        if ti.static(self.state.features.damage):
                            bends |= self.may_bend(bar, peaks[bar], at, lane) << bar
                if ti.static(self.state.features.damage):
                    # not unrolled, as it is long and seldom needed
                    for bar in range(self.state.cell.bars):
                        if (bends >> bar) & 1:
                            self.add_kink_force(bar, strains[bar], peaks[bar], at, step, lane)

    @ti.func
    def may_soften(self, bar: ti.template(), force, at: ti.template(), step: ti.template(), lane):
        """Whether a bar is removed, has passed its eps_p, or is CLOSE to it by its force."""
        found = False
        if ti.static(self.state.features.damage):
            own = self.peak_strain(bar, at, lane, step.peak_strain)
            most = CLOSE / (1 + 1 / own) * self.stiffness(bar, at, lane)
            peak = self.state.peak[bar][at.k, at.j, at.m][lane]
            found |= force > most or peak > 1
            if ti.static(self.state.features.crack):
                found |= peak < 0
        if ti.static(self.state.features.notch):
            found |= self.is_removed(bar, at, lane)
        return found

    @ti.func
    def updated_integrity(
        self, bar: ti.template(), strain, at: ti.template(), step: ti.template(), lane
    ):
        """Share of its elastic force that a bar carries, after its history has been updated."""
        k, j, m = at.k, at.j, at.m
        share = 1.0
        if ti.static(self.state.features.notch):
            if self.is_removed(bar, at, lane):
                share = 0.0
        if ti.static(self.state.features.damage):
            if share > 0:
                peak = self.state.peak[bar][k, j, m][lane]
                own = self.peak_strain(bar, at, lane, step.peak_strain)
                if strain > peak * own and peak >= 0:
                    peak = strain / own
                    self.state.peak[bar][k, j, m][lane] = peak
                if peak > 1 or peak < 0:
                    # no atomic: a thread that evaluates the same column writes the same
                    bits = int(self.state.touched[k, j, m]) | 1 << lane
                    self.state.touched[k, j, m] = ti.cast(bits, ti.u8)
                share = self.integrity(bar, strain, peak)
        return share

    # -- steps in which the law bends --------------------------------------------------------------

    @ti.func
    def last_stretching(
        self, near, far, rest, strain, at: ti.template(), step: ti.template(), lane
    ):
        """Strain of a bar at the step less that one step before, from the velocities between.

        No node may have been moved in this step yet.

        Args:
            near, far: (4,) sublattice of an end, and offset (dz, dy, dx) of its site.
            rest: (3,) vector between the ends in the regular lattice, in module edges.
        """
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

    @ti.func
    def energy(self, bar: ti.template(), strain, peak, own):
        """Energy that a bar stores and has dissipated over EA L0, f64.

        Args:
            peak: peak strain over its eps_p; own: its eps_p.
        """
        e, p = ti.cast(strain, ti.f64), ti.cast(peak, ti.f64)
        return 0.5 * self.integrity(bar, e, p) * e * e + self.dissipated(bar, p) * own * own

    @ti.func
    def may_bend(self, bar: ti.template(), before, at: ti.template(), lane):
        """1 where the law of a bar may have bent in the last step, given its peak before it.

        Failed bars that close and open again are left out: as debris under a striker, which is held
        and pushed by much else at the same time, they would gain energy.
        """
        bends = self.state.peak[bar][at.k, at.j, at.m][lane] > 1
        bends &= not self.has_failed(bar, before) and self.stiffness(bar, at, lane) > 0
        return ti.cast(bends, ti.i32)

    @ti.func
    def add_kink_force(self, bar, strain, before, at: ti.template(), step: ti.template(), lane):
        """Add the force that makes up for a bend of the law in the last step to a stored one.

        Let D be the last change of the bar's length and M the energy that (F_before + F_now) D / 2
        leaves out. An additional force C in this step does the work C (D + D') / 2, where D' is the
        next change. Without C, the ends would go on by D and by what the bar has lost of its pull;
        C itself shortens D' by S C, with S = dt^2 (1 / m_1 + 1 / m_2). So

            C (W - S C / 2) = M,    W = D + S (loss of pull) / 2,

        of which the smaller root is taken. At most the energy W^2 / (2 S) can be had in this way.
        In the code, forces are over EA, and lengths over L0.

        Args:
            bar: its number, not known when the kernel is compiled.
            before: peak strain over eps_p one step before.
        """
        near, far, rest = self.ends(bar)
        family, after, own, stiffness = 0, 0.0, 0.0, 0.0
        for one in ti.static(range(self.state.cell.bars)):
            if one == bar:
                family = self.state.cell.family[one]
                after = self.state.peak[one][at.k, at.j, at.m][lane]
                own = self.peak_strain(one, at, lane, step.peak_strain)
                stiffness = self.stiffness(one, at, lane)
        change = ti.cast(self.last_stretching(near, far, rest, strain, at, step, lane), ti.f64)
        missing, loss = self.left_out(family, strain, change, before, after, own)
        soft = ti.cast(stiffness * self.mobility(near, far, at, lane), ti.f64)
        soft *= step.kick * step.drift
        force = stiffness * ti.cast(self.root(change + 0.5 * soft * loss, soft, missing), float)
        force /= ti.max(1 + strain, ti.static(TINY**0.5))
        for one in ti.static(range(self.state.cell.bars)):
            if one == bar:
                stored = self.state.axial[one][at.row, at.k, at.m][lane]
                self.state.axial[one][at.row, at.k, at.m][lane] = stored + force

    @ti.func
    def ends(self, bar):
        """Both ends of a bar and the vector between them; its number may be a run-time one."""
        near, far, rest = ti.Vector([0] * 4), ti.Vector([0] * 4), ti.Vector.zero(float, 3)
        for one in ti.static(range(self.state.cell.bars)):
            if one == bar:
                near, far = self.end(one, 0), self.end(one, 1)
                rest = self.vector(one)
        return near, far, rest

    @ti.func
    def end(self, bar: ti.template(), which: ti.template()):
        """(4,) sublattice of an end of a bar, and offset (dz, dy, dx) of its site."""
        s, offset = ti.static(self.state.cell.ends[bar][which])
        return ti.Vector([s, offset[0], offset[1], offset[2]])

    @ti.func
    def vector(self, bar: ti.template()):
        """(3,) vector between the ends of a bar in the regular lattice, in module edges."""
        return ti.Vector([ti.static(float(self.state.cell.vectors[bar][n])) for n in range(3)])

    @ti.func
    def left_out(self, family, strain, change, before, after, own):
        """M of a bar over EA L0, and the loss of pull over EA; 0 where its law has not bent."""
        missing, loss = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        old = strain - change
        for one in ti.static(range(self.state.cell.families)):
            if one == family:
                bar = ti.static(self.state.cell.family.index(one))
                was, share = self.integrity(bar, old, before), self.integrity(bar, strain, after)
                if was != share:
                    missing = self.energy(bar, strain, after, own)
                    missing -= self.energy(bar, old, before, own)
                    missing -= 0.5 * (was * old + share * strain) * change
                    loss = ti.cast((was - share) * strain, ti.f64)
        return missing, loss

    @ti.func
    def root(self, way, soft, missing):
        """The smaller C of C (way - soft C / 2) = missing, or of the closest that C can reach."""
        most = way * way / ti.max(2 * soft, 1e-30)  # nodes that are only kicked do not move
        energy = ti.max(-most, ti.min(most, missing))
        size = ti.abs(way) + ti.sqrt(ti.max(way * way - 2 * soft * energy, 0.0))
        result = 0 * way
        if size > 0:
            result = 2 * energy / size
            if way < 0:
                result = -result
        return result

    @ti.func
    def mobility(self, near, far, at: ti.template(), lane):
        """Sum of the inverse masses of a bar's ends (``end``), 1/kg."""
        k, j, i = at.k, at.j, self.access.site_of(at.m, lane)
        first = self.access.mass(near[0], k + near[1], j + near[2], i + near[3])
        return 1 / first + 1 / self.access.mass(far[0], k + far[1], j + far[2], i + far[3])

    # -- the pass ----------------------------------------------------------------------------------

    @ti.func
    def column_forces(self, at: ti.template(), step: ti.template()):
        """Store the axial force over current length of the bars of a column's sites.

        With r = l / L0 = sqrt(1 + q), EA/L0 (r - 1) / r = EA/L0 q / (r^2 + r).
        """
        k, j, m = at.k, at.j, at.m
        force = ti.Matrix.zero(float, self.state.cell.bars, self.state.lanes.width)
        # excess of the forces over that of a bar close to eps_p
        excess = ti.Vector.zero(float, self.state.lanes.width)
        least = step.peak_strain
        if ti.static(self.state.features.strength):
            least = step.peak_strain * self.state.weakest[k, j, m]
        allowed = CLOSE / (1 + 1 / least)
        for bar in ti.static(range(self.state.cell.bars)):
            whole = self.stiffness_of_lanes(bar, at)
            q = self.twice_green_strain(bar, at, step, ALL)
            square = ti.max(1 + q, TINY)
            pull = (whole * q) / (square + ti.sqrt(square))
            for lane in ti.static(range(self.state.lanes.width)):
                force[bar, lane] = pull[lane]
            if ti.static(self.state.features.damage):
                excess = ti.max(excess, pull - whole * allowed)
        # all arithmetic before the first store: after it the compiler reloads every address
        for bar in ti.static(range(self.state.cell.bars)):
            for lane in ti.static(range(self.state.lanes.width)):
                self.state.axial[bar][at.row, k, m][lane] = force[bar, lane]
        if ti.static(self.state.features.history):
            inelastic = self.state.touched[k, j, m] != 0
            for lane in ti.static(range(self.state.lanes.width)):
                inelastic |= excess[lane] > 0
            if inelastic:
                lanes = int(self.state.touched[k, j, m])
                for lane in ti.static(range(self.state.lanes.width)):
                    lanes |= int(excess[lane] > 0) << lane
                self.apply_damage(lanes, at, step)
