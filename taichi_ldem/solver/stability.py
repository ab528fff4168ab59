"""The critical time step of the assembled lattice.

Central differences are stable up to 2 / omega_max. The highest frequency comes from a few Lanczos
steps on M^(-1/2) K M^(-1/2), with K applied by the kernels that step the plate: it is that of the
run's own operator and not a bound on it (the element-wise bound is a third too low). Kinematic
contact and clamps are constraints, which cannot raise the highest frequency, and broken bars lower
it.
"""

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene
from taichi_ldem.solver.dynamics import Dynamics
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.state import field_apart

STRETCHED = 3**-0.5
"""Share of the critical time step at rest that is stable at any deformation.

A bar of stiffness k at length ratio r has the tangent stiffness k along itself and k (1 - 1/r) < k
across, so no deformation takes omega^2 above that of the lattice whose bars had k in every
direction; averaged over three directions of motion that lattice's energy is three times the
lattice's own, so its omega^2 is at most three times that at rest. Softening and breaking lower it.
"""

TOLERANCE = 1e-3
"""Relative residual of the largest eigenvalue."""

MOST_STEPS = 200
"""Limit on the Lanczos steps; a plate of any size takes some fifteen."""


@ti.data_oriented
class Lanczos:
    """Lanczos' recurrence in the lattice's own fields, in the inner product of the masses.

    The displacement holds the latest vector u(j), the velocity the one before, times beta(j - 1). A
    step of one second that changes velocities alone then makes the velocity
    beta(j - 1) u(j - 1) - A u(j) with A = M^-1 K, which is all that the next vector needs. The
    vectors are so small (strains of about 1e-6) that the non-linear kernels respond linearly. Older
    vectors are not kept: the largest eigenvalue does not need them.

    Attributes:
        rows: 2-vectors in f64, products with the masses over a row or piece of it.
    """

    def __init__(self, dynamics: Dynamics):
        self.dynamics = dynamics
        nz, ny, _ = dynamics.sites
        self.rows = field_apart(ti.f64, nz * ny * dynamics.layout.pieces, 2)

    @ti.func
    def noise(self, number):
        """A number from -1/2 to 1/2 for each integer, the same on every backend."""
        x = ti.cast(number, ti.u32) * ti.u32(747796405) + ti.u32(1013904223)
        x = (x ^ ti.bit_shr(x, ti.u32(15))) * ti.u32(277803737)
        x = x ^ ti.bit_shr(x, ti.u32(13))
        return ti.cast(ti.bit_shr(x, ti.u32(8)), float) / 16777216.0 - 0.5

    @ti.kernel
    def start(self, size: float):
        """Put a random vector into displacement and velocity, zero where there is no node."""
        nz, ny, nx = ti.static(self.dynamics.sites)
        owned = ti.static((HALO, HALO + self.dynamics.lanes.length))
        for k, j, m in ti.ndrange((1, nz - 1), (1, ny - 1), owned):
            for s, axis in ti.static(self.dynamics.cell.node_axes):
                inverse = self.dynamics.lane_inverse_masses(s, k, j, m)
                vector = ti.Vector.zero(float, self.dynamics.lanes.width)
                for lane in ti.static(range(self.dynamics.lanes.width)):
                    site = (k * ny + j) * nx + self.dynamics.site_of(m, lane)
                    if inverse[lane] > 0:
                        vector[lane] = size * self.noise(6 * site + 3 * s + axis)
                self.dynamics.displacement[s][axis][0, k, j, m] = vector
                self.dynamics.velocity[s][axis][k, j, m] = vector
            self.dynamics.nodes.repeat_halo(0, k, j, m)

    @ti.kernel
    def _products(self):
        nz, ny = ti.static(self.dynamics.sites[:2])
        for j, k, piece in ti.ndrange((1, ny - 1), (1, nz - 1), self.dynamics.layout.pieces):
            sums = ti.Vector.zero(ti.f64, 2)
            begin = HALO + piece * self.dynamics.layout.piece
            for m in range(begin, self.dynamics.driver.piece_end(piece)):
                for s, axis in ti.static(self.dynamics.cell.node_axes):
                    mass = self.dynamics.lane_masses(s, k, j, m)
                    u = self.dynamics.displacement[s][axis][0, k, j, m]
                    v = self.dynamics.velocity[s][axis][k, j, m]
                    for lane in ti.static(range(self.dynamics.lanes.width)):
                        weighted = ti.cast(mass[lane], ti.f64) * v[lane]
                        sums[0] += weighted * u[lane]
                        sums[1] += weighted * v[lane]
            self.rows[(j * nz + k) * self.dynamics.layout.pieces + piece] = sums

    def products(self) -> tuple[float, float]:
        """Products u M v and v M v of displacement u and velocity v."""
        self._products()
        first, second = self.rows.to_numpy().sum(axis=0)
        return float(first), float(second)

    @ti.kernel
    def combine(self, p: float, q: float, r: float):
        """Displacement u and velocity v become p u + q v and r u."""
        nz, ny = ti.static(self.dynamics.sites[:2])
        owned = ti.static((HALO, HALO + self.dynamics.lanes.length))
        for k, j, m in ti.ndrange((1, nz - 1), (1, ny - 1), owned):
            for s, axis in ti.static(self.dynamics.cell.node_axes):
                u = self.dynamics.displacement[s][axis][0, k, j, m]
                v = self.dynamics.velocity[s][axis][k, j, m]
                self.dynamics.displacement[s][axis][0, k, j, m] = p * u + q * v
                self.dynamics.velocity[s][axis][k, j, m] = r * u
            self.dynamics.nodes.repeat_halo(0, k, j, m)

    def _amplitude(self) -> float:
        """Norm of the vectors, sqrt(kg) m.

        Even if all of it moved the lightest node, bars would be strained by no more than 1e-6 and a
        hundredth of the least eps_p: the kernels respond linearly and leave the history alone.
        """
        d = self.dynamics
        mass = d.masses() if d.features.density else d.mass.to_numpy()
        strain = min(1e-6, 1e-2 * _least_peak_strain(d))
        return float(strain * d.lattice.spacing * np.sqrt(mass[mass > 0].min()))

    def largest(self) -> float:
        """The largest eigenvalue of M^-1 K, (rad/s)^2; displacements and velocities end at zero."""
        self.start(1.0)
        norm, _ = self.products()
        size = self._amplitude() / np.sqrt(norm)
        self.combine(size, 0.0, 0.0)
        norm *= size**2
        diagonal: list[float] = []
        off_diagonal: list[float] = []
        found = 0.0
        for _ in range(MOST_STEPS):
            self.dynamics.kick(0, 1.0)
            product, square = self.products()
            diagonal.append(-product / norm)
            rest = square / norm - diagonal[-1] ** 2
            matrix = np.diag(diagonal) + np.diag(off_diagonal, 1) + np.diag(off_diagonal, -1)
            values, vectors = np.linalg.eigh(matrix)
            found = float(values[-1])
            # residual of the largest Ritz value; without a rest the value is exact
            if rest <= 1e-12 * found**2 or rest * vectors[-1, -1] ** 2 <= (TOLERANCE * found) ** 2:
                break
            off_diagonal.append(float(np.sqrt(rest)))
            beta = off_diagonal[-1]
            self.combine(-diagonal[-1] / beta, -1 / beta, beta)
        self.combine(0.0, 0.0, 0.0)
        self.dynamics.kick(0, 0.0)  # puts zeros into the other buffer, too
        return found


def critical_time_step(dynamics: Dynamics) -> float:
    """2 / omega_max of the lattice at rest, s.

    The Lanczos value approaches omega_max^2 from below; a tolerance of 1e-3 there is half of
    that in the time step. Displacements and velocities end at zero.
    """
    kept = vars(dynamics)  # another instance would compile its kernels anew
    if "estimate" not in kept:
        kept["estimate"] = Lanczos(dynamics)
    with dynamics.weightless():
        return float(2 / np.sqrt(kept["estimate"].largest()))


def _least_peak_strain(dynamics: Dynamics) -> float:
    """The smallest eps_p of any bar; infinite without damage."""
    if not dynamics.features.damage:
        return np.inf
    weakest = float(dynamics.weakest.to_numpy().min()) if dynamics.features.strength else 1.0
    return dynamics.peak_strain * weakest


def largest_strains(
    dynamics: Dynamics, displacement: npt.NDArray[np.float64]
) -> tuple[float, float]:
    """Largest and smallest strain of the bars that are not broken.

    Args:
        displacement: (sublattices, *S, 3), m.

    Returns:
        NaN where a position is not finite; (0, 0) where all bars are broken.
    """
    lattice, features, cell = dynamics.lattice, dynamics.features, dynamics.cell
    carries = lattice.bar_exists()
    if features.notch:
        removed = dynamics.lanes.gather(dynamics.removed.to_numpy())
        carries &= (removed[..., None] >> np.arange(cell.bars) & 1) == 0
    if features.damage:
        failure = dynamics.softening.to_numpy()[:, 0]
        for bar, peak in enumerate(dynamics.lanes.gather(dynamics.peak.to_numpy())):
            carries[..., bar] &= (peak >= 0) & (peak < failure[cell.family[bar]])
    extremes = [0.0]
    for bar, ends in enumerate(cell.ends):
        if carries[..., bar].any():
            first, second = (
                np.roll(displacement[kind], [-n for n in offset], axis=(0, 1, 2))
                for kind, offset in ends
            )
            rest = cell.vectors[bar] * lattice.spacing
            with np.errstate(over="ignore", invalid="ignore"):
                length = np.linalg.norm(second - first + rest, axis=-1)[carries[..., bar]]
            strain = length / np.linalg.norm(rest) - 1
            extremes += [float(strain.max()), float(strain.min())]
    return max(extremes, key=_nan_first), min(extremes, key=lambda e: -_nan_first(-e))


def _nan_first(value: float) -> float:
    return np.inf if np.isnan(value) else value


def chosen_time_step(scene: Scene, critical: float) -> tuple[float, int]:
    """Time step of a scene, s, and the number of steps between two samples.

    "auto" is the safety factor times the critical step (s), shortened so that a whole number of
    steps makes a history interval.

    Raises:
        SceneError: a time step above the critical one.
    """
    solver, interval = scene.solver, scene.output.history_interval
    if solver.time_step == "auto":
        every = int(np.ceil(interval / (solver.safety * critical) * (1 - 1e-12)))
        return interval / every, every
    chosen = float(solver.time_step)
    if chosen > critical and not solver.allow_unstable:
        raise SceneError(
            f"solver.time_step = {chosen}: above the critical time step {critical:.4g} s of "
            'this lattice; use "auto" or a smaller one (or solver.allow_unstable = true)'
        )
    return chosen, max(1, round(interval / chosen))
