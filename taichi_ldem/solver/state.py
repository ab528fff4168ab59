"""The fields of a lattice in Taichi: allocation, filling with a material, saving and restoring.

Every field of sites has the shape S = (nz + 3, ny + 3, columns) and elements of one number a lane
(``lanes``). Where bars have a value each, their number comes first: (bars, *S). A name that has a
field for each sublattice or axis is a list of fields, as are the axial forces, whose addresses in a
list are constants of the step. The table in ``fields`` lists all of them.
"""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.model.cell import CENTRE
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.model.material import Bars
from taichi_ldem.scene.equations import QUARTER
from taichi_ldem.solver import backend
from taichi_ldem.solver.features import Features
from taichi_ldem.solver.fields import FIELDS, REAL, Layout, Row, rows
from taichi_ldem.solver.laws import law_named

EVOLVING = tuple(row.name for row in FIELDS if row.evolves and row.name != "displacement")
"""Fields that a checkpoint holds completely; of the displacement it holds one buffer."""

OF_BARS = tuple(row.name for row in FIELDS if row.evolves and row.of_bars)
"""Those of them that have a value for each bar."""

OF_TIPS = ("opening", "failed", "known", "near", "growth")
"""Fields of crack tips, which each step works out again from the peak strains."""


def field_apart(kind: Any, shape: tuple[int, ...] | int, numbers: int = 0) -> ti.Field:
    """A field whose numbers are not of Taichi's default width.

    On SPIR-V backends it gets a tree of its own, because in a tree with fields of other widths its
    words would overlap theirs. LLVM's backends align fields, and allow at most 512 trees in a
    process.

    Args:
        kind: type of the numbers.
        numbers: components of an element; 0 for a scalar.
    """
    vector = (
        (lambda **where: ti.Vector.field(numbers, kind, **where))
        if numbers
        else (lambda **where: ti.field(kind, **where))
    )
    if backend.configuration().arch in (ti.x64, ti.arm64, ti.cuda):
        return vector(shape=shape)
    field, sizes = vector(), (shape,) if isinstance(shape, int) else shape
    tree = ti.FieldsBuilder()
    tree.dense(getattr(ti, "ijkl"[: len(sizes)]), sizes).place(field)
    tree.finalize()
    return field


def field_bytes(field: ti.Field) -> int:
    """Bytes that a dense field holds."""
    size = np.dtype(backend.numpy_type(field.dtype)).itemsize
    return int(np.prod(field.shape)) * getattr(field, "n", 1) * size


def numpy_float() -> type[np.floating]:
    """NumPy's name for Taichi's default float."""
    return np.float64 if backend.default_float() == ti.f64 else np.float32


def _allocate(row: Row, layout: Layout) -> Any:
    """The field of a row, or nested lists of its fields."""
    shape = row.shape(layout)
    numbers = row.components(layout)

    def one() -> ti.Field:
        if row.kind != REAL:
            return field_apart(getattr(ti, row.kind), shape, numbers)
        if numbers:
            return ti.Vector.field(numbers, float, shape=shape)
        return ti.field(float, shape=shape)

    def nested(counts: tuple[int, ...]) -> Any:
        return [nested(counts[1:]) for _ in range(counts[0])] if counts else one()

    return nested(layout.members(row.members))


def _lane_bits(lanes: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint8]:
    """(...,) a bit for each of (..., width) lanes."""
    bits = np.uint8(1) << np.arange(lanes.shape[-1], dtype=np.uint8)
    return np.asarray((lanes * bits).sum(axis=-1, dtype=np.uint8))


@ti.data_oriented
class State:
    """All fields of a lattice.

    Attributes:
        lattice, features, layout: those that the fields were built for; cell: the lattice's.
        sites, lanes, shape, in_strips: those of the layout.
        on_cpu: whether Taichi runs on the CPU.
        law: the softening law; None without damage.
        peak_strain: eps_p of the bar families. volumetric: lambda - mu, Pa (``volume``).
        poisson_ratio: of the material.

    Each row of ``fields.FIELDS`` whose features the lattice has is an attribute, too.
    """

    displacement: list[list[ti.MatrixField]]
    velocity: list[list[ti.MatrixField]]
    axial: list[ti.MatrixField]
    swelling: list[list[ti.MatrixField]]
    volume_damage: ti.MatrixField
    volume_loss: ti.MatrixField
    face_loss: ti.MatrixField
    growth: ti.MatrixField
    volume_modulus: ti.MatrixField
    code: ti.MatrixField
    velocity_before: list[list[ti.MatrixField]]
    node_sums: ti.MatrixField
    stiffness: ti.MatrixField
    mass: ti.MatrixField
    inverse_mass: ti.MatrixField
    touched: ti.ScalarField
    peak: ti.MatrixField
    recorded: ti.MatrixField
    opening: list[ti.ScalarField]
    failed: list[ti.ScalarField]
    known: ti.MatrixField
    near: ti.ScalarField
    toughness: ti.ScalarField
    resistance: ti.MatrixField
    viscosity: ti.ScalarField
    softening: ti.MatrixField
    ends: ti.MatrixField
    kinds: ti.MatrixField
    vector: ti.MatrixField
    lengths: ti.MatrixField
    removed: ti.MatrixField
    damped: list[ti.MatrixField]
    strength: ti.MatrixField
    weakest: ti.ScalarField
    modulus: ti.MatrixField
    own_mass: list[ti.MatrixField]
    own_inverse_mass: list[ti.MatrixField]
    offset: list[list[ti.MatrixField]]
    gravity: ti.MatrixField

    def __init__(
        self,
        lattice: Lattice,
        features: Features,
        in_strips: bool | None = None,
        alone: bool = False,
    ):
        """As ``Dynamics``."""
        self.lattice, self.features, self.cell = lattice, features, lattice.cell
        config = backend.configuration()
        self.on_cpu = config.arch in (ti.x64, ti.arm64)
        self.layout = Layout.fitting(
            lattice.sites,
            np.dtype(numpy_float()).itemsize,
            self.on_cpu if in_strips is None else in_strips,
            config.cpu_max_num_threads,
            lattice.cell,
            alone,
        )
        self.sites, self.lanes, self.shape = self.layout.sites, self.layout.lanes, self.layout.shape
        self.in_strips = self.layout.in_strips
        self.law: Any = None if features.law is None else law_named(features.law)
        self.peak_strain, self.volumetric, self.poisson_ratio = np.inf, 0.0, QUARTER
        for row in rows(features, self.layout):
            setattr(self, row.name, _allocate(row, self.layout))
        self._fill_tables()
        self.set_lattice(lattice)

    def _fill_tables(self) -> None:
        """Fill the tables by number of a bar, for functions that learn it in the run only."""
        cell = self.cell
        ends = [[(s, *offset) for s, offset in both] for both in cell.ends]
        self.ends.from_numpy(np.array(ends, dtype=np.int32))
        kinds = np.array([cell.family, cell.stiffness_kind], dtype=np.int32)
        self.kinds.from_numpy(np.ascontiguousarray(kinds.T))
        self.vector.from_numpy(np.array(cell.vectors, dtype=numpy_float()))
        lengths = [(square**0.5, square, 1 / square) for square in cell.length_squared]
        self.lengths.from_numpy(np.array(lengths, dtype=numpy_float()))

    def fields(self) -> dict[str, list[ti.Field]]:
        """All fields by name; several where a name has a list of them."""
        return {
            row.name: list(np.array(getattr(self, row.name), dtype=object).ravel())
            for row in rows(self.features, self.layout)
        }

    @property
    def spacing(self) -> float:
        """Module edge as kernels have it, rounded to Taichi's float, m.

        Bodies in contact with the lattice must start from it: a ring at the exact height of a plate
        whose nodes are higher by rounding in f32 would push them in the first step.
        """
        return float(numpy_float()(self.lattice.spacing))

    numpy_float = staticmethod(numpy_float)

    # -- material ----------------------------------------------------------------------------------

    def _fill(self, field: ti.Field, values: npt.NDArray[np.float64]) -> None:
        """Fill a field of sites from values in the shape of the sites."""
        field.from_numpy(self.lanes.spread(values).astype(numpy_float()))

    def _fill_bars(self, field: ti.MatrixField, values: npt.NDArray[np.float64]) -> None:
        """Fill a field of bars from (nz + 3, ny + 3, nx + 3, bars) values."""
        self._fill(field, np.moveaxis(values, -1, 0))

    def set_lattice(self, lattice: Lattice) -> None:
        """Take another body that was cut from a prism of the same modules."""
        self.lattice = lattice
        self.code.from_numpy(self.lanes.spread(lattice.code))
        if self.features.volumetric:
            self._fill(self.volume_modulus, (lattice.code >> 7).astype(np.float64))
        if self.features.perturbed:
            assert lattice.offsets is not None
            for s, axis in self.cell.node_axes:
                self._fill(self.offset[s][axis], lattice.offsets[s, ..., axis] / lattice.spacing)

    def set_bars(self, bars: Bars) -> None:
        """Fill the tables of stiffness EA/L per site byte (N/m) and of the law's parameters."""
        weights = self.cell.weights(self.lattice.surface_weights)
        stiff = np.zeros((256, self.cell.stiffness_kinds))
        for bar, kind in enumerate(self.cell.stiffness_kind):
            family = bars[self.cell.family[bar]]
            stiff[:, kind] = weights[:, bar] * (family.axial_stiffness / family.length)
        self.stiffness.from_numpy(stiff.astype(numpy_float()))
        self.peak_strain = bars[0].peak_strain
        if self.law is not None:
            table = [self.law.parameters(family.ductility) for family in bars]
            self.softening.from_numpy(np.array(table, dtype=numpy_float()))
        if self.features.crack:
            costs = [family.toughness for family in bars]
            self.toughness.from_numpy(np.array(costs, dtype=numpy_float()))
        if self.features.viscous:
            times = [family.viscosity for family in bars]
            self.viscosity.from_numpy(np.array(times, dtype=numpy_float()))

    def set_density(self, density: float) -> None:
        """Fill the tables of node masses per site byte, kg, from a density in kg/m3."""
        mass = self.cell.node_shares * density * self.lattice.spacing**3
        inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0)
        self.mass.from_numpy(mass.astype(numpy_float()))
        self.inverse_mass.from_numpy(inverse.astype(numpy_float()))

    def set_strength(self, strength: npt.NDArray[np.float64]) -> None:
        """Give every bar its eps_p over its family's: (nz + 3, ny + 3, nx + 3, bars)."""
        exists = self.lattice.bar_exists()
        self._fill_bars(self.strength, strength)
        stored = self.lanes.spread(np.moveaxis(np.where(exists, strength, np.inf), -1, 0))
        weakest = stored.min(axis=(0, -1))
        weakest[np.isinf(weakest)] = 1.0
        # slightly below, as the test compares forces and the history compares strains
        self.weakest.from_numpy((weakest * (1 - 1e-6)).astype(numpy_float()))

    def set_modulus(self, modulus: npt.NDArray[np.float64]) -> None:
        """Give every bar its modulus over the mean: (nz + 3, ny + 3, nx + 3, bars).

        A module's volume takes the mean of its bars.
        """
        self._fill_bars(self.modulus, modulus)
        if self.features.volumetric:
            around = [
                np.roll(modulus[..., bar], [-n for n in offset], axis=(0, 1, 2))
                for bar, offset in self.cell.of_module
            ]
            self._fill(self.volume_modulus, np.mean(around, axis=0) * (self.lattice.code >> 7))

    def set_own_density(self, density: float, factor: npt.NDArray[np.float64]) -> None:
        """Give every node the masses of the modules around it.

        Args:
            density: mean, kg/m3.
            factor: (nz, ny, nx) each module's density over it.
        """
        module = density * self.lattice.spacing**3 * np.where(self.lattice.mask, factor, 0.0)
        nz, ny, nx = module.shape
        mass = np.zeros((self.cell.sublattices, *self.sites))
        mass[CENTRE:, 1 : 1 + nz, 1 : 1 + ny, 1 : 1 + nx] = module / 2
        # the corners of a module with a centre node share half of its mass
        corner = module / (8 * self.cell.sublattices)
        for dz, dy, dx in np.ndindex(2, 2, 2):
            mass[0, 1 + dz : 1 + dz + nz, 1 + dy : 1 + dy + ny, 1 + dx : 1 + dx + nx] += corner
        inverse = np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0)
        for fields, values in ((self.own_mass, mass), (self.own_inverse_mass, inverse)):
            for field, part in zip(fields, values, strict=True):
                self._fill(field, part)

    def of_modules(self, field: ti.MatrixField) -> npt.NDArray[np.float64]:
        """(modules,) values of a field that has one at the site of each module."""
        nz, ny, nx = self.lattice.mask.shape
        values = self.lanes.gather(field.to_numpy())[1 : 1 + nz, 1 : 1 + ny, 1 : 1 + nx]
        return np.asarray(values[self.lattice.mask], dtype=np.float64)

    def set_gravity(self, gravity: Sequence[float]) -> None:
        """Set the acceleration by gravity, (3,) m/s2."""
        self.gravity.from_numpy(np.array([gravity], dtype=numpy_float()))

    @contextlib.contextmanager
    def weightless(self) -> Iterator[None]:
        """Without gravity: a step is then the operator of the bars alone."""
        if not self.features.gravity:
            yield
            return
        kept = self.gravity.to_numpy()
        self.gravity.fill(0)
        try:
            yield
        finally:
            self.gravity.from_numpy(kept)

    def masses(self) -> npt.NDArray[np.float64]:
        """(sublattices, *S) masses of all nodes, kg; 0 where there is none."""
        if self.features.density:
            own = [self.lanes.gather(field.to_numpy()) for field in self.own_mass]
            return np.stack(own).astype(np.float64)
        return np.moveaxis(self.mass.to_numpy()[self.lattice.code], -1, 0).astype(np.float64)

    # -- history -----------------------------------------------------------------------------------

    def set_removed(self, removed: npt.NDArray[np.uint16]) -> None:
        """Remove bars, one bit each: (nz + 3, ny + 3, nx + 3)."""
        stored = self.lanes.spread(removed)
        self.removed.from_numpy(stored)
        self.touched.from_numpy(_lane_bits(stored != 0))

    def remove(self, bars: npt.NDArray[np.uint16]) -> None:
        """Remove bars in addition to those that are removed already, one bit each."""
        stored = self.removed.to_numpy() | self.lanes.spread(bars)
        self.removed.from_numpy(stored)
        self.touched.from_numpy(_lane_bits(stored != 0) | self.touched.to_numpy())

    def failed_bits(self) -> npt.NDArray[np.uint16]:
        """A bit for each bar that has failed, reported or not: (nz + 3, ny + 3, nx + 3)."""
        failed = np.zeros(self.sites, dtype=np.uint16)
        if self.features.damage:
            limits = self.softening.to_numpy()[:, 0]
            for bar, peak in enumerate(self.lanes.gather(self.peak.to_numpy())):
                gone = (peak >= limits[self.cell.family[bar]]) | (peak < 0)
                failed |= gone.astype(np.uint16) << bar
        return failed

    def set_peak(self, peak: npt.NDArray[np.float64]) -> None:
        """Age bars to peak strains over their eps_p: (nz + 3, ny + 3, nx + 3, bars)."""
        stored = self.lanes.spread(np.moveaxis(peak, -1, 0))
        self.peak.from_numpy(stored.astype(numpy_float()))
        self._touch(stored)

    def _touch(self, peak: npt.NDArray) -> None:
        """Mark the lanes with a bar beyond its eps_p, from (bars, *S, width) peaks over it."""
        self.touched.from_numpy(
            _lane_bits(np.any((peak > 1) | (peak < 0), axis=0)) | self.touched.to_numpy()
        )

    def clear_history(self) -> None:
        """Put the lattice at rest with whole bars, as before the first step; notches stay cut."""
        fields = self.fields()
        for name in ("displacement", *EVOLVING, "touched", *OF_TIPS):
            for field in fields.get(name, []):
                field.fill(0)
        if self.features.notch:
            self.touched.from_numpy(_lane_bits(self.removed.to_numpy() != 0))

    def saved_state(self, now: int) -> dict[str, npt.NDArray]:
        """Copies of the state from which the next step starts: (fields or bars, *sites).

        The arrays are those of the lattice and not of its lanes, which depend on the machine.

        Args:
            now: buffer of the displacement.
        """
        fields = self.fields()
        saved = {}
        for name in EVOLVING:
            if name in fields:
                parts = [self.lanes.gather(field.to_numpy()) for field in fields[name]]
                saved[name] = parts[0] if name in OF_BARS else np.stack(parts)
        displacement = [
            self.lanes.gather(field.to_numpy()[now]) for field in fields["displacement"]
        ]
        return saved | {"displacement": np.stack(displacement)}

    def restore_state(self, saved: Mapping[str, npt.NDArray]) -> None:
        """Continue from ``saved_state``, with the displacement in both buffers."""
        both = {"displacement": np.stack([saved["displacement"]] * 2, axis=1)}
        fields = self.fields()
        for name, values in {**saved, **both}.items():
            parts = [values] if name in OF_BARS else values
            for field, part in zip(fields[name], parts, strict=True):
                field.from_numpy(self.lanes.spread(part))
        for name in OF_TIPS:
            for field in fields.get(name, []):
                field.fill(0)
        if self.features.damage:
            self._touch(self.lanes.spread(saved["peak"]))

    # -- in kernels --------------------------------------------------------------------------------

    @ti.func
    def node_vector(self, fields: ti.template(), s, place, lane):
        """Vector of a node, from a name's fields by sublattice and axis.

        Args:
            s: its sublattice, not known when the kernel is compiled.
            place: index of the fields: (k, j, m), after the buffer where there are two.
        """
        value = ti.Vector.zero(float, 3)
        for sublattice in ti.static(range(self.cell.sublattices)):
            if s == sublattice:
                for axis in ti.static(range(3)):
                    value[axis] = fields[sublattice][axis][place][lane]
        return value

    @ti.func
    def lane_entries(self, table: ti.template(), code, entry: ti.template()):
        """A table's entry for the byte of each lane."""
        return ti.Vector([table[int(code[n])][entry] for n in ti.static(range(self.lanes.width))])

    @ti.func
    def lane_masses(self, s: ti.template(), k, j, m):
        """Masses of a column's corner or centre nodes, kg."""
        mass = self.lane_entries(self.mass, self.code[k, j, m], s)
        if ti.static(self.features.density):
            mass = self.own_mass[s][k, j, m]
        return mass

    @ti.func
    def lane_inverse_masses(self, s: ti.template(), k, j, m):
        """Inverse masses of a column's corner or centre nodes, 1/kg."""
        inverse = self.lane_entries(self.inverse_mass, self.code[k, j, m], s)
        if ti.static(self.features.density):
            inverse = self.own_inverse_mass[s][k, j, m]
        return inverse
