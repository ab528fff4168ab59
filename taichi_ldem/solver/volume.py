"""Energy of the modules' volumes, for materials whose Poisson's ratio is not 1/4.

Bars alone make a solid with lambda = mu. The rest is an energy of each module,

    W = 1/2 (lambda - mu) (J - 1)^2 L^3,

where J is the determinant of the module's mean deformation gradient F = 1 + H. A corner a has the
place s_a L / 2 from the middle, with s = -1 or 1 along each axis, so H = sum over the corners of
u_a s_a / (4 L) is the gradient at the middle of a trilinear motion. J does not change in any
rotation, so neither does W. The force on a corner is

    f_a = - dW/du_a = - (lambda - mu) (J - 1) L^2 / 4 cof(F) s_a.

``swelling`` holds these nine numbers of every module. A node gathers them from its eight modules,
like the forces of bars, so no sum depends on the order of threads. In a perturbed lattice, F is
taken from the gradients of the places now and at rest, and J is the ratio of their determinants.

Where bars soften or fail, their module's volume does: it keeps the share of its energy that its
weakest bar keeps of its stiffness in tension, and none once a bar has failed or a notch has removed
one. No bar of the module then has a smaller share, so a module's whole energy is never less than
that share of what it is without damage: it stays positive below nu = 1/4, too, where lambda - mu is
negative. In compression a volume is whole until a bar fails, as a bar is; afterwards the bars that
``closing`` faces press on carry it alone, because the J of a torn module tells nothing of a gap.
What a module loses when its share falls is booked as fracture, at the J of that step.

``at`` and ``step`` are the structs of ``bars``.
"""

import taichi as ti

from taichi_ldem.model.cell import CORNER
from taichi_ldem.solver.bars import LatticeBars
from taichi_ldem.solver.state import State

CORNERS = tuple((dz, dy, dx) for dz in (0, 1) for dy in (0, 1) for dx in (0, 1))
"""Offsets (dz, dy, dx) of a module's corners from its site."""

AXES = tuple((i, j) for i in range(3) for j in range(3))


@ti.data_oriented
class ModuleVolumes:
    """Gradients of modules, their forces on nodes, their energy and its loss."""

    def __init__(self, state: State, bars: LatticeBars):
        self.state, self.bars = state, bars

    @ti.func
    def stretch(self, i: ti.template(), j: ti.template(), at: ti.template(), step: ti.template()):
        """H_ij: mean gradient of the displacement along i in direction j, in every lane."""
        u = ti.static(self.state.displacement[CORNER][i])
        total = ti.Vector.zero(float, self.state.lanes.width)
        for dz, dy, dx in ti.static(CORNERS):
            sign = ti.static(2 * (dx, dy, dz)[j] - 1)
            total += sign * u[step.now, at.k + dz, at.j + dy, at.m + dx]
        return total / (4 * step.spacing)

    @ti.func
    def rest(self, i: ti.template(), j: ti.template(), at: ti.template()):
        """Mean gradient of the places at rest in the regular lattice's coordinates."""
        total = ti.Vector.zero(float, self.state.lanes.width)
        if ti.static(self.state.features.perturbed):
            offset = ti.static(self.state.offset[CORNER][i])
            for dz, dy, dx in ti.static(CORNERS):
                sign = ti.static(2 * (dx, dy, dz)[j] - 1)
                total += sign * offset[at.k + dz, at.j + dy, at.m + dx]
            total /= 4
        return total + ti.static(float(i == j))

    @ti.func
    def volume_at_rest(self, at: ti.template()):
        """det G of a column's modules in a perturbed lattice: their volume at rest over L^3."""
        g = [self.rest(i, j, at) for i, j in ti.static(AXES)]
        of_g = self.cofactors(g)
        return g[0] * of_g[0] + g[1] * of_g[1] + g[2] * of_g[2]

    @ti.func
    def swelling(self, at: ti.template(), step: ti.template()):
        """J - 1 of a column's modules, and the nine cofactors of F, in every lane.

        With F = G + H, det F - det G = cof(G) : H + G : cof(H) + det H: nothing cancels at small
        strain. In a regular lattice G is 1.
        """
        h = [self.stretch(i, j, at, step) for i, j in ti.static(AXES)]
        of_h = self.cofactors(h)
        det_h = h[0] * of_h[0] + h[1] * of_h[1] + h[2] * of_h[2]
        if ti.static(self.state.features.perturbed):
            g = [self.rest(i, j, at) for i, j in ti.static(AXES)]
            of_g = self.cofactors(g)
            grown = det_h
            for n in ti.static(range(9)):
                grown += of_g[n] * h[n] + g[n] * of_h[n]
            of_f = self.cofactors([h[n] + g[n] for n in ti.static(range(9))])
            return grown / (g[0] * of_g[0] + g[1] * of_g[1] + g[2] * of_g[2]), of_f
        else:
            # cof(1 + H) = (1 + tr H) 1 - H^T + cof(H)
            trace = h[0] + h[4] + h[8]
            of_f = [
                of_h[3 * i + j] - h[3 * j + i] + ti.static(float(i == j)) * (1 + trace)
                for i, j in ti.static(AXES)
            ]
            return trace + (of_h[0] + of_h[4] + of_h[8]) + det_h, of_f

    @ti.func
    def cofactors(self, a: ti.template()):
        """Cofactors of a matrix given row by row, in the same order."""
        return [
            a[3 * ((i + 1) % 3) + (j + 1) % 3] * a[3 * ((i + 2) % 3) + (j + 2) % 3]
            - a[3 * ((i + 1) % 3) + (j + 2) % 3] * a[3 * ((i + 2) % 3) + (j + 1) % 3]
            for i, j in ti.static(AXES)
        ]

    # -- damage ------------------------------------------------------------------------------------

    @ti.func
    def share(self, grown, damage, step: ti.template()):
        """Share of its energy that a module has at J - 1, given its damage; of lanes or of one."""
        whole = ti.cast(step.volumetric > 0, ti.i32)
        return ti.select((grown < 0) & (damage < 1) & (whole != 0), 1.0, 1 - damage)

    @ti.func
    def damage_of_bars(self, at: ti.template(), lane):
        """1 less the least share of stiffness in tension among a module's bars."""
        least = 1.0
        for bar, home in ti.static(self.state.cell.of_module):
            there = ti.Struct(k=at.k + home[0], j=at.j + home[1], m=at.m + home[2])
            if ti.static(self.state.features.damage):
                peak = self.state.peak[bar, there.k, there.j, there.m][lane]
                least = ti.min(least, self.bars.integrity(bar, 1.0, peak))
            if ti.static(self.state.features.notch):
                if self.bars.is_removed(bar, there, lane):
                    least = 0.0
        return 1 - least

    @ti.func
    def damage_beside(self, k, j, m):
        """Not 0 where a bar of a column, or of those above and behind, may be damaged.

        The same where a bar may be at a crack's tip.
        """
        found = 0
        for dz, dy in ti.static(((0, 0), (0, 1), (1, 0), (1, 1))):
            found |= int(self.state.touched[k + dz, j + dy, m])
            if ti.static(self.state.features.crack):
                found |= int(self.state.near[k + dz, j + dy, m])
        return found

    @ti.func
    def weaken(self, at: ti.template(), step: ti.template()):
        """Let the damage of a column's modules follow that of their bars before this step."""
        if self.damage_beside(at.k, at.j, at.m) | self.damage_beside(at.k, at.j, at.m + 1) != 0:
            self.weaken_column(at, step)

    @ti.func
    def weaken_row(self, k, j, begin: ti.template(), end: ti.template(), step: ti.template()):
        """``weaken`` for the columns of a row, each of whose sites is looked at once."""
        before = self.damage_beside(k, j, begin)
        for m in range(begin, end):
            after = self.damage_beside(k, j, m + 1)
            if before | after != 0:
                self.weaken_column(ti.Struct(k=k, j=j, m=m), step)
            before = after

    @ti.func
    def weaken_column(self, at: ti.template(), step: ti.template()):
        """The same for a column next to which there is damage."""
        lanes = self.lanes_to_weaken(at)
        if lanes != 0:
            grown, _ = self.swelling(at, step)
            for lane in range(self.state.lanes.width):
                if (lanes >> lane) & 1 != 0:
                    self.weaken_module(grown[lane], at, lane, step)

    @ti.func
    def lanes_to_weaken(self, at: ti.template()):
        """A bit for each lane of a column whose module may lose more, or drives a crack."""
        lanes = 0
        for lane in range(self.state.lanes.width):
            # most modules near a crack have failed, and lose nothing any more
            left = self.state.volume_damage[at.k, at.j, at.m][lane] < 1
            if ti.static(self.state.features.crack):
                left = True
            if left and self.state.volume_modulus[at.k, at.j, at.m][lane] > 0:
                lanes |= 1 << lane
        return lanes

    @ti.func
    def weaken_module(self, grown, at: ti.template(), lane, step: ti.template()):
        """Raise a module's damage to that of its bars, and book the energy that this takes."""
        k, j, m = at.k, at.j, at.m
        before = self.state.volume_damage[k, j, m][lane]
        after = before
        if before < 1:
            after = ti.max(before, self.damage_of_bars(at, lane))
        share = self.share(grown, after, step)
        if after > before:
            lost = self.share(grown, before, step) - share
            modulus = step.volumetric * self.state.volume_modulus[k, j, m][lane]
            loss = 0.5 * modulus * step.spacing**3 * lost * grown * grown
            if ti.static(self.state.features.perturbed):
                loss *= self.volume_at_rest(at)[lane]
            self.state.volume_loss[k, j, m][lane] = self.state.volume_loss[k, j, m][lane] + loss
            self.state.volume_damage[k, j, m][lane] = after
        if ti.static(self.state.features.crack):
            self.state.growth[k, j, m][lane] = share * grown

    # -- the pass ----------------------------------------------------------------------------------

    @ti.func
    def column_forces(self, at: ti.template(), step: ti.template()):
        """Store the forces of a column's modules on their corners."""
        grown, cofactors = self.swelling(at, step)
        size = self.state.volume_modulus[at.k, at.j, at.m] * grown
        size *= 0.25 * step.volumetric * step.spacing * step.spacing
        if ti.static(self.state.features.history):
            size *= self.share(grown, self.state.volume_damage[at.k, at.j, at.m], step)
        force = ti.Matrix.zero(float, 9, self.state.lanes.width)
        for n in ti.static(range(9)):
            for lane in ti.static(range(self.state.lanes.width)):
                force[n, lane] = size[lane] * cofactors[n][lane]
        # all arithmetic before the first store, as in ``bars``
        for n in ti.static(range(9)):
            for lane in ti.static(range(self.state.lanes.width)):
                stored = ti.static(self.state.swelling[n // 3][n % 3])
                stored[at.row, at.k, at.m][lane] = force[n, lane]

    @ti.func
    def force(self, axis: ti.template(), rows, at: ti.template()):
        """Sum of the forces of the modules around a column's corner nodes along an axis, N."""
        total = ti.Vector.zero(float, self.state.lanes.width)
        for dz, dy, dx in ti.static(CORNERS):
            row = rows[dy]  # the modules at j - 1 and j
            for j in ti.static(range(3)):
                # the node is the corner on the module's other side
                sign = ti.static(2 * (dx, dy, dz)[j] - 1)
                stored = ti.static(self.state.swelling[axis][j])
                total += sign * stored[row, at.k + dz - 1, at.m + dx - 1]
        return total

    @ti.func
    def column_energy(self, at: ti.template(), step: ti.template()):
        """Energy of a column's modules, and what they have lost by fracture, J, in f64."""
        k, j, m = at.k, at.j, at.m
        grown, _ = self.swelling(at, step)
        total, lost = ti.cast(0.0, ti.f64), ti.cast(0.0, ti.f64)
        for lane in ti.static(range(self.state.lanes.width)):
            part = self.state.volume_modulus[k, j, m][lane] * grown[lane] * grown[lane]
            if ti.static(self.state.features.history):
                part *= self.share(grown[lane], self.state.volume_damage[k, j, m][lane], step)
                lost += ti.cast(self.state.volume_loss[k, j, m][lane], ti.f64)
            if ti.static(self.state.features.perturbed):
                part *= self.volume_at_rest(at)[lane]
            total += ti.cast(part, ti.f64)
        edge = ti.cast(step.spacing, ti.f64)
        return 0.5 * step.volumetric * edge**3 * total, lost
