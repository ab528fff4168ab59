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

``at`` and ``step`` are the structs of ``bars``.
"""

import taichi as ti

from taichi_ldem.model.cell import CORNER
from taichi_ldem.solver.state import State

CORNERS = tuple((dz, dy, dx) for dz in (0, 1) for dy in (0, 1) for dx in (0, 1))
"""Offsets (dz, dy, dx) of a module's corners from its site."""

AXES = tuple((i, j) for i in range(3) for j in range(3))


@ti.data_oriented
class ModuleVolumes:
    """Gradients of modules, their forces on nodes and their energy."""

    def __init__(self, state: State):
        self.state = state

    @ti.func
    def exist(self, at: ti.template()):
        """1 in the lanes of a column where the site's own module exists, 0 elsewhere."""
        code = self.state.code[at.k, at.j, at.m]
        return ti.Vector(
            [ti.cast(code[n] >> 7, float) for n in ti.static(range(self.state.lanes.width))]
        )

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
    def swelling(self, at: ti.template(), step: ti.template()):
        """J - 1 and cof(F) of a column's modules: (10, lanes).

        With F = G + H, det F - det G = cof(G) : H + G : cof(H) + det H: nothing cancels at small
        strain.
        """
        h = [self.stretch(i, j, at, step) for i, j in ti.static(AXES)]
        g = [self.rest(i, j, at) for i, j in ti.static(AXES)]
        f = [h[n] + g[n] for n in ti.static(range(9))]
        of_h, of_g, of_f = self.cofactors(h), self.cofactors(g), self.cofactors(f)
        grown = ti.Vector.zero(float, self.state.lanes.width)
        for n in ti.static(range(9)):
            grown += of_g[n] * h[n] + g[n] * of_h[n]
        for n in ti.static(range(3)):
            grown += h[n] * of_h[n]
        before = g[0] * of_g[0] + g[1] * of_g[1] + g[2] * of_g[2]
        result = ti.Matrix.zero(float, 10, self.state.lanes.width)
        for lane in ti.static(range(self.state.lanes.width)):
            result[9, lane] = grown[lane] / before[lane]
            for n in ti.static(range(9)):
                result[n, lane] = of_f[n][lane]
        return result

    @ti.func
    def cofactors(self, a: ti.template()):
        """Cofactors of a matrix given row by row, in the same order."""
        return [
            a[3 * ((i + 1) % 3) + (j + 1) % 3] * a[3 * ((i + 2) % 3) + (j + 2) % 3]
            - a[3 * ((i + 1) % 3) + (j + 2) % 3] * a[3 * ((i + 2) % 3) + (j + 1) % 3]
            for i, j in ti.static(AXES)
        ]

    @ti.func
    def column_forces(self, at: ti.template(), step: ti.template()):
        """Store the forces of a column's modules on their corners."""
        found, exist = self.swelling(at, step), self.exist(at)
        size = 0.25 * step.volumetric * step.spacing * step.spacing
        for n in ti.static(range(9)):
            for lane in ti.static(range(self.state.lanes.width)):
                force = size * exist[lane] * found[9, lane] * found[n, lane]
                self.state.swelling[n // 3][n % 3][at.strip, at.row, at.k, at.m][lane] = force

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
                total += sign * stored[at.strip, row, at.k + dz - 1, at.m + dx - 1]
        return total

    @ti.func
    def column_energy(self, at: ti.template(), step: ti.template()):
        """Energy of a column's modules, J, in f64."""
        found, exist = self.swelling(at, step), self.exist(at)
        total = ti.cast(0.0, ti.f64)
        for lane in ti.static(range(self.state.lanes.width)):
            total += ti.cast(exist[lane] * found[9, lane] * found[9, lane], ti.f64)
        edge = ti.cast(step.spacing, ti.f64)
        return 0.5 * step.volumetric * edge**3 * total
