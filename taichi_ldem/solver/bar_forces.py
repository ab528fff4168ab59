"""Pass 1 of the step: the axial force of every bar, and the history of those that soften.

A bar is evaluated once; what is stored is one scalar, its axial force over its current length. All
lanes of a column are worked on at once. Damage is computed bar by bar, and only in lanes where the
elastic force comes close to that at eps_p or a bit marks a bar as no longer elastic.

``at`` and ``step`` are the structs of ``solver.bars``.
"""

import taichi as ti

from taichi_ldem.solver.bars import TINY, LatticeBars
from taichi_ldem.solver.bends import LawBends
from taichi_ldem.solver.parting import PartingFaces
from taichi_ldem.solver.state import State

CLOSE = 1 - 1e-5
"""Share of the force at eps_p from which a bar's strain is compared with it: within the rounding of
f32, so that the test of the force only spares bars that are well below."""


@ti.data_oriented
class BarForces:
    """Forces and history of the bars of a column."""

    def __init__(self, state: State, bars: LatticeBars, bends: LawBends, parting: PartingFaces):
        self.state, self.bars, self.bends, self.parting = state, bars, bends, parting

    # -- damage ------------------------------------------------------------------------------------

    @ti.func
    def apply_damage(self, lanes, at: ti.template(), step: ti.template()):
        """Update the history of the chosen lanes' bars and reduce their stored forces.

        Args:
            lanes: a bit for each lane.
        """
        for lane in range(self.state.lanes.width):
            if (lanes >> lane) & 1:
                forces = ti.Vector.zero(float, self.state.cell.bars)
                for bar in ti.static(range(self.state.cell.bars)):
                    forces[bar] = self.state.axial[bar][at.row, at.k, at.m][lane]
                for bar in range(self.state.cell.bars):
                    forces[bar] = self.damaged(bar, forces[bar], at, step, lane)
                for bar in ti.static(range(self.state.cell.bars)):
                    self.state.axial[bar][at.row, at.k, at.m][lane] = forces[bar]

    @ti.func
    def damaged(self, bar, whole, at: ti.template(), step: ti.template(), lane):
        """Update the history of a bar; its force over current length, given that of a whole bar."""
        force = whole
        if self.may_soften(bar, whole, at, step, lane):
            strain = self.bars.strain(self.bars.twice_green_strain(bar, at, step, lane))
            before = 0.0
            if ti.static(self.state.features.damage):
                before = self.state.peak[bar, at.k, at.j, at.m][lane]
            force *= self.updated_integrity(bar, strain, at, step, lane)
            if ti.static(self.state.features.damage):
                force += self.after_bend(bar, strain, before, at, step, lane)
        return force

    @ti.func
    def after_bend(self, bar, strain, before, at: ti.template(), step: ti.template(), lane):
        """Additional force over current length where the law of a bar has bent in the last step.

        Args:
            before: its peak strain over eps_p one step before.
        """
        force = 0.0
        bends = self.bends.may_bend(bar, before, at, lane)
        cracked, parts = False, False
        if ti.static(self.state.features.meeting):
            cracked = self.bends.is_crack(bar, before, at, lane)
        if ti.static(self.state.features.viscous):
            parts = before < 0
        if bends or cracked or parts:
            change = self.bars.last_stretching(bar, strain, at, step, lane)
            if bends:
                force = self.bends.force(bar, strain, change, before, at, step, lane)
            if ti.static(self.state.features.meeting):
                if cracked:
                    self.bends.note_meeting(bar, strain, change, at, step, lane)
            if ti.static(self.state.features.viscous):
                if parts:
                    force = self.parting.resist(bar, strain, change, at, step, lane)
        return force

    @ti.func
    def may_soften(self, bar, force, at: ti.template(), step: ti.template(), lane):
        """Whether a bar is removed, has passed its eps_p, or is CLOSE to it by its force."""
        found = False
        if ti.static(self.state.features.damage):
            own = self.bars.peak_strain(bar, at, lane, step.peak_strain)
            most = CLOSE / (1 + 1 / own) * self.bars.stiffness(bar, at, lane)
            peak = self.state.peak[bar, at.k, at.j, at.m][lane]
            found |= force > most or peak > 1
            if ti.static(self.state.features.crack):
                found |= peak < 0
        if ti.static(self.state.features.notch):
            found |= self.bars.is_removed(bar, at, lane)
        return found

    @ti.func
    def updated_integrity(self, bar, strain, at: ti.template(), step: ti.template(), lane):
        """Share of its elastic force that a bar carries, after its history has been updated."""
        k, j, m = at.k, at.j, at.m
        share = 1.0
        if ti.static(self.state.features.notch):
            if self.bars.is_removed(bar, at, lane):
                share = 0.0
        if ti.static(self.state.features.damage):
            if share > 0:
                peak = self.state.peak[bar, k, j, m][lane]
                own = self.bars.peak_strain(bar, at, lane, step.peak_strain)
                if strain > peak * own and peak >= 0:
                    peak = strain / own
                    self.state.peak[bar, k, j, m][lane] = peak
                if peak > 1 or peak < 0:
                    # no atomic: a thread that evaluates the same column writes the same
                    bits = int(self.state.touched[k, j, m]) | 1 << lane
                    self.state.touched[k, j, m] = ti.cast(bits, ti.u8)
                share = self.bars.integrity(bar, strain, peak)
        return share

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
            whole = self.bars.stiffness_of_lanes(bar, at)
            q = self.bars.twice_green_strain_of_lanes(bar, at, step)
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
