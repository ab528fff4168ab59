"""Steps in which the law of a bar bends: what central differences leave out, and where it goes.

Central differences let the force F of a bar change on a straight line within a step, so over a
change D of its length they count the energy (F_before + F_now) D / 2. That is exact while the law
is a straight line. Where it bends within a step (at eps_p, where a bar fails, where it is stretched
beyond its peak strain again, where a damaged one closes), energy would appear or vanish, and on
average always in the same direction. What is missing is given back at once, by a force in this step
that does just this work (``force``): the energy decides over the force, as in a discrete
gradient (Gonzalez 1996).

Where faces of a crack meet or part, such a force would give energy to debris. What is left out
there is booked as lost in contact (``note_meeting``).
"""

import taichi as ti

from taichi_ldem.solver.access import NodeAccess
from taichi_ldem.solver.bars import TINY, LatticeBars
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.state import State


@ti.data_oriented
class LawBends:
    """Forces and losses of bars whose law has bent in the last step."""

    def __init__(self, state: State, bars: LatticeBars, access: NodeAccess):
        self.state, self.bars, self.access = state, bars, access

    # -- bars in sound material and at tips --------------------------------------------------------

    @ti.func
    def may_bend(self, bar, before, at: ti.template(), lane):
        """Whether the law of a bar may have bent in the last step, given its peak before it.

        Failed bars that close and open again are left out (``note_meeting``): as debris under a
        striker, which is held and pushed by much else at the same time, they would gain energy.
        """
        bends = self.state.peak[bar, at.k, at.j, at.m][lane] > 1
        bends &= not self.bars.has_failed(bar, before) and self.bars.stiffness(bar, at, lane) > 0
        return bends

    @ti.func
    def force(self, bar, strain, change, before, at: ti.template(), step: ti.template(), lane):
        """Force over current length that makes up for a bend of the law in the last step.

        Let D be the last change of the bar's length and M the energy that (F_before + F_now) D / 2
        leaves out. An additional force C in this step does the work C (D + D') / 2, where D' is the
        next change. Without C, the ends would go on by D and by what the bar has lost of its pull;
        C itself shortens D' by S C, with S = dt^2 (1 / m_1 + 1 / m_2). So

            C (W - S C / 2) = M,    W = D + S (loss of pull) / 2,

        of which the smaller root is taken. At most the energy W^2 / (2 S) can be had in this way.
        In the code, forces are over EA, and lengths over L0.

        Args:
            change: what its strain has changed by in the last step.
            before: peak strain over eps_p one step before.
        """
        after = self.state.peak[bar, at.k, at.j, at.m][lane]
        own = self.bars.peak_strain(bar, at, lane, step.peak_strain)
        stiffness = self.bars.stiffness(bar, at, lane)
        way = ti.cast(change, ti.f64)
        missing, loss = self.left_out(bar, strain, way, before, after, own)
        soft = ti.cast(stiffness * self.mobility(bar, at, lane), ti.f64)
        soft *= step.kick * step.drift
        force = stiffness * ti.cast(self.root(way + 0.5 * soft * loss, soft, missing), float)
        return force / ti.max(1 + strain, ti.static(TINY**0.5))

    @ti.func
    def left_out(self, bar, strain, change, before, after, own):
        """M of a bar over EA L0, and the loss of pull over EA; 0 where its law has not bent."""
        missing, loss = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        old = strain - change
        was, share = self.bars.integrity(bar, old, before), self.bars.integrity(bar, strain, after)
        if was != share:
            missing = self.bars.energy(bar, strain, after, own)
            missing -= self.bars.energy(bar, old, before, own)
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
    def mobility(self, bar, at: ti.template(), lane):
        """Sum of the inverse masses of a bar's ends, 1/kg."""
        near, far, _ = self.bars.ends(bar)
        return self.inverse_mass(near, at, lane) + self.inverse_mass(far, at, lane)

    @ti.func
    def inverse_mass(self, end, at: ti.template(), lane):
        """Inverse mass of the node at an end of a bar (``LatticeBars.ends``), 1/kg."""
        k, j, i = self.access.site_of_end(end, at, lane)
        return 1 / self.access.mass(end[0], k, j, i)

    # -- faces of a crack --------------------------------------------------------------------------

    @ti.func
    def is_crack(self, bar, before, at: ti.template(), lane):
        """Whether a bar had failed before the last step, given its peak before it."""
        return self.bars.has_failed(bar, before) and self.bars.stiffness(bar, at, lane) > 0

    @ti.func
    def note_meeting(self, bar, strain, change, at: ti.template(), step: ti.template(), lane):
        """Add up what (F_before + F_now) D / 2 leaves out where crack faces met or parted.

        A force comes or goes within the step, and nodes that come faster than they part lose the
        energy. So it is a loss in contact, as that of a node that lands on a rigid body.

        Args:
            change: as in ``force``.
        """
        old = strain - change
        # columns at either end of a row belong to another lane, which adds them up
        own = HALO <= at.m < ti.static(HALO + self.state.lanes.length)
        if own and (old < 0) != (strain < 0):
            length = self.bars.length_at_rest(bar, at, step, lane)
            twice = self.bars.stiffness(bar, at, lane) * length * length
            now, was = ti.min(strain, 0.0), ti.min(old, 0.0)
            lost = 0.5 * twice * ((now + was) * change - (now * now - was * was))
            k, j, m = at.k, at.j, at.m
            self.state.face_loss[k, j, m][lane] = self.state.face_loss[k, j, m][lane] + lost
