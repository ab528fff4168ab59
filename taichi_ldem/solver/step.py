"""Drivers of the step: both passes over all columns, in strips of rows (CPU) or in launches (GPU).

On the CPU a thread takes a strip of rows and alternates between the passes row by row, so that the
bar scalars never leave its cache. The two rows of bars at a border of strips serve the nodes on
both sides of it. They are evaluated first, before any node has moved. On a GPU each pass is a
launch over all columns.

A small plate is done sooner than threads are woken. One thread then takes many steps in one launch,
each with its contact (``Layout.alone``).

The drivers depend on columns, rows and the numbers of a step, but neither on bars nor on nodes.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import taichi as ti

from taichi_ldem.solver.bar_forces import BarForces
from taichi_ldem.solver.fields import RING
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.nodes import NodeUpdate
from taichi_ldem.solver.state import State
from taichi_ldem.solver.tips import CrackTips

TURNS = 512
"""Least number of iterations of a parallel loop that Taichi gives to a CPU thread."""

Part = tuple[Callable[..., None], Callable[..., None] | None, int]
"""A part of the pass before pass 1: the function for a column, that for the columns of a row where
there is a faster one, and the first column of a row.
"""

StepNumbers = ti.types.struct(
    spacing=ti.f64,
    kick=ti.f64,
    drift=ti.f64,
    damping=ti.f64,
    peak_strain=ti.f64,
    volumetric=ti.f64,
    poisson_ratio=ti.f64,
)
"""Numbers of a step: module edge, m; the times by which velocities and displacements change, s; the
damping coefficient, 1/s; eps_p of the bar families; lambda - mu, Pa; Poisson's ratio. Kernels round
them to Taichi's default float.
"""


@ti.data_oriented
class Step:
    """The two passes, driven as the layout of the lattice asks for.

    Attributes:
        contact: function of Taichi that corrects the nodes after the passes of a step, from the
            buffer and the ``StepNumbers``; only the steps of ``take_alone`` call it. It has to be
            set before the first step, which compiles it.
    """

    def __init__(self, state: State, bars: BarForces, nodes: NodeUpdate, tips: CrackTips):
        self.state, self.bars, self.nodes, self.tips = state, bars, nodes, tips
        self.volumes = nodes.volumes
        self.contact: Any = None
        self._numbers: dict[tuple[float, ...], ti.Struct] = {}

    def numbers(self, kick: float, drift: float, damping: float) -> ti.Struct:
        """The ``StepNumbers`` of a step; reused, as creating one takes as long as a small step."""
        state = self.state
        material = (state.peak_strain, state.volumetric, state.poisson_ratio)
        key = (state.lattice.spacing, kick, drift, damping, *material)
        if key not in self._numbers:
            if len(self._numbers) > 16:
                self._numbers.clear()
            self._numbers[key] = StepNumbers(*key)
        return self._numbers[key]

    @ti.func
    def rounded(self, now, numbers):
        """The struct ``step`` of the passes: a buffer and the numbers in Taichi's float."""
        return ti.Struct(
            now=now,
            spacing=ti.cast(numbers.spacing, float),
            kick=ti.cast(numbers.kick, float),
            drift=ti.cast(numbers.drift, float),
            damping=ti.cast(numbers.damping, float),
            peak_strain=ti.cast(numbers.peak_strain, float),
            volumetric=ti.cast(numbers.volumetric, float),
            poisson_ratio=ti.cast(numbers.poisson_ratio, float),
        )

    @ti.func
    def forces(self, at: ti.template(), step: ti.template()):
        """Pass 1 for a column: the forces of its bars, and of its modules' volumes."""
        self.bars.column_forces(at, step)
        if ti.static(self.state.features.volumetric):
            self.volumes.column_forces(at, step)

    @cached_property
    def first(self) -> tuple[Part, ...]:
        """Parts of the pass before pass 1, each after all of the one before it.

        Nodes gather from the modules of the column before their own, too.
        """
        volumes, tips = self.volumes, self.tips
        parts = ((volumes.weaken, volumes.weaken_row, HALO - 1),)
        chosen: tuple[Part, ...] = parts if self.state.features.weakening else ()
        if self.state.features.crack:
            opening = ((tips.open, None, HALO), (tips.fail, None, HALO))
            chosen = ((tips.forget, None, HALO), *chosen, *opening)
        return chosen

    # -- in strips ---------------------------------------------------------------------------------

    @ti.func
    def first_row(self, strip):
        """The first row of sites of a strip; that of the strip after the last is a ghost row."""
        inner, strips = ti.static(self.state.sites[1] - 2, self.state.layout.strips)
        return 1 + inner * strip // strips

    @ti.func
    def bar_row(self, strip, j):
        """Row of the bar scalars for the sites at j, as a strip finds them.

        The scalars of ghost rows are always zero. Those beside a border belong to both strips.
        """
        strips, ghost = ti.static(self.state.layout.strips, self.state.sites[1] - 1)
        zeros = ti.static(RING * strips)
        row = RING * strip + j % RING
        if j == 0 or j == ghost:
            row = zeros
        if ti.static(strips > 1):
            begin, end = self.first_row(strip), self.first_row(strip + 1)
            if 0 < j <= begin and strip > 0:
                row = zeros + 2 * strip + j - begin
            elif end - 1 <= j < ghost and strip < strips - 1:
                row = zeros + 2 * (strip + 1) + j - end
        return row

    @ti.func
    def force_row(self, row, j, step: ti.template()):
        """Pass 1 for a row of sites."""
        for k in range(1, self.state.sites[0] - 1):
            for m in range(HALO - 1, HALO + self.state.lanes.length + 1):
                self.forces(ti.Struct(row=row, k=k, j=j, m=m), step)

    @ti.func
    def node_row(self, strip, j, step: ti.template(), measure):
        """Pass 2 for a row; ``measure`` is tested once a row and needs no kernel of its own."""
        if measure != 0:
            for k in range(1, self.state.sites[0] - 1):
                for m in range(HALO, HALO + self.state.lanes.length):
                    self.nodes.store_velocities(strip, k, j, m)
        rows = ti.Vector([self.bar_row(strip, j + offset) for offset in ti.static((-1, 0, 1))])
        for k in range(1, self.state.sites[0] - 1):
            for m in range(HALO, HALO + self.state.lanes.length):
                at = ti.Struct(strip=strip, k=k, j=j, m=m)
                self.nodes.update_column(rows, at, step, False)
        if measure != 0:
            sums = ti.Vector.zero(ti.f64, 2)
            for k in range(1, self.state.sites[0] - 1):
                for m in range(HALO, HALO + self.state.lanes.length):
                    at = ti.Struct(strip=strip, k=k, j=j, m=m)
                    sums += self.nodes.column_energies(at, step)
            self.state.node_sums[j] = sums

    @ti.func
    def strip_step(self, strip, step: ti.template(), measure, borders):
        """Both passes for a strip of rows, a row of bars ahead of the nodes.

        Args:
            borders: not 0: pass 1 alone, for the two rows at the strip's first border.
        """
        zeros = ti.static(RING * self.state.layout.strips)
        begin, last = self.first_row(strip), self.first_row(strip + 1)
        if borders != 0:
            last = begin
        for j in range(begin - 1, last + 1):
            row = self.bar_row(strip, j)
            if (borders == 0 and row < zeros) or (borders != 0 and row > zeros):
                self.force_row(row, j, step)
            if borders == 0 and j > begin:
                self.node_row(strip, j - 1, step, measure)

    @ti.kernel
    def _in_strips(self, now: int, numbers: StepNumbers, measure: int, borders: int):
        for turn in range(self.state.layout.strips * TURNS):
            if turn % TURNS == 0:
                step = self.rounded(now, numbers)
                self.strip_step(turn // TURNS, step, measure, borders)

    @ti.func
    def part_in_strip(self, part: ti.template(), strip, step: ti.template()):
        """A part of the pass before pass 1 for the rows that a strip owns."""
        column, row, begin = ti.static(part)
        for j in range(self.first_row(strip), self.first_row(strip + 1)):
            for k in range(1, self.state.sites[0] - 1):
                end = ti.static(HALO + self.state.lanes.length)
                if ti.static(row):
                    row(k, j, begin, end, step)
                else:
                    for m in range(begin, end):
                        column(ti.Struct(k=k, j=j, m=m), step)

    @ti.kernel
    def _first(self, now: int, numbers: StepNumbers):
        for part in ti.static(self.first):
            for turn in range(self.state.layout.strips * TURNS):
                if turn % TURNS == 0:
                    step = self.rounded(now, numbers)
                    self.part_in_strip(part, turn // TURNS, step)

    # -- on one thread -----------------------------------------------------------------------------

    def touches(self) -> bool:
        """Whether the steps of one thread have contact."""
        return self.contact is not None

    @ti.kernel
    def _alone(self, now: int, numbers: StepNumbers, steps: int, measure: int, resolve: int):
        ti.loop_config(serialize=True)
        for _ in range(1):
            for n in range(steps):
                step = self.rounded((now + n) % 2, numbers)
                for part in ti.static(self.first):
                    self.part_in_strip(part, 0, step)
                self.strip_step(0, step, measure, 0)
                if ti.static(self.touches()):
                    if resolve != 0:
                        self.contact(step.now, numbers)

    def take_alone(
        self, now: int, time_step: float, damping: float, steps: int, measure: bool
    ) -> None:
        """Take steps with their contact, all in one launch.

        Args:
            measure: as in ``take``.
        """
        self._alone(now, self.numbers(time_step, time_step, damping), steps, measure, 1)

    # -- in passes ---------------------------------------------------------------------------------

    @ti.func
    def piece_end(self, piece):
        """Column after the last of a piece of a row."""
        return HALO + ti.min((piece + 1) * self.state.layout.piece, self.state.lanes.length)

    @ti.func
    def whole_passes(self, now, numbers, measure: ti.template()):
        """A step in two launches; with ``measure`` a thread sums up a piece of a row."""
        nz, ny, _ = ti.static(self.state.sites)
        pieces, piece_length = ti.static(self.state.layout.pieces, self.state.layout.piece)
        begin, end = ti.static(HALO, HALO + self.state.lanes.length)
        for column, _, start in ti.static(self.first):
            for j, k, m in ti.ndrange((1, ny - 1), (1, nz - 1), (start, end)):
                column(ti.Struct(k=k, j=j, m=m), self.rounded(now, numbers))
        for j, k, m in ti.ndrange((1, ny - 1), (1, nz - 1), (begin - 1, end + 1)):
            step = self.rounded(now, numbers)
            self.forces(ti.Struct(row=j, k=k, j=j, m=m), step)
        if ti.static(measure):
            for j, k, piece in ti.ndrange((1, ny - 1), (1, nz - 1), pieces):
                step = self.rounded(now, numbers)
                rows = ti.Vector([j - 1, j, j + 1])
                sums = ti.Vector.zero(ti.f64, 2)
                for m in range(begin + piece * piece_length, self.piece_end(piece)):
                    at = ti.Struct(k=k, j=j, m=m)
                    sums += self.nodes.update_column(rows, at, step, True)
                self.state.node_sums[(j * nz + k) * pieces + piece] = sums
        else:
            for j, k, m in ti.ndrange((1, ny - 1), (1, nz - 1), (begin, end)):
                step = self.rounded(now, numbers)
                rows = ti.Vector([j - 1, j, j + 1])
                at = ti.Struct(k=k, j=j, m=m)
                self.nodes.update_column(rows, at, step, False)

    @ti.kernel
    def _in_passes(self, now: int, numbers: StepNumbers, measure: ti.template()):
        self.whole_passes(now, numbers, measure)

    # -- from Python -------------------------------------------------------------------------------

    def take(self, now: int, kick: float, drift: float, damping: float, measure: bool) -> None:
        """Take a step: bar forces at ``now``, then the nodes.

        Args:
            now: buffer of the displacement; the new one goes into the other.
            kick, drift: times by which velocities and displacements change, s; both are the time
                step in a run.
            damping: coefficient of mass-proportional damping, 1/s.
            measure: whether kinetic energy and losses by damping at t_n are summed up
                (``node_sums``).
        """
        numbers = self.numbers(kick, drift, damping)
        if self.state.layout.alone:
            self._alone(now, numbers, 1, measure, 0)
            return
        if not self.state.in_strips:
            self._in_passes(now, numbers, measure)
            return
        if self.first:
            self._first(now, numbers)
        if self.state.layout.strips > 1:
            # a launch of its own, as code that stands twice in a kernel is compiled twice
            self._in_strips(now, numbers, measure, 1)
        self._in_strips(now, numbers, measure, 0)

    def kick(self, now: int, time_step: float, damping: float = 0.0) -> None:
        """Change the velocities by the bar forces over a time step; nodes do not move."""
        self.take(now, time_step, 0.0, damping, False)
