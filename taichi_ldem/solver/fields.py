"""The state of the lattice: the table of its fields and their layout, free of Taichi.

A field is present where its features are (``features``). Everything else that depends on which
fields there are follows from the two tables: allocation and checkpoints (``state``), the bytes that
a scene needs (``memory``), and the report of what a scene leaves out (``scenarios.leave_out``). A
new field is a row of ``FIELDS``.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from taichi_ldem.model.cell import CELLS, MODULE, UnitCell
from taichi_ldem.scene import Scene
from taichi_ldem.solver.features import Features
from taichi_ldem.solver.lanes import Lanes

# -- layout ----------------------------------------------------------------------------------------

RING = 4
"""Rows of bar scalars that a strip keeps: the three that a row of nodes gathers from, and a spare
one that makes the place of a row a bit mask."""

STRIPS_PER_THREAD = 2
ROWS_PER_STRIP = 4
"""Fewest rows of a strip, two of which lie at its borders."""

PIECE = 16
"""Columns of a row that one thread of a GPU sums up."""

MOST_ALONE = 8000
"""Most modules of a plate whose step one thread takes, where a scene gives no number of threads."""


def suits_one_thread(scene: Scene) -> bool:
    """Whether one thread takes the step of a scene: it is asked for, or the plate is small.

    Pieces that touch are listed and pressed by all threads.
    """
    contact = scene.contact
    if scene.solver.arch != "cpu" or (contact is not None and contact.fragments):
        return False
    small = math.prod(scene.plate.modules) <= MOST_ALONE
    return scene.solver.threads == 1 or (scene.solver.threads is None and small)


@dataclass(frozen=True)
class Layout:
    """How the sites of a lattice lie in memory and how the step divides them among threads.

    Attributes:
        sites: (nz + 3, ny + 3, nx + 3), ghosts included.
        real_bytes: of one floating-point number.
        in_strips: whether each thread takes a strip of rows through both passes (CPU); otherwise
            each pass is a launch over all columns (GPU).
        strips: number of strips; 1 where the step is not driven in strips.
        lanes: how a row is cut into columns of several sites.
        cell: the bars of a site.
        alone: whether one thread takes the step, all of it in one strip, with the contact.
    """

    sites: tuple[int, int, int]
    real_bytes: int
    in_strips: bool
    strips: int
    lanes: Lanes
    cell: UnitCell = MODULE
    alone: bool = False

    @classmethod
    def fitting(
        cls,
        sites: tuple[int, int, int],
        real_bytes: int,
        in_strips: bool,
        threads: int,
        cell: UnitCell = MODULE,
        alone: bool = False,
    ) -> "Layout":
        """The layout that suits so many threads; ``alone``: that one of them takes the step."""
        _, ny, nx = sites
        if not in_strips:
            return cls(sites, real_bytes, False, 1, Lanes(nx), cell)
        strips = max(1, min(STRIPS_PER_THREAD * threads, (ny - 2) // ROWS_PER_STRIP))
        strips, lanes = 1 if alone else strips, Lanes.fitting(nx, real_bytes)
        return cls(sites, real_bytes, True, strips, lanes, cell, alone)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of a field of columns: (nz + 3, ny + 3, columns)."""
        return *self.sites[:2], self.lanes.columns

    def members(self, name: str) -> tuple[int, ...]:
        """Numbers of fields of a name: one, or one for each bar, sublattice, or axis of each."""
        nodes = self.cell.sublattices
        counts = {"": (), "bar": (self.cell.bars,), "tensor": (3, 3)}
        return (counts | {"node": (nodes,), "node axis": (nodes, 3)})[name]

    @property
    def bar_rows(self) -> int:
        """Rows of bar scalars: a ring for each strip, one of zeros, two for each border, or all."""
        if not self.in_strips:
            return self.sites[1]
        return RING * self.strips + 1 + 2 * (self.strips - 1)

    @property
    def piece(self) -> int:
        """Columns whose energies one thread sums up: a row, or a part of it on a GPU."""
        return self.lanes.length if self.in_strips else PIECE

    @property
    def pieces(self) -> int:
        """Pieces of a row."""
        return -(-self.lanes.length // self.piece)


LONG = 8e10
"""Bars times steps of a run from which on a faster step pays for a longer compilation: ten minutes
or more on two cores."""


def is_long(scene: Scene) -> bool:
    """Whether a run takes so many steps of so many bars that kernels are compiled with all care."""
    plate, solver = scene.plate, scene.solver
    speed = math.sqrt(scene.material.youngs_modulus / scene.material.density)
    step = solver.time_step
    if step == "auto":
        step = solver.safety * plate.spacing / speed / 2  # about: the critical one is not known yet
    bars = CELLS[plate.lattice].bars * math.prod(plate.modules)
    return bars * solver.duration / float(step) > LONG


# -- fields ----------------------------------------------------------------------------------------

REAL = "real"
LANES = -1
"""In place of a number of components: one for each lane."""

NODES, KINDS = -2, -3
"""In place of a number of components: one for each sublattice, or each kind of stiffness."""

BYTES = {"u8": 1, "u16": 2, "i32": 4, "f64": 8}


@dataclass(frozen=True)
class Row:
    """One name of the state.

    Attributes:
        name: attribute of ``State``; the name in checkpoints where the field evolves.
        meaning: meaning of its values.
        unit: of its values; "" for bits and ratios.
        shape: of each of its fields, for a layout.
        members: what it has a field for each of (``Layout.members``).
        kind: type of its numbers: REAL (Taichi's default float), "u8", "u16" or "f64".
        numbers: components of an element: LANES, NODES, KINDS, a number, or 0 for a scalar.
        present: whether the lattice has it.
        evolves: whether it carries the state from one step to the next, so that a checkpoint must
            hold it.
    """

    name: str
    meaning: str
    unit: str
    shape: Callable[[Layout], tuple[int, ...]]
    members: str = ""
    kind: str = REAL
    numbers: int = LANES
    present: Callable[[Features, Layout], bool] = lambda *_: True
    evolves: bool = False

    @property
    def of_sites(self) -> bool:
        """Whether it has a value for every column of the lattice."""
        return self.shape in (_columns, _bar_columns, _sites, _buffers)

    @property
    def of_bars(self) -> bool:
        """Whether it has a value for every bar of every column."""
        return self.shape is _bar_columns

    def bytes(self, layout: Layout) -> int:
        """Bytes of all its fields."""
        numbers = max(1, self.components(layout))
        size = layout.real_bytes if self.kind == REAL else BYTES[self.kind]
        return math.prod((*layout.members(self.members), *self.shape(layout), numbers, size))

    def components(self, layout: Layout) -> int:
        """Numbers of an element; 0 for a scalar."""
        of_layout = {
            LANES: layout.lanes.width,
            NODES: layout.cell.sublattices,
            KINDS: layout.cell.stiffness_kinds,
        }
        return of_layout.get(self.numbers, self.numbers)


def _columns(layout: Layout) -> tuple[int, ...]:
    return layout.shape


def _sites(layout: Layout) -> tuple[int, ...]:
    return layout.sites


def _buffers(layout: Layout) -> tuple[int, ...]:
    return 2, *layout.shape


def _bar_columns(layout: Layout) -> tuple[int, ...]:
    return layout.cell.bars, *layout.shape


def _bar_rows(layout: Layout) -> tuple[int, ...]:
    nz, _, columns = layout.shape
    return layout.bar_rows, nz, columns


def _strip_rows(layout: Layout) -> tuple[int, ...]:
    nz, _, columns = layout.shape
    return layout.strips, nz, columns


def _node_sums(layout: Layout) -> tuple[int, ...]:
    nz, ny, _ = layout.sites
    return (ny,) if layout.in_strips else (ny * nz * layout.pieces,)


def _codes(_: Layout) -> tuple[int, ...]:
    return (256,)


def _one(_: Layout) -> tuple[int, ...]:
    return (1,)


def _families(layout: Layout) -> tuple[int, ...]:
    return (layout.cell.families,)


def _bars(layout: Layout) -> tuple[int, ...]:
    return (layout.cell.bars,)


def _bar_ends(layout: Layout) -> tuple[int, ...]:
    return layout.cell.bars, 2


def _damage(features: Features, _: Layout) -> bool:
    return features.damage


def _history(features: Features, _: Layout) -> bool:
    return features.history


def _named(name: str) -> Callable[[Features, Layout], bool]:
    return lambda features, _: bool(getattr(features, name))


def _in_strips(_: Features, layout: Layout) -> bool:
    return layout.in_strips


FIELDS = (
    Row("displacement", "displacement of nodes, in two buffers", "m", _buffers, "node axis",
        evolves=True),
    Row("velocity", "velocity of nodes, half a step behind", "m/s", _columns, "node axis",
        evolves=True),
    Row("axial", "axial force of a bar over its current length", "N/m", _bar_rows, "bar"),
    Row("swelling", "force of a module's volume on a corner towards + + +, by axis of the force and"
        " of the corner's place", "N", _bar_rows, "tensor", present=_named("volumetric")),
    Row("volume_damage", "1 less the share of its volumetric energy that a module still has in"
        " tension", "", _columns, present=_named("weakening"), evolves=True),
    Row("volume_loss", "volumetric energy that a module has lost by fracture", "J", _columns,
        present=_named("weakening"), evolves=True),
    Row("growth", "J - 1 of a module times the share of its volumetric energy, at the last step",
        "", _columns, present=lambda f, _: f.volumetric and f.crack),
    Row("volume_modulus", "lambda - mu of a module over the mean; 0 where there is no module", "",
        _columns, present=_named("volumetric")),
    Row("code", "byte of the site (see lattice)", "", _columns, kind="u8"),
    Row("velocity_before", "velocities of the row that a measured step updates, as they were before"
        " it", "m/s", _strip_rows, "node axis", present=_in_strips),
    Row("node_sums", "kinetic energy at t_n and energy lost by damping, of the last measured step; "
        "a sum for each row j, or on a GPU for each piece of a row (j, k)", "J", _node_sums,
        kind="f64", numbers=2),
    Row("stiffness", "EA/L0 by site byte and kind of bar", "N/m", _codes,
        numbers=KINDS),
    Row("mass", "mass by site byte and sublattice", "kg", _codes, numbers=NODES),
    Row("inverse_mass", "1/mass by site byte and sublattice", "1/kg", _codes,
        numbers=NODES),
    Row("touched", "a bit for each lane where a bar has passed its eps_p or was removed: only there"
        " is a bar more than elastic", "", _columns, kind="u8", numbers=0, present=_history),
    Row("peak", "largest strain of a bar so far over its eps_p", "", _bar_columns,
        present=_damage, evolves=True),
    Row("face_loss", "energy that failed bars of a site have lost as crack faces met and parted",
        "J", _columns, present=_named("meeting"), evolves=True),
    Row("recorded", "a bit for each bar that was reported broken", "", _columns, kind="u16",
        present=_damage, evolves=True),
    Row("opening", "largest elongation of the failed bars at a node, at the last step", "m", _sites,
        "node", numbers=0, present=_named("crack")),
    Row("failed", "number of failed bars at a node, at the last step", "", _sites, "node",
        kind="i32", numbers=0, present=_named("crack")),
    Row("known", "a bit for each bar that had failed or was removed before this step", "",
        _columns, kind="u16", present=_named("crack")),
    Row("near", "1 where a bar of the column shares a node with a failed one", "", _columns,
        kind="u8", numbers=0, present=_named("crack")),
    Row("toughness", "G_f A^f over EA L0 by bar family", "", _families, numbers=0,
        present=_named("crack")),
    Row("resistance", "strain at which a bar would pull as much as the opening of a crack meets"
        " resistance, at the last step", "", _bar_columns, present=_named("viscous"),
        evolves=True),
    Row("viscosity", "rho c_P A^f L0 over EA by bar family", "s", _families, numbers=0,
        present=_named("viscous")),
    Row("softening", "parameters of the law by bar family", "", _families, numbers=2,
        present=_damage),
    Row("ends", "sublattice and offset (dz, dy, dx) of the site of both ends of a bar", "",
        _bar_ends, kind="i32", numbers=4),
    Row("kinds", "family of a bar, and kind of its stiffness", "", _bars, kind="i32", numbers=2),
    Row("vector", "vector between the ends of a bar in the regular lattice, in module edges", "",
        _bars, numbers=3),
    Row("lengths", "length of a bar in the regular lattice in module edges, its square, and 1 over"
        " that", "", _bars, numbers=3),
    Row("removed", "a bit for each bar that a notch removes", "", _columns, kind="u16",
        present=_named("notch")),
    Row("damped", "energy that a node has lost by damping", "J", _columns, "node",
        present=_named("damping"), evolves=True),
    Row("strength", "eps_p of a bar over its family's", "", _bar_columns,
        present=_named("strength")),
    Row("weakest", "least strength in a column: a cheap test that spares most lanes a look at every"
        " bar's", "", _columns, numbers=0, present=_named("strength")),
    Row("modulus", "Young's modulus of a bar over the mean", "", _bar_columns,
        present=_named("modulus")),
    Row("own_mass", "mass of a node", "kg", _columns, "node", present=_named("density")),
    Row("own_inverse_mass", "1/mass of a node", "1/kg", _columns, "node",
        present=_named("density")),
    Row("offset", "distance of a node from its place in the regular lattice, in module edges", "",
        _columns, "node axis", present=_named("perturbed")),
    Row("gravity", "acceleration by gravity", "m/s2", _one, numbers=3, present=_named("gravity")),
)  # fmt: skip
"""Every field of the lattice, in the order of allocation.

The fields that evolve are the state from which a step starts. Bar forces and the other buffer of
displacements are overwritten in every step, and ``touched`` follows from the peak strains.
"""


def rows(features: Features, layout: Layout) -> list[Row]:
    """The rows of FIELDS that a lattice has."""
    return [row for row in FIELDS if row.present(features, layout)]
