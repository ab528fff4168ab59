"""Fields and the two-pass step: bar forces, then node update (Eq. (3), central differences).

Pass 1 evaluates each bar once and stores one scalar, its axial force over its current length. Pass
2 gathers these at each node, integrates, and writes the new displacement beside the old one (two
buffers, ``now`` and ``1 - now``), so no node sees a neighbour that has moved already. Both are
gathers, so nothing is summed atomically and the result does not depend on the number of threads.
All bars at a site are evaluated before the first store: a store between loads would make the
compiler reload base addresses.

Numbers that a study varies (time step, stiffness, masses, law parameters) are kernel arguments or
small tables, so they never recompile anything; which features exist does.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.lattice import (
    BAR_VECTORS,
    BARS_PER_SITE,
    DIAGONAL,
    LONGITUDINAL,
    Lattice,
    bar_weights,
    node_masses,
)
from taichi_ldem.laws import LAWS
from taichi_ldem.material import Bars

CORNER, CENTRE = 0, 1

# first and second node of each bar: sublattice, offset of its site (dz, dy, dx)
_X, _Y, _Z = (0, 0, 1), (0, 1, 0), (1, 0, 0)
_ENDS = (
    [((CORNER, (0, 0, 0)), (CORNER, axis)) for axis in (_X, _Y, _Z)]
    + [((CENTRE, (0, 0, 0)), (CENTRE, (-a[0], -a[1], -a[2]))) for a in (_X, _Y, _Z)]
    + [
        ((CENTRE, (0, 0, 0)), (CORNER, (dz, dy, dx)))
        for dz in (0, 1)
        for dy in (0, 1)
        for dx in (0, 1)
    ]
)


def _attached(sublattice: int) -> tuple[tuple, ...]:
    """Bars at a node: bar, offset of its site, sign, other end's sublattice and site offset."""
    bars = []
    for bar, ends in enumerate(_ENDS):
        for end, sign in ((0, 1), (1, -1)):
            if ends[end][0] != sublattice:
                continue
            other, here = ends[1 - end], ends[end][1]
            home = tuple(-n for n in here)
            there = tuple(o - n for o, n in zip(other[1], here, strict=True))
            bars.append((bar, home, sign, other[0], there))
    return tuple(bars)


ATTACHED = (_attached(CORNER), _attached(CENTRE))
STIFFNESS_KIND = (0, 1, 2, 3, 4, 5) + (6,) * 8


@dataclass(frozen=True)
class Features:
    """What a scene names beyond elasticity; the rest is neither allocated nor compiled.

    Attributes:
        law: name of the softening law, or None for an elastic lattice.
        damping: mass-proportional damping.
        notch: bars removed from the start.
    """

    law: str | None = None
    damping: bool = False
    notch: bool = False

    @property
    def damage(self) -> bool:
        """Whether bars have a history at all."""
        return self.law is not None


@ti.data_oriented
class Dynamics:
    """The lattice's state and its kernels.

    Attributes (site shape S = (nz + 3, ny + 3, nx + 3); ``real`` is Taichi's default float):
        displacement: (2, 2, *S) 3-vectors: buffer; corner, then centre, m.
        velocity: (2, *S) 3-vectors, m/s, half a step behind the displacement.
        axial: S 14-vector, axial force over current length of each bar, N/m.
        code: S, the lattice's byte.
        peak: S 14-vector, largest strain over eps_p so far (with damage).
        touched: S, 1 where a bar has ever passed eps_p: only there is ``peak`` read (with damage).
        recorded: S, one bit for each bar already reported broken (with damage).
        removed: S, one bit for each bar cut by a notch (with a notch).
        damped: (2, *S) energy lost by damping at each node, J (with damping).
    """

    def __init__(self, lattice: Lattice, bars: Bars, density: float, features: Features):
        self.lattice = lattice
        self.features = features
        sites = lattice.sites
        self.sites = sites
        self.rows = sites[0] * sites[1]
        self.displacement = ti.Vector.field(3, float, shape=(2, 2, *sites))
        self.velocity = ti.Vector.field(3, float, shape=(2, *sites))
        self.axial = ti.Vector.field(BARS_PER_SITE, float, shape=sites)
        self.code = ti.field(ti.u8, shape=sites)
        self.stiffness = ti.Vector.field(7, float, shape=256)
        self.mass = ti.Vector.field(2, float, shape=256)
        self.inverse_mass = ti.Vector.field(2, float, shape=256)
        if features.law is not None:
            self.law = LAWS[features.law]
            self.peak = ti.Vector.field(BARS_PER_SITE, float, shape=sites)
            self.touched = ti.field(ti.u8, shape=sites)
            self.recorded = ti.field(ti.u16, shape=sites)
            self.softening = ti.Vector.field(2, float, shape=2)
        if features.notch:
            self.removed = ti.field(ti.u16, shape=sites)
        if features.damping:
            self.damped = ti.field(float, shape=(2, *sites))
        self.code.from_numpy(lattice.code)
        self.set_bars(bars)
        self.set_density(density)

    def set_bars(self, bars: Bars) -> None:
        """Fill the tables of stiffness EA/L per site byte (N/m) and of the law's parameters."""
        stiff = bar_weights(self.lattice.surface_weights)[:, :7]
        stiff[:, LONGITUDINAL] *= bars.longitudinal.axial_stiffness / bars.longitudinal.length
        stiff[:, 6] *= bars.diagonal.axial_stiffness / bars.diagonal.length
        self.stiffness.from_numpy(stiff.astype(self.numpy_float()))
        self.peak_strain = bars.longitudinal.peak_strain
        if self.features.law is not None:
            table = [self.law.parameters(f.ductility) for f in (bars.longitudinal, bars.diagonal)]
            self.softening.from_numpy(np.array(table, dtype=self.numpy_float()))

    def set_density(self, density: float) -> None:
        """Fill the tables of node masses per site byte, kg."""
        mass = node_masses() * density * self.lattice.spacing**3
        inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0)
        self.mass.from_numpy(mass.astype(self.numpy_float()))
        self.inverse_mass.from_numpy(inverse.astype(self.numpy_float()))

    @staticmethod
    def numpy_float() -> type[np.floating]:
        """NumPy's name for Taichi's default float."""
        f64 = ti.lang.impl.get_runtime().default_fp == ti.f64
        return np.float64 if f64 else np.float32

    # -- pass 1
    # -------------------------------------------------------------------------------------

    @ti.func
    def reference_vector(self, bar: ti.template(), spacing):
        """Vector from a bar's first to its second node at rest, m."""
        return ti.Vector([ti.static(float(x)) for x in BAR_VECTORS[bar]]) * spacing

    @ti.func
    def elongation(self, bar: ti.template(), now, k, j, i, spacing):
        """Strain of a bar and its current length over its length at rest.

        With q = (2 X.d + d.d) / L0^2 the length ratio is sqrt(1 + q) and the strain q / (1 + sqrt(1
        + q)): no cancellation at small strain, exact at any rotation.
        """
        first, second = ti.static(_ENDS[bar])
        d = (
            self.displacement[now, second[0], k + second[1][0], j + second[1][1], i + second[1][2]]
            - self.displacement[now, first[0], k + first[1][0], j + first[1][1], i + first[1][2]]
        )
        share = ti.static(1.0 if bar < 6 else 4.0 / 3.0)
        q = (2 * self.reference_vector(bar, spacing) + d).dot(d) * (share / (spacing * spacing))
        ratio = ti.sqrt(ti.max(1 + q, 1e-12))
        return q / (1 + ratio), ratio

    @ti.func
    def integrity(self, bar: ti.template(), strain, peak):
        """Share of its stiffness that a bar keeps at a strain, given its peak strain over eps_p."""
        law = ti.static(self.softening_row(bar))
        failure, parameter = self.softening[law][0], self.softening[law][1]
        share = 1.0
        if peak >= failure:
            share = 0.0
        elif peak > 1 and strain > 0:
            share = self.law.softening(peak, failure, parameter) / peak
        return share

    @ti.func
    def dissipated(self, bar: ti.template(), peak):
        """Energy that a bar has dissipated at a peak strain, in units of EA eps_p^2 L0."""
        law = ti.static(self.softening_row(bar))
        failure, parameter = self.softening[law][0], self.softening[law][1]
        energy = 0.0
        if peak >= failure:
            energy = 0.5
            if failure > 1:
                energy += self.law.area(failure, failure, parameter)
        elif peak > 1:
            force = self.law.softening(peak, failure, parameter)
            energy = 0.5 + self.law.area(peak, failure, parameter) - 0.5 * force * peak
        return energy

    @staticmethod
    def softening_row(bar: int) -> int:
        """Row of the softening table for a bar number."""
        return 0 if bar < DIAGONAL.start else 1

    @ti.func
    def site_forces(self, now, k, j, i, spacing, peak_strain):
        """Axial force over current length of a site's fourteen bars."""
        stiffness = self.stiffness[int(self.code[k, j, i])]
        force = ti.Vector.zero(float, BARS_PER_SITE)
        strain = ti.Vector.zero(float, BARS_PER_SITE)
        largest = 0.0
        for bar in ti.static(range(BARS_PER_SITE)):
            e, ratio = self.elongation(bar, now, k, j, i, spacing)
            whole = stiffness[ti.static(STIFFNESS_KIND[bar])]
            force[bar] = whole * e / ratio
            if ti.static(self.features.notch):
                if (self.removed[k, j, i] >> bar) & 1:
                    force[bar] = 0.0
                    e = 0.0
            if ti.static(self.features.damage):
                strain[bar] = e
                # a bar that does not exist ends at a ghost node, which stays at rest
                largest = ti.max(largest, ti.select(whole > 0, e, 0.0))
        if ti.static(self.features.damage):
            if self.touched[k, j, i] != 0 or largest > peak_strain:
                self.touched[k, j, i] = ti.u8(1)
                for bar in ti.static(range(BARS_PER_SITE)):
                    peak = ti.max(self.peak[k, j, i][bar], strain[bar] / peak_strain)
                    self.peak[k, j, i][bar] = peak
                    force[bar] *= self.integrity(bar, strain[bar], peak)
        self.axial[k, j, i] = force

    @ti.func
    def bar_forces(self, now, spacing, peak_strain):
        """Pass 1."""
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in ti.static(self.sites)]):
            self.site_forces(now, k, j, i, spacing, peak_strain)

    # -- pass 2
    # -------------------------------------------------------------------------------------

    @ti.func
    def node_force(self, sublattice: ti.template(), now, k, j, i, spacing):
        """Sum of the bar forces on a node, N."""
        here = self.displacement[now, sublattice, k, j, i]
        force = ti.Vector.zero(float, 3)
        for bar, home, sign, other, there in ti.static(ATTACHED[sublattice]):
            axial = self.axial[k + home[0], j + home[1], i + home[2]][bar]
            d = self.displacement[now, other, k + there[0], j + there[1], i + there[2]] - here
            force += axial * (sign * self.reference_vector(bar, spacing) + d)
        return force

    @ti.func
    def free_velocity(self, sublattice: ti.template(), now, k, j, i, spacing, time_step, damping):
        """Velocity of a node half a step from now if nothing rigid is in its way, m/s."""
        inverse_mass = self.inverse_mass[int(self.code[k, j, i])][sublattice]
        force = self.node_force(sublattice, now, k, j, i, spacing)
        before = self.velocity[sublattice, k, j, i]
        after = before + time_step * inverse_mass * force
        if ti.static(self.features.damping):
            # C = alpha M at the mean of the two velocities: implicit, but diagonal
            half = 0.5 * damping * time_step
            after = (after - half * before) / (1 + half)
        return after

    @ti.func
    def move_nodes(self, now, spacing, time_step, damping):
        """Pass 2."""
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in ti.static(self.sites)]):
            for s in ti.static((CORNER, CENTRE)):
                after = self.free_velocity(s, now, k, j, i, spacing, time_step, damping)
                if ti.static(self.features.damping):
                    mean = 0.5 * (self.velocity[s, k, j, i] + after)
                    mass = self.mass[int(self.code[k, j, i])][s]
                    lost = damping * time_step * mass * mean.dot(mean)
                    self.damped[s, k, j, i] = self.damped[s, k, j, i] + lost
                self.velocity[s, k, j, i] = after
                self.displacement[1 - now, s, k, j, i] = (
                    self.displacement[now, s, k, j, i] + time_step * after
                )

    @ti.kernel
    def set_displacement(self, now: int, values: ti.types.ndarray()):
        """Copy (2, *S, 3) values into a buffer, m."""
        for s, k, j, i in ti.ndrange(2, *self.sites):
            for axis in ti.static(range(3)):
                self.displacement[now, s, k, j, i][axis] = ti.cast(values[s, k, j, i, axis], float)

    @ti.kernel
    def get_displacement(self, now: int, values: ti.types.ndarray()):
        """Copy a buffer into (2, *S, 3) values, m."""
        for s, k, j, i in ti.ndrange(2, *self.sites):
            for axis in ti.static(range(3)):
                values[s, k, j, i, axis] = self.displacement[now, s, k, j, i][axis]

    @ti.kernel
    def get_force(self, now: int, spacing: float, values: ti.types.ndarray()):
        """Sum the bar forces of the last ``forces`` at all nodes into (2, *S, 3) values, N."""
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in ti.static(self.sites)]):
            for s in ti.static((CORNER, CENTRE)):
                force = self.node_force(s, now, k, j, i, spacing)
                for axis in ti.static(range(3)):
                    values[s, k, j, i, axis] = force[axis]

    @ti.kernel
    def forces(self, now: int, spacing: float, peak_strain: float):
        """Pass 1 at the displacement ``now``."""
        self.bar_forces(now, spacing, peak_strain)

    @ti.kernel
    def kick(self, now: int, spacing: float, time_step: float, damping: float):
        """Add a time step's worth of bar forces to the velocities and move nothing."""
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in ti.static(self.sites)]):
            for s in ti.static((CORNER, CENTRE)):
                self.velocity[s, k, j, i] = self.free_velocity(
                    s, now, k, j, i, spacing, time_step, damping
                )

    @ti.kernel
    def collect_broken(self, found: ti.types.ndarray(), count: ti.types.ndarray()):
        """Append bars broken since the last call, in any order, for ``new_broken``."""
        for k, j, i in self.touched:
            if self.touched[k, j, i] != 0:
                recorded = int(self.recorded[k, j, i])
                weight = self.stiffness[int(self.code[k, j, i])]
                for bar in ti.static(range(BARS_PER_SITE)):
                    failure = self.softening[ti.static(self.softening_row(bar))][0]
                    broken = weight[ti.static(STIFFNESS_KIND[bar])] > 0
                    broken &= self.peak[k, j, i][bar] >= failure
                    if broken and (recorded >> bar) & 1 == 0:
                        place = ti.atomic_add(count[0], 1)
                        if place < found.shape[0]:
                            found[place, 0], found[place, 1] = k, j
                            found[place, 2], found[place, 3] = i, bar
                            recorded |= 1 << bar
                self.recorded[k, j, i] = ti.cast(recorded, ti.u16)

    def new_broken(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Sites (n, 3) as k, j, i and numbers (n,) of bars broken since the last call, in order."""
        rows = []
        while True:
            found = np.zeros((65536, 4), dtype=np.int32)
            count = np.zeros(1, dtype=np.int32)
            self.collect_broken(found, count)
            rows.append(found[: count[0]])
            if count[0] <= len(found):
                break
        broken = np.concatenate(rows).astype(np.int64)
        broken = broken[np.lexsort(broken.T[::-1])]
        return broken[:, :3], broken[:, 3]


def field_bytes(field: ti.Field) -> int:
    """Bytes that a dense field holds."""
    size = np.dtype(ti.lang.util.to_numpy_type(field.dtype)).itemsize
    return int(np.prod(field.shape)) * getattr(field, "n", 1) * size
