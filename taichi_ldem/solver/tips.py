"""Cracks that grow where their growth releases G_f: the pass before pass 1 of a step.

The paper's law knows a bar's own strain only, and a lattice whose modules are not far smaller than
l_ch must be loaded beyond G_f before the bar at a crack's tip reaches eps_p. With
``material.fracture = "crack"`` a bar also fails where this would release what it costs:

    F w / 2 >= G_f A^f,     w <= c (l - L0).

F is its force and w the largest elongation of the failed bars at its two nodes, which tells how far
its own ends would part: the work that closes a crack by one bar again, as in virtual crack closure
(Rybicki and Kanninen 1977). The bound on w is the opening next to a tip in linear elasticity; it
keeps the flanks of a wide open crack from failing under any small tension along them.

Openings are those at the displacement of the step, and a bar counts as failed from the step after
its failure on, so the order of threads changes nothing.

Where modules have an energy of their volume, bars carry a part of the stress only. F is then the
force of a bar that carried the volumes' share as well, as those of the same solid with nu = 1/4 do.
"""

import math

import taichi as ti

from taichi_ldem.scene.equations import QUARTER
from taichi_ldem.solver.access import NodeAccess
from taichi_ldem.solver.bars import BarForces
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.state import State

PASSED = 4 * math.pi
"""Opening over a bar's elongation from which on the tip has passed the bar: it is on a flank.

Twice that next to a tip in linear elasticity.
"""


@ti.data_oriented
class CrackTips:
    """Openings of cracks at nodes, and the bars that fail for them."""

    def __init__(self, state: State, bars: BarForces, access: NodeAccess):
        self.state, self.bars, self.access = state, bars, access

    # -- openings ----------------------------------------------------------------------------------

    @ti.func
    def note_failed(self, at: ti.template(), lane):
        """Bring ``known`` up to date for a site, and mark what is near bars that are new in it."""
        k, j, m = at.k, at.j, at.m
        before, bits = int(self.state.known[k, j, m][lane]), 0
        if ti.static(self.state.features.notch):
            bits = int(self.state.removed[k, j, m][lane])
        stiffness = self.state.stiffness[int(self.state.code[k, j, m][lane])]
        for bar in ti.static(range(self.state.cell.bars)):
            if self.bars.has_failed(bar, self.state.peak[bar][k, j, m][lane]):
                bits |= 1 << bar
            if stiffness[ti.static(self.state.cell.stiffness_kind[bar])] == 0:
                bits &= ~(1 << bar)
            if (bits >> bar) & 1 and (before >> bar) & 1 == 0:
                self.mark_near(bar, at, lane)
        self.state.known[k, j, m][lane] = ti.cast(bits, ti.u16)

    @ti.func
    def mark_near(self, bar: ti.template(), at: ti.template(), lane):
        """Mark the columns whose bars may share a node with one; all threads write the same."""
        i = self.access.site_of(at.m, lane)
        for end in ti.static(range(2)):
            o = ti.static(self.state.cell.ends[bar][end][1])
            for dz, dy, dx in ti.ndrange((-1, 2), (-1, 2), (-1, 2)):
                k, j, there = at.k + o[0] + dz, at.j + o[1] + dy, i + o[2] + dx
                inside = 0 < k < ti.static(self.state.sites[0] - 1)
                inside &= 0 < j < ti.static(self.state.sites[1] - 1)
                inside &= 0 < there < ti.static(self.state.sites[2] - 1)
                if inside:
                    m, _ = self.access.column_of(there)
                    self.state.near[k, j, m] = ti.cast(1, ti.u8)

    @ti.func
    def is_known(self, bar: ti.template(), at: ti.template(), lane):
        """Whether a bar had failed or was removed before this step."""
        return (int(self.state.known[at.k, at.j, at.m][lane]) >> bar) & 1 != 0

    @ti.func
    def forget_openings(self, bar: ti.template(), at: ti.template(), lane):
        """Set the openings at the two nodes of a failed bar to zero."""
        i = self.access.site_of(at.m, lane)
        for end in ti.static(range(2)):
            s, o = ti.static(self.state.cell.ends[bar][end])
            self.state.opening[s][at.k + o[0], at.j + o[1], i + o[2]] = 0.0
            self.state.failed[s][at.k + o[0], at.j + o[1], i + o[2]] = 0

    @ti.func
    def raise_opening(self, bar: ti.template(), at: ti.template(), lane, elongation):
        """Let the two nodes of a failed bar have at least its elongation as their opening, m."""
        i = self.access.site_of(at.m, lane)
        for end in ti.static(range(2)):
            s, o = ti.static(self.state.cell.ends[bar][end])
            ti.atomic_max(self.state.opening[s][at.k + o[0], at.j + o[1], i + o[2]], elongation)
            ti.atomic_add(self.state.failed[s][at.k + o[0], at.j + o[1], i + o[2]], 1)

    @ti.func
    def strain(self, bar: ti.template(), at: ti.template(), step: ti.template(), lane):
        """Engineering strain of a bar."""
        return self.bars.strain(self.bars.twice_green_strain(bar, at, step, lane))

    @ti.func
    def length_at_rest(self, bar: ti.template(), at: ti.template(), step: ti.template(), lane):
        """L0 of a bar, m."""
        length = step.spacing * ti.static(self.state.cell.length_squared[bar] ** 0.5)
        if ti.static(self.state.features.perturbed):
            length /= ti.sqrt(self.bars.square_of_length_ratio(bar, at, lane))
        return length

    # -- bars at tips ------------------------------------------------------------------------------

    @ti.func
    def opening_at(self, bar: ti.template(), at: ti.template(), lane):
        """The larger opening at a bar's two nodes, m.

        A node is at a tip as long as it has lost no more bars than a flat crack takes from it (five
        or four of the module's along (100), (110)); beyond that it is on a flank.
        """
        at_tip = ti.static(self.state.cell.fewest_cut)
        i = self.access.site_of(at.m, lane)
        most = 0.0
        for end in ti.static(range(2)):
            s, o = ti.static(self.state.cell.ends[bar][end])
            if self.state.failed[s][at.k + o[0], at.j + o[1], i + o[2]] <= at_tip:
                most = ti.max(most, self.state.opening[s][at.k + o[0], at.j + o[1], i + o[2]])
        return most

    @ti.func
    def cost(self, bar: ti.template(), at: ti.template(), lane, step: ti.template()):
        """G_f A^f of a bar over its EA L0; it follows eps_p^2 where bars differ (Eq. (9))."""
        cost = self.state.toughness[ti.static(self.state.cell.family[bar])]
        if ti.static(self.state.features.strength and not self.state.features.flaws):
            cost *= self.state.strength[bar][at.k, at.j, at.m][lane] ** 2
        return cost

    @ti.func
    def strain_of_volumes(self, bar: ti.template(), at: ti.template(), lane, step: ti.template()):
        """Strain at which the bars alone would pull as the volumes of modules around a bar do.

        A uniform expansion e of the bars gives the mean stress 5 mu e, and the volumes give
        (lambda - mu) (J - 1): e = (J - 1) (4 nu - 1) / (5 - 10 nu).
        """
        i, total, count = self.access.site_of(at.m, lane), 0.0, 0.0
        for dz, dy, dx in ti.static(self.state.cell.modules_of[bar]):
            if i + dx > 0:
                m, there = self.access.column_of(i + dx)
                if int(self.state.code[at.k + dz, at.j + dy, m][there]) >> 7:
                    total += self.state.growth[at.k + dz, at.j + dy, m][there]
                    count += 1
        nu = step.poisson_ratio
        return total / ti.max(count, 1.0) * (4 * nu - 1) / (5 - 10 * nu)

    @ti.func
    def fail_at_tip(self, bar: ti.template(), at: ti.template(), step: ti.template(), lane):
        """Let a bar fail if this releases what it costs."""
        opening = self.opening_at(bar, at, lane)
        if opening > 0 and not self.is_known(bar, at, lane):
            strain = self.strain(bar, at, step, lane)
            if strain > 0:
                own = self.bars.peak_strain(bar, at, lane, step.peak_strain)
                peak = ti.max(self.state.peak[bar][at.k, at.j, at.m][lane], strain / own)
                force, whole = self.bars.integrity(bar, strain, peak) * strain, strain
                if ti.static(self.state.features.volumetric):
                    pull = self.strain_of_volumes(bar, at, lane, step)
                    force += pull
                    # as a bar with the material's E, not that of the bars, is strained
                    whole = (whole + pull) * (1 + QUARTER) / (1 + step.poisson_ratio)
                ratio = opening / (self.length_at_rest(bar, at, step, lane) * whole)
                parts = whole * ti.min(ratio, ti.static(self.state.cell.opening))
                enough = force * parts >= 2 * self.cost(bar, at, lane, step)
                if ti.static(self.state.features.volumetric):
                    enough &= whole > 0
                if enough and ratio <= PASSED:
                    # in the step that ends here the force has fallen to zero already
                    near, far = self.bars.end(bar, 0), self.bars.end(bar, 1)
                    rest = self.bars.vector(bar)
                    change = self.bars.last_stretching(near, far, rest, strain, at, step, lane)
                    lost = strain - change
                    released = self.bars.dissipated(bar, peak) + 0.5 * force * lost / (own * own)
                    self.set_failed(bar, at, lane, released)

    @ti.func
    def set_failed(self, bar: ti.template(), at: ti.template(), lane, released):
        """Let a bar be failed, here and where its column is repeated.

        Args:
            released: energy that it has dissipated, over EA eps_p^2 L0.
        """
        k, j, m = at.k, at.j, at.m
        length, width = ti.static(self.state.lanes.length, self.state.lanes.width)
        self.put_failed(bar, k, j, m, lane, released)
        if m < 2 * HALO and lane > 0:
            self.put_failed(bar, k, j, m + length, lane - 1, released)
        if m >= length and lane < width - 1:
            self.put_failed(bar, k, j, m - length, lane + 1, released)

    @ti.func
    def put_failed(self, bar: ti.template(), k, j, m, lane, released):
        """Write a failed bar at one place of the columns."""
        self.state.peak[bar][k, j, m][lane] = -released
        bits = int(self.state.touched[k, j, m]) | 1 << lane
        self.state.touched[k, j, m] = ti.cast(bits, ti.u8)

    # -- the pass ----------------------------------------------------------------------------------

    @ti.func
    def forget(self, at: ti.template(), step: ti.template()):
        """Note the failed bars of a column, and set the openings at their nodes to zero."""
        if self.state.touched[at.k, at.j, at.m] != 0:
            for lane in range(self.state.lanes.width):
                self.note_failed(at, lane)
                for bar in ti.static(range(self.state.cell.bars)):
                    if self.is_known(bar, at, lane):
                        self.forget_openings(bar, at, lane)

    @ti.func
    def open(self, at: ti.template(), step: ti.template()):
        """Give the nodes of a column's failed bars their openings."""
        if self.state.touched[at.k, at.j, at.m] != 0:
            for lane in range(self.state.lanes.width):
                for bar in ti.static(range(self.state.cell.bars)):
                    if self.is_known(bar, at, lane):
                        strain = self.strain(bar, at, step, lane)
                        length = self.length_at_rest(bar, at, step, lane)
                        self.raise_opening(bar, at, lane, length * strain)

    @ti.func
    def fail(self, at: ti.template(), step: ti.template()):
        """Let a column's bars fail where this releases what they cost."""
        if self.state.near[at.k, at.j, at.m] != 0:
            for lane in range(self.state.lanes.width):
                if int(self.state.code[at.k, at.j, at.m][lane]) != 0:
                    for bar in ti.static(range(self.state.cell.bars)):
                        self.fail_at_tip(bar, at, step, lane)
