"""Cracks that grow where their growth releases G_f: the pass before pass 1 of a step.

The paper's law knows a bar's own strain only, and a lattice whose modules are not far smaller than
l_ch must be loaded beyond G_f before the bar at a crack's tip reaches eps_p. With
``material.fracture = "crack"`` a bar also fails where this would release what it costs:

    F w / 2 >= G_f A^f,     w <= c (l - L0).

F is its force and w the largest elongation of the failed bars at its two nodes, which tells how far
its own ends would part: the work that closes a crack by one bar again, as in virtual crack closure
(Rybicki and Kanninen 1977). The bound on w is the opening next to a tip in linear elasticity; it
keeps the flanks of a wide open crack from failing under any small tension along them.

With ``material.tip_criterion = "strain"`` a bar at a tip fails at the tip strain of its family,

    F c (l - L0) / 2 >= G_f A^f,

where w only says whether the bar is at a tip. c is a constant of the family then.

Openings are those at the displacement of the step, and a bar counts as failed from the step after
its failure on, so the order of threads changes nothing.

Where modules have an energy of their volume, bars carry a part of the stress only. F is then the
force of a bar that carried the volumes' share as well, as those of the same solid with nu = 1/4 do.
"""

import math

import taichi as ti

from taichi_ldem.scene.equations import QUARTER
from taichi_ldem.solver.access import NodeAccess
from taichi_ldem.solver.bars import LatticeBars
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.state import State

PASSED = 4 * math.pi
"""Opening over a bar's elongation from which on the tip has passed the bar: it is on a flank.

Twice that next to a tip in linear elasticity.
"""


@ti.data_oriented
class CrackTips:
    """Openings of cracks at nodes, and the bars that fail for them."""

    def __init__(self, state: State, bars: LatticeBars, access: NodeAccess):
        self.state, self.bars, self.access = state, bars, access
        cell, by_strain = state.cell, state.features.tip_strain
        self.by_strain = by_strain
        self.openings = cell.tip_openings if by_strain else (cell.opening,) * cell.families
        self.most_failed = cell.most_cut if by_strain else cell.fewest_cut

    # -- openings ----------------------------------------------------------------------------------

    @ti.func
    def note_failed(self, at: ti.template(), lane):
        """Bring ``known`` up to date for a site, and mark what is near bars that are new in it."""
        k, j, m = at.k, at.j, at.m
        before, bits = int(self.state.known[k, j, m][lane]), 0
        if ti.static(self.state.features.notch):
            bits = int(self.state.removed[k, j, m][lane])
        stiffness = self.state.stiffness[int(self.state.code[k, j, m][lane])]
        for bar in range(self.state.cell.bars):
            if self.bars.has_failed(bar, self.state.peak[bar, k, j, m][lane]):
                bits |= 1 << bar
            if stiffness[self.state.kinds[bar][1]] == 0:
                bits &= ~(1 << bar)
        self.state.known[k, j, m][lane] = ti.cast(bits, ti.u16)
        new = bits & ~before
        if new != 0:
            for bar in range(self.state.cell.bars):
                if (new >> bar) & 1:
                    near, far, _ = self.bars.ends(bar)
                    self.mark_near(near, at, lane)
                    self.mark_near(far, at, lane)

    @ti.func
    def mark_near(self, end, at: ti.template(), lane):
        """Mark the columns whose bars may share a node; all threads write the same.

        Args:
            end: (4,) see ``LatticeBars.ends``.
        """
        z, y, x = self.access.site_of_end(end, at, lane)
        for dz, dy, dx in ti.ndrange((-1, 2), (-1, 2), (-1, 2)):
            k, j, i = z + dz, y + dy, x + dx
            inside = 0 < k < ti.static(self.state.sites[0] - 1)
            inside &= 0 < j < ti.static(self.state.sites[1] - 1)
            inside &= 0 < i < ti.static(self.state.sites[2] - 1)
            if inside:
                m, _ = self.access.column_of(i)
                self.state.near[k, j, m] = ti.cast(1, ti.u8)

    @ti.func
    def is_known(self, bar, at: ti.template(), lane):
        """Whether a bar had failed or was removed before this step."""
        return (int(self.state.known[at.k, at.j, at.m][lane]) >> bar) & 1 != 0

    @ti.func
    def forget_openings(self, end, at: ti.template(), lane):
        """Set the opening at an end of a failed bar to zero."""
        k, j, i = self.access.site_of_end(end, at, lane)
        for s in ti.static(range(self.state.cell.sublattices)):
            if s == end[0]:
                self.state.opening[s][k, j, i] = 0.0
                self.state.failed[s][k, j, i] = 0

    @ti.func
    def raise_opening(self, end, at: ti.template(), lane, elongation):
        """Let an end of a failed bar have at least the bar's elongation as its opening, m."""
        k, j, i = self.access.site_of_end(end, at, lane)
        for s in ti.static(range(self.state.cell.sublattices)):
            if s == end[0]:
                ti.atomic_max(self.state.opening[s][k, j, i], elongation)
                ti.atomic_add(self.state.failed[s][k, j, i], 1)

    @ti.func
    def strain(self, bar, at: ti.template(), step: ti.template(), lane):
        """Engineering strain of a bar."""
        return self.bars.strain(self.bars.twice_green_strain(bar, at, step, lane))

    # -- bars at tips ------------------------------------------------------------------------------

    @ti.func
    def opening_at(self, bar, at: ti.template(), lane):
        """The larger opening at a bar's two nodes, m.

        A node is at a tip as long as it has lost no more bars than a flat crack takes from it (five
        or four of the module's along (100), (110)); beyond that it is on a flank.
        """
        near, far, _ = self.bars.ends(bar)
        return ti.max(self.opening_of(near, at, lane), self.opening_of(far, at, lane))

    @ti.func
    def opening_of(self, end, at: ti.template(), lane):
        """Opening at an end of a bar, m; 0 where it is on a flank."""
        k, j, i = self.access.site_of_end(end, at, lane)
        opening = 0.0
        for s in ti.static(range(self.state.cell.sublattices)):
            if s == end[0]:
                if self.state.failed[s][k, j, i] <= ti.static(self.most_failed):
                    opening = self.state.opening[s][k, j, i]
        return opening

    @ti.func
    def cost(self, bar, at: ti.template(), lane, step: ti.template()):
        """G_f A^f of a bar over its EA L0; it follows eps_p^2 where bars differ (Eq. (9))."""
        cost = self.state.toughness[self.bars.family(bar)]
        if ti.static(self.state.features.strength and not self.state.features.flaws):
            cost *= self.state.strength[bar, at.k, at.j, at.m][lane] ** 2
        return cost

    @ti.func
    def strain_of_volumes(self, bar, at: ti.template(), lane, step: ti.template()):
        """Strain at which the bars alone would pull as the volumes of modules around a bar do.

        A uniform expansion e of the bars gives the mean stress 5 mu e, and the volumes give
        (lambda - mu) (J - 1): e = (J - 1) (4 nu - 1) / (5 - 10 nu).
        """
        i, total, count = self.access.site_of(at.m, lane), 0.0, 0.0
        for one in ti.static(range(self.state.cell.bars)):
            if one == bar:
                for dz, dy, dx in ti.static(self.state.cell.modules_of[one]):
                    if i + dx > 0:
                        m, there = self.access.column_of(i + dx)
                        if int(self.state.code[at.k + dz, at.j + dy, m][there]) >> 7:
                            total += self.state.growth[at.k + dz, at.j + dy, m][there]
                            count += 1
        nu = step.poisson_ratio
        return total / ti.max(count, 1.0) * (4 * nu - 1) / (5 - 10 * nu)

    @ti.func
    def fail_if_at_tip(self, bar, at: ti.template(), step: ti.template(), lane):
        """Let a bar fail if it is pulled at the tip of a crack, and this releases what it costs."""
        opening = self.opening_at(bar, at, lane)
        if opening > 0:
            strain = self.strain(bar, at, step, lane)
            if strain > 0:
                self.fail_at_tip(bar, strain, opening, at, step, lane)

    @ti.func
    def fail_at_tip(self, bar, strain, opening, at: ti.template(), step: ti.template(), lane):
        """Let a bar fail if this releases what it costs.

        Args:
            strain: its engineering strain, more than 0.
            opening: the larger one at its two nodes, m.
        """
        family = self.bars.family(bar)
        own = self.bars.peak_strain(bar, at, lane, step.peak_strain)
        peak = ti.max(self.state.peak[bar, at.k, at.j, at.m][lane], strain / own)
        force, whole = self.bars.integrity(bar, strain, peak) * strain, strain
        if ti.static(self.state.features.volumetric):
            pull = self.strain_of_volumes(bar, at, lane, step)
            force += pull
            # as a bar with the material's E, not that of the bars, is strained
            whole = (whole + pull) * (1 + QUARTER) / (1 + step.poisson_ratio)
        ratio = opening / (self.bars.length_at_rest(bar, at, step, lane) * whole)
        parts = whole * self.counted(ratio, family)
        enough = force * parts >= 2 * self.cost(bar, at, lane, step)
        if ti.static(self.state.features.volumetric):
            enough &= whole > 0
        if enough and ratio <= PASSED:
            # in the step that ends here the force has fallen to zero already
            lost = strain - self.bars.last_stretching(bar, strain, at, step, lane)
            dissipated = self.bars.dissipated(bar, peak)
            self.set_failed(bar, at, lane, dissipated + 0.5 * force * lost / (own * own))

    @ti.func
    def opening_that_counts(self, family):
        """c: the opening at a tip over a bar's elongation, as far as it counts."""
        c = 0.0
        for one in ti.static(range(self.state.cell.families)):
            if one == family:
                c += ti.static(self.openings[one])  # an assignment would bind a name
        return c

    @ti.func
    def counted(self, ratio, family):
        """Opening w that counts at a bar, given that at its nodes; both over its elongation."""
        w = self.opening_that_counts(family)
        if ti.static(not self.by_strain):
            w = ti.min(ratio, w)
        elif ratio < 1:
            w = 0.0
        return w

    @ti.func
    def set_failed(self, bar, at: ti.template(), lane, released):
        """Let a bar be failed, here and where its column is repeated.

        Args:
            released: energy that it has dissipated, over EA eps_p^2 L0.
        """
        k, j = at.k, at.j
        length, width = ti.static(self.state.lanes.length, self.state.lanes.width)
        for side in range(-1, 2):
            m, own = at.m - side * length, lane + side
            exists = side == 0 or (side < 0 and at.m < 2 * HALO and lane > 0)
            exists = exists or (side > 0 and at.m >= length and lane < width - 1)
            if exists:
                self.state.peak[bar, k, j, m][own] = -released
                bits = int(self.state.touched[k, j, m]) | 1 << own
                self.state.touched[k, j, m] = ti.cast(bits, ti.u8)

    # -- the pass ----------------------------------------------------------------------------------

    @ti.func
    def forget(self, at: ti.template(), step: ti.template()):
        """Note the failed bars of a column, and set the openings at their nodes to zero."""
        if self.state.touched[at.k, at.j, at.m] != 0:
            for lane in range(self.state.lanes.width):
                self.note_failed(at, lane)
                for bar in range(self.state.cell.bars):
                    if self.is_known(bar, at, lane):
                        near, far, _ = self.bars.ends(bar)
                        self.forget_openings(near, at, lane)
                        self.forget_openings(far, at, lane)

    @ti.func
    def open(self, at: ti.template(), step: ti.template()):
        """Give the nodes of a column's failed bars their openings."""
        if self.state.touched[at.k, at.j, at.m] != 0:
            for lane in range(self.state.lanes.width):
                for bar in range(self.state.cell.bars):
                    if self.is_known(bar, at, lane):
                        strain = self.strain(bar, at, step, lane)
                        elongation = self.bars.length_at_rest(bar, at, step, lane) * strain
                        near, far, _ = self.bars.ends(bar)
                        self.raise_opening(near, at, lane, elongation)
                        self.raise_opening(far, at, lane, elongation)

    @ti.func
    def fail(self, at: ti.template(), step: ti.template()):
        """Let a column's bars fail where this releases what they cost."""
        if self.state.near[at.k, at.j, at.m] != 0:
            for lane in range(self.state.lanes.width):
                if int(self.state.code[at.k, at.j, at.m][lane]) != 0:
                    for bar in range(self.state.cell.bars):
                        if not self.is_known(bar, at, lane):
                            self.fail_if_at_tip(bar, at, step, lane)
