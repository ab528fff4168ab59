"""Fields and the two-pass step: bar forces, then node update (Eq. (3), central differences).

Pass 1 evaluates each bar once and stores one scalar, its axial force over its current length. Pass
2 gathers these at each node, integrates, and writes the new displacement beside the old one (two
buffers, ``now`` and ``1 - now``), so no node sees a neighbour that has moved already. Both are
gathers, so nothing is summed atomically and the result does not depend on the number of threads.

Both passes work on columns of several sites at once (``lanes``). On the CPU a thread takes a strip
of rows and alternates between the passes row by row, so that the scalars never leave its cache; two
rows at the borders of a strip are evaluated by both neighbours, with the same result. On a GPU the
passes are two launches.

Numbers that a study varies (time step, stiffness, masses, law parameters) are kernel arguments or
small tables, so they never recompile anything; which features exist does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.model.lattice import (
    BAR_VECTORS,
    BARS_PER_SITE,
    DIAGONAL,
    LONGITUDINAL,
    Lattice,
    bar_weights,
    node_masses,
)
from taichi_ldem.model.material import Bars
from taichi_ldem.solver.lanes import HALO, Lanes
from taichi_ldem.solver.laws import LAWS

CORNER, CENTRE = 0, 1

ALL = None
"""In place of a lane: every lane of a column at once."""


def _every(lane: Any) -> bool:
    return lane is ALL


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


def _attached(sublattice: int) -> list[tuple]:
    """A node's bars: towards +x, -x, +y, -y, +z, -z, then the diagonals by number.

    Each is (bar, offset of its site, other end's sublattice, offset of the other end's site).
    """
    bars = {}
    for bar, ends in enumerate(_ENDS):
        for end, sign in ((0, 1), (1, -1)):
            if ends[end][0] != sublattice:
                continue
            other, here = ends[1 - end], ends[end][1]
            home = tuple(-n for n in here)
            there = tuple(o - n for o, n in zip(other[1], here, strict=True))
            axis = int(np.argmax(np.abs(BAR_VECTORS[bar])))
            order = 6 + bar
            if bar < DIAGONAL.start:
                order = 2 * axis + int(sign * BAR_VECTORS[bar][axis] < 0)
            bars[order] = (bar, home, other[0], there)
    return [bars[order] for order in sorted(bars)]


SCALARS = tuple(tuple((bar, home) for bar, home, _, _ in _attached(s)) for s in (CORNER, CENTRE))
"""Where a node of each sublattice finds the scalars of its bars: bar, offset of its site."""

NEIGHBOURS = tuple(
    tuple((other, there) for _, _, other, there in _attached(s)) for s in (CORNER, CENTRE)
)
"""The nodes at the other ends, in the same order: sublattice, offset of the site."""

STIFFNESS_KIND = (0, 1, 2, 3, 4, 5) + (6,) * 8

NODE_AXES = tuple((s, axis) for s in (CORNER, CENTRE) for axis in range(3))

LEVERS = tuple(
    tuple(tuple(6 + d for d in range(8) if (d >> axis & 1) == side) for side in (1, 0))
    for axis in range(3)
)
"""For each axis the places in SCALARS of the diagonals that a centre has above and below it."""

TINY = 1e-12
"""Least square of a bar's length ratio: a bar whose ends meet has no direction to push in."""


CLOSE = 1 - 1e-5
"""Share of the force at eps_p from which a bar's strain is compared with it: within the rounding of
f32, so that the force only spares bars that are well below."""

RING = 4
"""Rows of bar scalars that a strip keeps: the three that a row of nodes gathers from, and a spare
that makes the row's place a bit mask."""

STRIPS_PER_THREAD = 2
ROWS_PER_STRIP = 4
"""Fewest rows of a strip: two more are evaluated by both neighbours."""

PIECE = 16
"""Columns of a row that one thread of a GPU sums up."""

TURNS = 512
"""Taichi hands a CPU thread at least this many turns of a parallel loop."""


def field_apart(kind: Any, shape: tuple[int, ...] | int, numbers: int = 0) -> ti.Field:
    """A field of numbers (or vectors of so many) that are not of Taichi's default width.

    On SPIR-V backends it gets a tree of its own: in one that it shared with other widths, it would
    be read and written in words that overlap its neighbours. LLVM's backends align it, and hold no
    more than 512 trees in a process.
    """
    vector = (
        (lambda **where: ti.Vector.field(numbers, kind, **where))
        if numbers
        else (lambda **where: ti.field(kind, **where))
    )
    if ti.lang.impl.current_cfg().arch in (ti.x64, ti.arm64, ti.cuda):
        return vector(shape=shape)
    field, sizes = vector(), (shape,) if isinstance(shape, int) else shape
    tree = ti.FieldsBuilder()
    tree.dense(getattr(ti, "ijkl"[: len(sizes)]), sizes).place(field)
    tree.finalize()
    return field


def _lane_bits(lanes: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint8]:
    """(...,) a bit for each of (..., width) lanes."""
    bits = np.uint8(1) << np.arange(lanes.shape[-1], dtype=np.uint8)
    return np.asarray((lanes * bits).sum(axis=-1, dtype=np.uint8))


@dataclass(frozen=True)
class Features:
    """What a scene names beyond elasticity; the rest is neither allocated nor compiled.

    Attributes:
        law: name of the softening law, or None for an elastic lattice.
        damping: mass-proportional damping.
        notch: bars removed from the start.
        strength: every bar has an eps_p of its own.
        modulus: every bar has a Young's modulus of its own.
        density: every node has a mass of its own.
        perturbed: nodes lie off the regular lattice, and every bar has a vector of its own.
    """

    law: str | None = None
    damping: bool = False
    notch: bool = False
    strength: bool = False
    modulus: bool = False
    density: bool = False
    perturbed: bool = False

    @property
    def damage(self) -> bool:
        """Whether bars have a history at all."""
        return self.law is not None

    @property
    def history(self) -> bool:
        """Whether a bar may carry less than its elastic force."""
        return self.damage or self.notch


@ti.data_oriented
class Dynamics:
    """The lattice's state and its kernels.

    Fields that begin with a sublattice (corner, centre) or a bar are tuples of one Taichi field
    each. Every field of sites has a shape S = (nz + 3, ny + 3, columns) and elements of one number
    a lane (``lanes``); ``real`` is Taichi's default float.

    Attributes:
        displacement: [sublattice][axis] (2, *S), m; the first index is the buffer.
        velocity: [sublattice][axis] S, m/s, half a step behind the displacement.
        axial: [bar] (strips, rows, nz + 3, columns), axial force over current length, N/m.
        code: S, the lattice's byte.
        peak: [bar] S, largest strain over the bar's eps_p so far (with damage).
        touched: one a column, a bit for each lane where a bar has ever passed eps_p or was
            removed: only there is a bar more than elastic.
        recorded: S, one bit for each bar already reported broken (with damage).
        removed: S, one bit for each bar cut by a notch (with a notch).
        strength: [bar] S, eps_p over the families' (with disorder of it).
        weakest: one a column, the smallest strength of its bars: a cheap test, which spares most
            lanes a look at every bar's.
        modulus: [bar] S, Young's modulus over the mean (with disorder of it).
        own_mass, own_inverse_mass: [sublattice] S, kg, 1/kg (with disorder of density).
        offset: [sublattice][axis] S, how far nodes lie off the regular lattice, in module edges
            (perturbed).
        damped: [sublattice] S, energy lost by damping at each node, J (with damping).
        moving: 2-vectors in f64: kinetic energy and energy lost by damping at t_n, J, of the last
            measured step; one for each row j, or on a GPU for each piece of a row (j, k).
        kept: [sublattice][axis] (strips, nz + 3, columns), velocities of the row that a measured
            step moves, as they were before it (in strips).
    """

    def __init__(
        self,
        lattice: Lattice,
        bars: Bars,
        density: float,
        features: Features,
        in_strips: bool | None = None,
    ):
        """``in_strips``: how the passes are driven, if not as suits the backend (tests)."""
        self.lattice = lattice
        self.features = features
        nz, ny, nx = self.sites = lattice.sites
        config = ti.lang.impl.current_cfg()
        self.on_cpu = config.arch in (ti.x64, ti.arm64)
        self.in_strips = self.on_cpu if in_strips is None else in_strips
        size = np.dtype(self.numpy_float()).itemsize
        self.lanes = Lanes.fitting(nx, size) if self.in_strips else Lanes(nx)
        self.shape = (nz, ny, self.lanes.columns)
        self.strips, rows = 1, ny
        if self.in_strips:
            wanted = STRIPS_PER_THREAD * config.cpu_max_num_threads
            self.strips, rows = max(1, min(wanted, (ny - 2) // ROWS_PER_STRIP)), RING + 1
        self.displacement = [[self._field(2, *self.shape) for _ in "xyz"] for _ in "ab"]
        self.velocity = [[self._field(*self.shape) for _ in "xyz"] for _ in "ab"]
        ring = (self.strips, rows, nz, self.lanes.columns)
        self.axial = [self._field(*ring) for _ in range(BARS_PER_SITE)]
        self.code = field_apart(ti.u8, self.shape, self.lanes.width)
        self.pieces, self.piece = 1, self.lanes.length
        if self.in_strips:
            kept = (self.strips, nz, self.lanes.columns)
            self.kept = [[self._field(*kept) for _ in "xyz"] for _ in "ab"]
            self.moving = field_apart(ti.f64, ny, 2)
        else:
            self.pieces, self.piece = -(-self.lanes.length // PIECE), PIECE
            self.moving = field_apart(ti.f64, ny * nz * self.pieces, 2)
        self.stiffness = ti.Vector.field(7, float, shape=256)
        self.mass = ti.Vector.field(2, float, shape=256)
        self.inverse_mass = ti.Vector.field(2, float, shape=256)
        if features.history:
            self.touched = field_apart(ti.u8, self.shape)
        if features.law is not None:
            self.law = LAWS[features.law]
            self.peak = [self._field(*self.shape) for _ in range(BARS_PER_SITE)]
            self.recorded = field_apart(ti.u16, self.shape, self.lanes.width)
            self.softening = ti.Vector.field(2, float, shape=2)
        if features.notch:
            self.removed = field_apart(ti.u16, self.shape, self.lanes.width)
        if features.damping:
            self.damped = [self._field(*self.shape) for _ in "ab"]
        if features.strength:
            self.strength = [self._field(*self.shape) for _ in range(BARS_PER_SITE)]
            self.weakest = ti.field(float, shape=self.shape)
        if features.modulus:
            self.modulus = [self._field(*self.shape) for _ in range(BARS_PER_SITE)]
        if features.density:
            self.own_mass = [self._field(*self.shape) for _ in "ab"]
            self.own_inverse_mass = [self._field(*self.shape) for _ in "ab"]
        if features.perturbed:
            self.offset = [[self._field(*self.shape) for _ in "xyz"] for _ in "ab"]
            assert lattice.offsets is not None
            for s, axis in NODE_AXES:
                stored = self.lanes.spread(lattice.offsets[s, ..., axis] / lattice.spacing)
                self.offset[s][axis].from_numpy(stored.astype(self.numpy_float()))
        self.code.from_numpy(self.lanes.spread(lattice.code))
        self.set_bars(bars)
        self.set_density(density)

    def _field(self, *shape: int) -> ti.MatrixField:
        return ti.Vector.field(self.lanes.width, float, shape=shape)

    def fields(self) -> dict[str, list[ti.Field]]:
        """All fields by name; several where a name has one for each sublattice, axis or bar."""
        found = {}
        for name, value in vars(self).items():
            flat = np.array(value, dtype=object).ravel() if isinstance(value, list) else [value]
            if isinstance(flat[0], ti.Field):
                found[name] = list(flat)
        return found

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

    def set_strength(self, strength: npt.NDArray[np.float64]) -> None:
        """Give every bar its eps_p over the families': (nz + 3, ny + 3, nx + 3, 14)."""
        exists = bar_weights(False)[self.lattice.code] > 0
        self._fill(self.strength, strength)
        stored = self.lanes.spread(np.moveaxis(np.where(exists, strength, np.inf), -1, 0))
        weakest = stored.min(axis=(0, -1))
        weakest[np.isinf(weakest)] = 1.0
        # a hair below: the test compares forces, the history strains
        self.weakest.from_numpy((weakest * (1 - 1e-6)).astype(self.numpy_float()))

    def set_modulus(self, modulus: npt.NDArray[np.float64]) -> None:
        """Give every bar its modulus over the mean: (nz + 3, ny + 3, nx + 3, 14)."""
        self._fill(self.modulus, modulus)

    def _fill(self, bars: list[ti.MatrixField], values: npt.NDArray[np.float64]) -> None:
        """Fill the fields of the fourteen bars from (S, 14) values."""
        for bar, field in enumerate(bars):
            stored = self.lanes.spread(np.ascontiguousarray(values[..., bar]))
            field.from_numpy(stored.astype(self.numpy_float()))

    def set_own_density(self, density: float, factor: npt.NDArray[np.float64]) -> None:
        """Give every node the masses of the modules around it.

        Args:
            density: mean, kg/m3.
            factor: (nz, ny, nx) each module's density over it.
        """
        module = density * self.lattice.spacing**3 * np.where(self.lattice.mask, factor, 0.0)
        nz, ny, nx = module.shape
        mass = np.zeros((2, *self.sites))
        mass[1, 1 : 1 + nz, 1 : 1 + ny, 1 : 1 + nx] = module / 2
        for dz, dy, dx in np.ndindex(2, 2, 2):
            mass[0, 1 + dz : 1 + dz + nz, 1 + dy : 1 + dy + ny, 1 + dx : 1 + dx + nx] += module / 16
        inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0)
        for fields, values in ((self.own_mass, mass), (self.own_inverse_mass, inverse)):
            for field, part in zip(fields, values, strict=True):
                field.from_numpy(self.lanes.spread(part).astype(self.numpy_float()))

    def masses(self) -> npt.NDArray[np.float64]:
        """(2, nz + 3, ny + 3, nx + 3) masses of all nodes, kg; 0 where there is none."""
        if self.features.density:
            rows = [self.lanes.gather(field.to_numpy()) for field in self.own_mass]
            return np.stack(rows).astype(np.float64)
        return np.moveaxis(self.mass.to_numpy()[self.lattice.code], -1, 0).astype(np.float64)

    def set_removed(self, removed: npt.NDArray[np.uint16]) -> None:
        """Remove bars, one bit each: (nz + 3, ny + 3, nx + 3)."""
        stored = self.lanes.spread(removed)
        self.removed.from_numpy(stored)
        self.touched.from_numpy(_lane_bits(stored != 0))

    def set_peak(self, peak: npt.NDArray[np.float64]) -> None:
        """Age bars to peak strains over their eps_p: (nz + 3, ny + 3, nx + 3, 14)."""
        stored = self.lanes.spread(np.moveaxis(peak, -1, 0))
        for field, values in zip(self.peak, stored, strict=True):
            field.from_numpy(values.astype(self.numpy_float()))
        self._touch(stored)

    def _touch(self, peak: npt.NDArray) -> None:
        """Mark the lanes with a bar beyond its eps_p, from (14, *S, width) peak strains over it."""
        self.touched.from_numpy(_lane_bits(np.any(peak > 1, axis=0)) | self.touched.to_numpy())

    EVOLVING = ("velocity", "peak", "recorded", "damped")
    """Fields that carry the state from one step to the next, where a scene has them, beside the
    displacement at ``now``: the bar forces and the other buffer are overwritten in every step, and
    ``touched`` follows from the peak strains."""

    def saved_state(self, now: int) -> dict[str, npt.NDArray]:
        """Copies of what the next step starts from, between two steps: (fields of a name, *sites).

        As the lattice has them, not as they lie in lanes, which are of the machine.
        """
        fields = self.fields()
        saved = {
            name: np.stack([self.lanes.gather(field.to_numpy()) for field in fields[name]])
            for name in self.EVOLVING
            if name in fields
        }
        moved = [self.lanes.gather(field.to_numpy()[now]) for field in fields["displacement"]]
        return saved | {"displacement": np.stack(moved)}

    def restore_state(self, saved: Mapping[str, npt.NDArray]) -> None:
        """Continue from ``saved_state``, with the displacement in both buffers."""
        both = {"displacement": np.stack([saved["displacement"]] * 2, axis=1)}
        for name, values in (saved | both).items():  # type: ignore[operator]
            for field, part in zip(self.fields()[name], values, strict=True):
                field.from_numpy(self.lanes.spread(part))
        if self.features.damage:
            self._touch(self.lanes.spread(saved["peak"]))

    @property
    def spacing(self) -> float:
        """Module edge as kernels have it, rounded to Taichi's float, m.

        What touches the lattice must start from it: a ring at the exact height of a plate whose
        nodes are single precision's higher would push them on the first step.
        """
        return float(self.numpy_float()(self.lattice.spacing))

    @staticmethod
    def numpy_float() -> type[np.floating]:
        """NumPy's name for Taichi's default float."""
        f64 = ti.lang.impl.get_runtime().default_fp == ti.f64
        return np.float64 if f64 else np.float32

    # -- pass 1
    # -------------------------------------------------------------------------------------

    @ti.func
    def lane_values(self, table: ti.template(), code, entry: ti.template()):
        """A table's entry for the byte of each lane."""
        return ti.Vector([table[int(code[n])][entry] for n in ti.static(range(self.lanes.width))])

    @ti.func
    def lane_masses(self, s: ti.template(), k, j, m):
        """Masses of a column's corner or centre nodes, kg."""
        mass = self.lane_values(self.mass, self.code[k, j, m], s)
        if ti.static(self.features.density):
            mass = self.own_mass[s][k, j, m]
        return mass

    @ti.func
    def lane_inverse_masses(self, s: ti.template(), k, j, m):
        """Inverse masses of a column's corner or centre nodes, 1/kg."""
        inverse = self.lane_values(self.inverse_mass, self.code[k, j, m], s)
        if ti.static(self.features.density):
            inverse = self.own_inverse_mass[s][k, j, m]
        return inverse

    @ti.func
    def bar_stiffnesses(self, bar: ti.template(), k, j, m):
        """EA/L of a bar in every lane, N/m; 0 where there is none."""
        whole = self.lane_values(self.stiffness, self.code[k, j, m], ti.static(STIFFNESS_KIND[bar]))
        if ti.static(self.features.modulus):
            whole *= self.modulus[bar][k, j, m]
        if ti.static(self.features.perturbed):
            whole *= ti.sqrt(self.shortness(bar, k, j, m, ALL))
        return whole

    @ti.func
    def bar_stiffness(self, bar: ti.template(), k, j, m, lane):
        """EA/L of a bar in one lane, N/m; 0 where there is none."""
        whole = self.stiffness[int(self.code[k, j, m][lane])][ti.static(STIFFNESS_KIND[bar])]
        if ti.static(self.features.modulus):
            whole *= self.modulus[bar][k, j, m][lane]
        if ti.static(self.features.perturbed):
            whole *= ti.sqrt(self.shortness(bar, k, j, m, lane))
        return whole

    @ti.func
    def own_vector(self, bar: ti.template(), axis: ti.template(), k, j, m, lane: ti.template()):
        """A perturbed bar's vector along an axis, in module edges."""
        first, second = ti.static(_ENDS[bar])
        a, b = ti.static(first[1], second[1])
        far, near = ti.static(self.offset[second[0]][axis], self.offset[first[0]][axis])
        along = ti.static(float(BAR_VECTORS[bar][axis]))
        if ti.static(_every(lane)):
            return along + (far[k + b[0], j + b[1], m + b[2]] - near[k + a[0], j + a[1], m + a[2]])
        else:
            return along + (
                far[k + b[0], j + b[1], m + b[2]][lane] - near[k + a[0], j + a[1], m + a[2]][lane]
            )

    @ti.func
    def shortness(self, bar: ti.template(), k, j, m, lane: ti.template()):
        """Square of a regular bar's length over that of a perturbed one."""
        x, y, z = [self.own_vector(bar, axis, k, j, m, lane) for axis in ti.static(range(3))]
        return ti.static(1.0 if bar < 6 else 0.75) / ((x * x + y * y) + z * z)

    @ti.func
    def own_peak_strain(self, bar: ti.template(), k, j, m, lane, peak_strain):
        """A bar's eps_p, given the families'."""
        own = peak_strain
        if ti.static(self.features.strength):
            own = peak_strain * self.strength[bar][k, j, m][lane]
        return own

    @ti.func
    def difference(
        self, bar: ti.template(), axis: ti.template(), now, k, j, m, lane: ti.template()
    ):
        """Displacement of a bar's second node less that of its first, along an axis, m."""
        first, second = ti.static(_ENDS[bar])
        a, b = ti.static(first[1], second[1])
        far, near = ti.static(self.displacement[second[0]][axis], self.displacement[first[0]][axis])
        if ti.static(_every(lane)):
            return far[now, k + b[0], j + b[1], m + b[2]] - near[now, k + a[0], j + a[1], m + a[2]]
        else:
            return (
                far[now, k + b[0], j + b[1], m + b[2]][lane]
                - near[now, k + a[0], j + a[1], m + a[2]][lane]
            )

    @ti.func
    def product(
        self, bar: ti.template(), axis: ti.template(), now, k, j, m, spacing, lane: ti.template()
    ):
        """(2 X + d) d along one axis."""
        d = self.difference(bar, axis, now, k, j, m, lane)
        twice = ti.static(float(2 * BAR_VECTORS[bar][axis]))
        result = d * d
        if ti.static(self.features.perturbed):
            result = (d + (2 * spacing) * self.own_vector(bar, axis, k, j, m, lane)) * d
        elif ti.static(twice != 0):
            result = (d + twice * spacing) * d
        return result

    @ti.func
    def stretch(self, bar: ti.template(), now, k, j, m, spacing, lane: ti.template()):
        """q = (l^2 - L0^2) / L0^2 = (2 X + d).d / L0^2 of a bar, in one lane or in ALL.

        The strain is q / (1 + sqrt(1 + q)): no cancellation at small strain, exact at any rotation.
        """
        x, y, z = ti.static(range(3))
        square = (
            self.product(bar, x, now, k, j, m, spacing, lane)
            + self.product(bar, y, now, k, j, m, spacing, lane)
        ) + self.product(bar, z, now, k, j, m, spacing, lane)
        result = square * (ti.static(1.0 if bar < 6 else 4.0 / 3.0) / (spacing * spacing))
        if ti.static(self.features.perturbed):
            result *= self.shortness(bar, k, j, m, lane)
        return result

    @ti.func
    def strain(self, q):
        """Strain of a bar from its stretch."""
        return q / (1 + ti.sqrt(ti.max(1 + q, TINY)))

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
    def soften(self, lanes, strip, row, now, k, j, m, spacing, peak_strain):
        """Bring some lanes' history up to date and take from their bars what these have lost."""
        for lane in range(self.lanes.width):
            if (lanes >> lane) & 1:
                for bar in ti.static(range(BARS_PER_SITE)):
                    whole = self.axial[bar][strip, row, k, m][lane]
                    if self.beyond_elastic(bar, whole, k, j, m, lane, peak_strain):
                        strain = self.strain(self.stretch(bar, now, k, j, m, spacing, lane))
                        share = self.kept_share(bar, k, j, m, lane, strain, peak_strain)
                        self.axial[bar][strip, row, k, m][lane] = share * whole

    @ti.func
    def beyond_elastic(self, bar: ti.template(), force, k, j, m, lane, peak_strain):
        """Whether a bar is cut, has passed its eps_p, or is CLOSE to it by its force."""
        found = False
        if ti.static(self.features.damage):
            own = self.own_peak_strain(bar, k, j, m, lane, peak_strain)
            most = CLOSE / (1 + 1 / own) * self.bar_stiffness(bar, k, j, m, lane)
            found |= force > most or self.peak[bar][k, j, m][lane] > 1
        if ti.static(self.features.notch):
            found |= (self.removed[k, j, m][lane] >> bar) & 1 != 0
        return found

    @ti.func
    def kept_share(self, bar: ti.template(), k, j, m, lane, strain, peak_strain):
        """Share of its elastic force that a bar carries, its history brought up to date."""
        share = 1.0
        if ti.static(self.features.notch):
            if (self.removed[k, j, m][lane] >> bar) & 1:
                share = 0.0
        if ti.static(self.features.damage):
            if share > 0:
                peak = self.peak[bar][k, j, m][lane]
                own = self.own_peak_strain(bar, k, j, m, lane, peak_strain)
                if strain > peak * own:
                    peak = strain / own
                    self.peak[bar][k, j, m][lane] = peak
                if peak > 1:
                    # no atomic: who evaluates the column beside writes the same
                    bits = int(self.touched[k, j, m]) | 1 << lane
                    self.touched[k, j, m] = ti.cast(bits, ti.u8)
                share = self.integrity(bar, strain, peak)
        return share

    @ti.func
    def column_forces(self, strip, row, now, k, j, m, spacing, peak_strain):
        """Axial force over current length of the fourteen bars of a column's sites.

        With r = l / L0 = sqrt(1 + q), EA/L0 (r - 1) / r = EA/L0 q / (r^2 + r).
        """
        force = ti.Matrix.zero(float, BARS_PER_SITE, self.lanes.width)
        # how far the forces are above that of a bar close to eps_p
        excess = ti.Vector.zero(float, self.lanes.width)
        least = peak_strain
        if ti.static(self.features.strength):
            least = peak_strain * self.weakest[k, j, m]
        allowed = CLOSE / (1 + 1 / least)
        for bar in ti.static(range(BARS_PER_SITE)):
            whole = self.bar_stiffnesses(bar, k, j, m)
            q = self.stretch(bar, now, k, j, m, spacing, ALL)
            square = ti.max(1 + q, TINY)
            pull = (whole * q) / (square + ti.sqrt(square))
            for lane in ti.static(range(self.lanes.width)):
                force[bar, lane] = pull[lane]
            if ti.static(self.features.damage):
                excess = ti.max(excess, pull - whole * allowed)
        # all arithmetic before the first store: after it the compiler reloads every address
        for bar in ti.static(range(BARS_PER_SITE)):
            for lane in ti.static(range(self.lanes.width)):
                self.axial[bar][strip, row, k, m][lane] = force[bar, lane]
        if ti.static(self.features.history):
            soft = self.touched[k, j, m] != 0
            for lane in ti.static(range(self.lanes.width)):
                soft |= excess[lane] > 0
            if soft:
                lanes = int(self.touched[k, j, m])
                for lane in ti.static(range(self.lanes.width)):
                    lanes |= int(excess[lane] > 0) << lane
                self.soften(lanes, strip, row, now, k, j, m, spacing, peak_strain)

    @ti.func
    def row_place(self, j):
        """Where a strip keeps the bar scalars of row j; those of the ghost rows are always zero."""
        place = j
        if ti.static(self.in_strips):
            place = j % RING
            if j == 0 or j == ti.static(self.sites[1] - 1):
                place = RING
        return place

    @ti.func
    def row_forces(self, strip, now, j, spacing, peak_strain):
        """Pass 1 for a row of sites."""
        if 0 < j < ti.static(self.sites[1] - 1):
            for k in range(1, self.sites[0] - 1):
                for m in range(HALO - 1, HALO + self.lanes.length + 1):
                    self.column_forces(strip, self.row_place(j), now, k, j, m, spacing, peak_strain)

    # -- pass 2
    # -------------------------------------------------------------------------------------

    @ti.func
    def moved(self, s: ti.template(), axis: ti.template(), now, k, j, m, spacing):
        """Way of a column's nodes from their places in the regular lattice, m."""
        way = self.displacement[s][axis][now, k, j, m]
        if ti.static(self.features.perturbed):
            way += spacing * self.offset[s][axis][k, j, m]
        return way

    @ti.func
    def node_force(self, s: ti.template(), axis: ti.template(), strip, rows, now, k, j, m, spacing):
        """Sum of the bar forces on a column's corner or centre nodes along an axis, N.

        A bar with scalar a to the node that was X away pulls with a (X + u' - u); the sums of a u',
        a and the lever arms X are taken apart, each in pairs.
        """
        a = [
            self.axial[bar][strip, rows[home[1] + 1], k + home[0], m + home[2]]
            for bar, home in ti.static(SCALARS[s])
        ]
        u = [
            self.moved(other, axis, now, k + there[0], j + there[1], m + there[2], spacing)
            for other, there in ti.static(NEIGHBOURS[s])
        ]
        moved = ((a[0] * u[0] + a[1] * u[1]) + (a[2] * u[2] + a[3] * u[3])) + (
            (a[4] * u[4] + a[5] * u[5]) + (a[6] * u[6] + a[7] * u[7])
        )
        moved += ((a[8] * u[8] + a[9] * u[9]) + (a[10] * u[10] + a[11] * u[11])) + (
            a[12] * u[12] + a[13] * u[13]
        )
        total = ((a[0] + a[1]) + (a[2] + a[3])) + ((a[4] + a[5]) + (a[6] + a[7]))
        total += ((a[8] + a[9]) + (a[10] + a[11])) + (a[12] + a[13])
        p, q = ti.static(LEVERS[axis])
        lever = ((a[p[0]] - a[q[0]]) + (a[p[1]] - a[q[1]])) + (
            (a[p[2]] - a[q[2]]) + (a[p[3]] - a[q[3]])
        )
        edges = a[ti.static(2 * axis)] - a[ti.static(2 * axis + 1)]
        here = self.moved(s, axis, now, k, j, m, spacing)
        return moved + (spacing * (edges + ti.static(s - 0.5) * lever) - total * here)

    @ti.func
    def free_velocity(
        self,
        s: ti.template(),
        axis: ti.template(),
        strip,
        rows,
        now,
        k,
        j,
        m,
        spacing,
        kick,
        damping,
    ):
        """Velocity along an axis after a time ``kick`` if nothing rigid is in the way, m/s."""
        inverse_mass = self.lane_inverse_masses(s, k, j, m)
        force = self.node_force(s, axis, strip, rows, now, k, j, m, spacing)
        before = self.velocity[s][axis][k, j, m]
        after = before + (kick * inverse_mass) * force
        if ti.static(self.features.damping):
            # C = alpha M at the mean of the two velocities: implicit, but diagonal
            half = 0.5 * damping * kick
            after = (after - half * before) / (1 + half)
        return after

    @ti.func
    def move_column(
        self, strip, rows, now, k, j, m, spacing, kick, drift, damping, measure: ti.template()
    ):
        """Pass 2 for a column; with ``measure``, its kinetic energy and loss by damping at t_n."""
        sums = ti.Vector.zero(ti.f64, 2)
        for s in ti.static((CORNER, CENTRE)):
            for axis in ti.static(range(3)):
                after = self.free_velocity(
                    s, axis, strip, rows, now, k, j, m, spacing, kick, damping
                )
                if ti.static(measure or self.features.damping):
                    before = self.velocity[s][axis][k, j, m]
                    if ti.static(self.features.damping):
                        lost = self.drag_loss(s, k, j, m, before, after, kick, damping)
                        self.damped[s][k, j, m] = self.damped[s][k, j, m] + lost
                    if ti.static(measure):
                        sums += self.weighed(s, k, j, m, before, after, kick, damping)
                self.velocity[s][axis][k, j, m] = after
                self.displacement[s][axis][1 - now, k, j, m] = (
                    self.displacement[s][axis][now, k, j, m] + drift * after
                )
            if ti.static(measure):
                sums += self.damped_so_far(s, k, j, m)
        self.repeat_halo(1 - now, k, j, m)
        return sums

    @ti.func
    def drag_loss(self, s: ti.template(), k, j, m, before, after, kick, damping):
        """What a column loses by damping along an axis in a step, J."""
        mean = 0.5 * (before + after)
        return (damping * kick) * self.lane_masses(s, k, j, m) * mean * mean

    @ti.func
    def weighed(self, s: ti.template(), k, j, m, before, after, kick, damping):
        """A column's kinetic energy along an axis at t_n from the velocities around it.

        And, negative, what of this step's loss by damping belongs after t_n; J.
        """
        mass = self.lane_masses(s, k, j, m)
        sums = ti.Vector.zero(ti.f64, 2)
        for lane in ti.static(range(self.lanes.width)):
            sums[0] += 0.5 * mass[lane] * before[lane] * after[lane]
        if ti.static(self.features.damping):
            mean = 0.5 * (before + after)
            lost = self.drag_loss(s, k, j, m, before, after, kick, damping)
            half = (0.5 * damping * kick) * mass * mean * before - lost
            for lane in ti.static(range(self.lanes.width)):
                sums[1] += half[lane]
        return sums

    @ti.func
    def damped_so_far(self, s: ti.template(), k, j, m):
        """What a column has lost by damping, this step's loss included, as the second sum, J."""
        sums = ti.Vector.zero(ti.f64, 2)
        if ti.static(self.features.damping):
            for lane in ti.static(range(self.lanes.width)):
                sums[1] += ti.cast(self.damped[s][k, j, m][lane], ti.f64)
        return sums

    @ti.func
    def repeat_halo(self, now, k, j, m):
        """Copy a column's displacement to the columns that repeat it for another lane."""
        length, width = ti.static(self.lanes.length, self.lanes.width)
        if m < 2 * HALO:
            for s, axis in ti.static(NODE_AXES):
                for lane in ti.static(range(1, width)):
                    self.displacement[s][axis][now, k, j, m + length][lane - 1] = self.displacement[
                        s
                    ][axis][now, k, j, m][lane]
        if m >= length:
            for s, axis in ti.static(NODE_AXES):
                for lane in ti.static(range(width - 1)):
                    self.displacement[s][axis][now, k, j, m - length][lane + 1] = self.displacement[
                        s
                    ][axis][now, k, j, m][lane]

    @ti.func
    def move_row(self, strip, j, now, spacing, kick, drift, damping, measure):
        """Pass 2 for a row of a strip; ``measure`` is asked once a row, so it costs no kernel."""
        if measure != 0:
            self.keep_row(strip, j)
        rows = ti.Vector([self.row_place(j + offset) for offset in ti.static((-1, 0, 1))])
        for k in range(1, self.sites[0] - 1):
            for m in range(HALO, HALO + self.lanes.length):
                self.move_column(strip, rows, now, k, j, m, spacing, kick, drift, damping, False)
        if measure != 0:
            self.weigh_row(strip, j, kick, damping)

    @ti.func
    def keep_row(self, strip, j):
        """Remember a row's velocities."""
        for k in range(1, self.sites[0] - 1):
            for m in range(HALO, HALO + self.lanes.length):
                for s, axis in ti.static(NODE_AXES):
                    self.kept[s][axis][strip, k, m] = self.velocity[s][axis][k, j, m]

    @ti.func
    def weigh_row(self, strip, j, kick, damping):
        """Sum up kinetic energy and losses of a row that has just been moved."""
        sums = ti.Vector.zero(ti.f64, 2)
        for k in range(1, self.sites[0] - 1):
            for m in range(HALO, HALO + self.lanes.length):
                column = ti.Vector.zero(ti.f64, 2)
                for s in ti.static((CORNER, CENTRE)):
                    for axis in ti.static(range(3)):
                        before = self.kept[s][axis][strip, k, m]
                        after = self.velocity[s][axis][k, j, m]
                        column += self.weighed(s, k, j, m, before, after, kick, damping)
                    column += self.damped_so_far(s, k, j, m)
                sums += column
        self.moving[j] = sums

    @ti.func
    def step_strip(self, strip, now, spacing, kick, drift, damping, peak_strain, measure):
        """Both passes for a strip of rows, a row of bars ahead of the nodes."""
        inner, strips = ti.static(self.sites[1] - 2, self.strips)
        begin, end = 1 + inner * strip // strips, 1 + inner * (strip + 1) // strips
        for j in range(begin - 1, end + 1):
            self.row_forces(strip, now, j, spacing, peak_strain)
            if j > begin:
                self.move_row(strip, j - 1, now, spacing, kick, drift, damping, measure)

    @ti.func
    def piece_end(self, piece):
        """Column after the last of a piece of a row."""
        return HALO + ti.min((piece + 1) * self.piece, self.lanes.length)

    @ti.func
    def whole_passes(self, now, spacing, kick, drift, damping, peak_strain, measure: ti.template()):
        """A step in two launches; with ``measure`` a thread sums up a piece of a row."""
        nz, ny, _ = ti.static(self.sites)
        begin, end = ti.static(HALO, HALO + self.lanes.length)
        for j, k, m in ti.ndrange((1, ny - 1), (1, nz - 1), (begin - 1, end + 1)):
            self.column_forces(0, j, now, k, j, m, spacing, peak_strain)
        if ti.static(measure):
            for j, k, piece in ti.ndrange((1, ny - 1), (1, nz - 1), self.pieces):
                rows = ti.Vector([j - 1, j, j + 1])
                sums = ti.Vector.zero(ti.f64, 2)
                for m in range(begin + piece * self.piece, self.piece_end(piece)):
                    sums += self.move_column(
                        0, rows, now, k, j, m, spacing, kick, drift, damping, True
                    )
                self.moving[(j * nz + k) * self.pieces + piece] = sums
        else:
            for j, k, m in ti.ndrange((1, ny - 1), (1, nz - 1), (begin, end)):
                rows = ti.Vector([j - 1, j, j + 1])
                self.move_column(0, rows, now, k, j, m, spacing, kick, drift, damping, False)

    @ti.kernel
    def _step_in_strips(
        self,
        now: int,
        spacing: float,
        kick: float,
        drift: float,
        damping: float,
        peak_strain: float,
        measure: int,
    ):
        for turn in range(self.strips * TURNS):
            if turn % TURNS == 0:
                self.step_strip(
                    turn // TURNS, now, spacing, kick, drift, damping, peak_strain, measure
                )

    @ti.kernel
    def _step_in_passes(
        self,
        now: int,
        spacing: float,
        kick: float,
        drift: float,
        damping: float,
        peak_strain: float,
        measure: ti.template(),
    ):
        self.whole_passes(now, spacing, kick, drift, damping, peak_strain, measure)

    def step(self, now: int, kick: float, drift: float, damping: float, measure: bool) -> None:
        """Take a step: bar forces at ``now``, then the nodes.

        Velocities change by the time ``kick``, displacements, into the other buffer, by the time
        ``drift``, s; both are the time step in a run. With ``measure`` kinetic energy and losses by
        damping at t_n are summed up (``moving``).
        """
        take = self._step_in_strips if self.in_strips else self._step_in_passes
        take(now, self.lattice.spacing, kick, drift, damping, self.peak_strain, measure)

    def kick(self, now: int, time_step: float, damping: float = 0.0) -> None:
        """Add a time step's worth of bar forces to the velocities and move nothing."""
        self.step(now, time_step, 0.0, damping, False)

    # -- single nodes
    # -------------------------------------------------------------------------------------

    @ti.func
    def column_of(self, i):
        """Column that owns site i of a row, and its lane there."""
        lane = (i - 1) // self.lanes.length
        return i - 1 - lane * self.lanes.length + HALO, lane

    @ti.func
    def site_of(self, m, lane):
        """Site at a place of a row (ghosts beyond either end are clipped)."""
        site = 1 + lane * self.lanes.length + m - HALO
        return ti.max(0, ti.min(site, ti.static(self.sites[2] - 1)))

    @ti.func
    def node_mass(self, s, k, j, i):
        """Mass of a node, kg; 0 where there is none."""
        m, lane = self.column_of(i)
        mass = self.mass[int(self.code[k, j, m][lane])]
        if ti.static(self.features.density):
            for sublattice in ti.static((CORNER, CENTRE)):
                mass[sublattice] = self.own_mass[sublattice][k, j, m][lane]
        chosen = mass[CORNER]
        if s == CENTRE:
            chosen = mass[CENTRE]
        return chosen

    @ti.func
    def node_displacement(self, now, s, k, j, i):
        """Displacement of a node, m."""
        m, lane = self.column_of(i)
        u = ti.Vector.zero(float, 3)
        for sublattice, axis in ti.static(NODE_AXES):
            if s == sublattice:
                u[axis] = self.displacement[sublattice][axis][now, k, j, m][lane]
        return u

    @ti.func
    def node_offset(self, s, k, j, i, spacing):
        """How far a node lies off the regular lattice, m, in f64."""
        m, lane = self.column_of(i)
        offset = ti.Vector.zero(ti.f64, 3)
        if ti.static(self.features.perturbed):
            for sublattice, axis in ti.static(NODE_AXES):
                if s == sublattice:
                    offset[axis] = ti.cast(self.offset[sublattice][axis][k, j, m][lane], ti.f64)
        return ti.cast(spacing, ti.f64) * offset

    @ti.func
    def node_velocity(self, s, k, j, i):
        """Velocity of a node, m/s."""
        m, lane = self.column_of(i)
        v = ti.Vector.zero(float, 3)
        for sublattice, axis in ti.static(NODE_AXES):
            if s == sublattice:
                v[axis] = self.velocity[sublattice][axis][k, j, m][lane]
        return v

    @ti.func
    def put_node(self, now, s, k, j, i, displacement, velocity):
        """Set a node's displacement (m) and velocity (m/s)."""
        m, lane = self.column_of(i)
        length, width = ti.static(self.lanes.length, self.lanes.width)
        for sublattice, axis in ti.static(NODE_AXES):
            if s == sublattice:
                self.velocity[sublattice][axis][k, j, m][lane] = velocity[axis]
                u = ti.static(self.displacement[sublattice][axis])
                u[now, k, j, m][lane] = displacement[axis]
                if m < 2 * HALO and lane > 0:
                    u[now, k, j, m + length][lane - 1] = displacement[axis]
                if m >= length and lane < width - 1:
                    u[now, k, j, m - length][lane + 1] = displacement[axis]

    @ti.func
    def add_damped(self, s, k, j, i, energy):
        """Add to the energy that a node has lost by damping, J."""
        m, lane = self.column_of(i)
        for sublattice in ti.static((CORNER, CENTRE)):
            if s == sublattice:
                lost = self.damped[sublattice][k, j, m][lane] + energy
                self.damped[sublattice][k, j, m][lane] = lost

    # -- exchange with the host
    # -------------------------------------------------------------------------------------

    @ti.kernel
    def set_displacement(self, now: int, values: ti.types.ndarray()):
        """Copy (2, nz + 3, ny + 3, nx + 3, 3) values into a buffer, m; ghosts must be zero."""
        for k, j, m in ti.ndrange(*self.shape):
            for lane in range(self.lanes.width):
                for s, axis in ti.static(NODE_AXES):
                    value = ti.cast(values[s, k, j, self.site_of(m, lane), axis], float)
                    self.displacement[s][axis][now, k, j, m][lane] = value

    @ti.kernel
    def get_displacement(self, now: int, values: ti.types.ndarray()):
        """Copy a buffer into (2, nz + 3, ny + 3, nx + 3, 3) values, m; ghosts are left."""
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in ti.static(self.sites)]):
            m, lane = self.column_of(i)
            for s, axis in ti.static(NODE_AXES):
                values[s, k, j, i, axis] = self.displacement[s][axis][now, k, j, m][lane]

    @ti.kernel
    def _set_velocity(self, values: ti.types.ndarray()):
        for k, j, m in ti.ndrange(*self.shape):
            for lane in range(self.lanes.width):
                for s, axis in ti.static(NODE_AXES):
                    value = ti.cast(values[s, k, j, self.site_of(m, lane), axis], float)
                    self.velocity[s][axis][k, j, m][lane] = value

    @ti.kernel
    def _get_velocity(self, values: ti.types.ndarray()):
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in ti.static(self.sites)]):
            m, lane = self.column_of(i)
            for s, axis in ti.static(NODE_AXES):
                values[s, k, j, i, axis] = self.velocity[s][axis][k, j, m][lane]

    def set_velocity(self, values: npt.NDArray[np.float64]) -> None:
        """Set all velocities from (2, nz + 3, ny + 3, nx + 3, 3) values, m/s; ghosts zero."""
        self._set_velocity(np.ascontiguousarray(values, dtype=np.float64))

    def get_velocity(
        self, values: npt.NDArray[np.float64] | None = None
    ) -> npt.NDArray[np.float64]:
        """(2, nz + 3, ny + 3, nx + 3, 3) velocities of all nodes, m/s, put into ``values``."""
        values = np.zeros((2, *self.sites, 3)) if values is None else values
        self._get_velocity(values)
        return values

    def get_acceleration(self, now: int) -> npt.NDArray[np.float64]:
        """(2, nz + 3, ny + 3, nx + 3, 3) M^-1 F of the bar forces at a buffer's displacement, m/s2.

        Evaluated by the step itself, from rest and for a second, so it is the run's own operator.
        The history takes note of the displacement; the other buffer is overwritten with it.
        """
        kept = self.get_velocity()
        self.set_velocity(np.zeros_like(kept))
        self.kick(now, 1.0)
        found = self.get_velocity()
        self.set_velocity(kept)
        return found

    def get_force(self, now: int) -> npt.NDArray[np.float64]:
        """(2, nz + 3, ny + 3, nx + 3, 3) sum of the bar forces at all nodes, N; see above."""
        return self.masses()[..., None] * self.get_acceleration(now)

    @ti.kernel
    def collect_broken(self, found: ti.types.ndarray(), count: ti.types.ndarray()):
        """Append bars broken since the last call, in any order, for ``new_broken``."""
        nz, ny, _ = ti.static(self.shape)
        for k, j, m in ti.ndrange(nz, ny, (HALO, HALO + self.lanes.length)):
            if self.touched[k, j, m] != 0:
                for lane in range(self.lanes.width):
                    self.collect_at(k, j, m, lane, found, count)

    @ti.func
    def collect_at(self, k, j, m, lane, found: ti.template(), count: ti.template()):
        """Append a site's bars broken since the last call."""
        recorded = int(self.recorded[k, j, m][lane])
        weight = self.stiffness[int(self.code[k, j, m][lane])]
        for bar in ti.static(range(BARS_PER_SITE)):
            failure = self.softening[ti.static(self.softening_row(bar))][0]
            broken = weight[ti.static(STIFFNESS_KIND[bar])] > 0
            broken &= self.peak[bar][k, j, m][lane] >= failure
            if broken and (recorded >> bar) & 1 == 0:
                place = ti.atomic_add(count[0], 1)
                if place < found.shape[0]:
                    found[place, 0], found[place, 1] = k, j
                    found[place, 2], found[place, 3] = self.site_of(m, lane), bar
                    recorded |= 1 << bar
        self.recorded[k, j, m][lane] = ti.cast(recorded, ti.u16)

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

    def recorded_bits(self) -> npt.NDArray[np.uint16]:
        """(nz + 3, ny + 3, nx + 3) one bit for each bar reported broken."""
        return self.lanes.gather(self.recorded.to_numpy())


def field_bytes(field: ti.Field) -> int:
    """Bytes that a dense field holds."""
    size = np.dtype(ti.lang.util.to_numpy_type(field.dtype)).itemsize
    return int(np.prod(field.shape)) * getattr(field, "n", 1) * size
