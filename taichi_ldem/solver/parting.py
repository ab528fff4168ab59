"""Faces of a crack that part at its tip, against the impedance of the solid.

A bar that fails at a tip (``tips``) has stored less than its part of the crack costs. What a
growing crack releases beyond that becomes waves, unless something takes it where the faces part.
With ``material.crack_opening = "viscous"`` they part against

    sigma = rho c_P d(opening)/dt,

as an elastic half space resists the motion of its surface. A bar has its fracture area as its share
of the faces, so it pulls with the force F = rho c_P A^f dl/dt until it is as long as at the opening
with which the rule for tips counts. Nothing is chosen but the material's own impedance, and a crack
that grows slowly meets no resistance.

The work of these forces counts as dissipated by the bar. It is the trapezium of central differences
and therefore exact: both are known at the end of a step.
"""

import taichi as ti

from taichi_ldem.solver.bars import LatticeBars
from taichi_ldem.solver.state import State
from taichi_ldem.solver.tips import CrackTips

FAILED = -1e-6
"""What the peak strain of a bar that failed at a tip stays below."""


@ti.data_oriented
class PartingFaces:
    """Viscous pulls of bars that have failed at the tip of a crack."""

    def __init__(self, state: State, bars: LatticeBars, tips: CrackTips):
        self.state, self.bars, self.tips = state, bars, tips

    @ti.func
    def resist(self, bar, strain, change, at: ti.template(), step: ti.template(), lane):
        """Pull of a bar that failed at a tip over its current length; its work is booked.

        Args:
            strain: its engineering strain.
            change: what its strain has changed by in the last step.
        """
        k, j, m = at.k, at.j, at.m
        own = self.bars.peak_strain(bar, at, lane, step.peak_strain)
        before, now = self.state.resistance[bar, k, j, m][lane], 0.0
        # longer than at rest, but not than at the opening that counts at a tip
        limit = self.square_at_tip(bar, at, lane, step)
        if strain > 0 and strain * strain < limit and step.drift > 0:
            now = self.state.viscosity[self.bars.family(bar)] * change / step.drift
        work = 0.5 * (before + now) * change / (own * own)
        self.state.resistance[bar, k, j, m][lane] = now
        self.state.peak[bar, k, j, m][lane] = ti.min(
            self.state.peak[bar, k, j, m][lane] - work, FAILED
        )
        return self.bars.stiffness(bar, at, lane) * now / (1 + strain)

    @ti.func
    def square_at_tip(self, bar, at: ti.template(), lane, step: ti.template()):
        """Square of a bar's strain at the opening that counts at a tip.

        With w = c e L0 and F = EA e, the condition F w / 2 = G_f A^f of ``tips`` holds at the
        strain e, and w is the elongation at the strain c e = sqrt(2 c G_f A^f / (EA L0)).
        """
        twice = 2 * self.tips.opening_that_counts(self.bars.family(bar))
        return twice * self.tips.cost(bar, at, lane, step)
