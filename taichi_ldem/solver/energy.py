"""The energy ledger: every energy follows from the state and is summed in a fixed order.

A bar's elastic energy follows from its strain and its dissipated energy from its peak strain, so
the step need not add up either. Kinetic energy at t_n is 1/2 v(n-1/2) M v(n+1/2): with it,
central differences conserve the discrete energy of a linear lattice exactly.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.solver.dynamics import Dynamics
from taichi_ldem.solver.lanes import HALO
from taichi_ldem.solver.state import field_apart

STRAIN, FRACTURE, BROKEN, KINETIC, DAMPED = range(5)

GROUP = 128
"""Number of pieces of rows whose sums one thread of a GPU adds up."""


@dataclass(frozen=True)
class Ledger:
    """Energies at one time, J.

    Attributes:
        kinetic_plate, kinetic_bodies, strain: stored energies.
        fracture, damping, contact: energies dissipated since the start.
        external: work that was done from outside since the start.
        touching: energy stored where pieces of the plate touch, or where nodes land elastically.
        opened: energy that notches took when they opened.
    """

    kinetic_plate: float = 0.0
    kinetic_bodies: float = 0.0
    strain: float = 0.0
    fracture: float = 0.0
    damping: float = 0.0
    contact: float = 0.0
    external: float = 0.0
    touching: float = 0.0
    opened: float = 0.0

    @property
    def stored(self) -> float:
        """Kinetic, strain and dissipated energy."""
        return (
            self.kinetic_plate
            + self.kinetic_bodies
            + self.strain
            + self.fracture
            + self.damping
            + self.contact
            + self.touching
            + self.opened
        )

    @property
    def held_by_plate(self) -> float:
        """Energy of the plate: stored, dissipated and lost in contact, J."""
        own = self.kinetic_plate + self.strain + self.fracture + self.damping + self.touching
        return own + abs(self.contact) + self.opened

    def imbalance(self, start: "Ledger") -> float:
        """Energy that was created (positive) or lost since ``start``, external work deducted, J."""
        return self.stored - start.stored - (self.external - start.external)

    def error(self, start: "Ledger") -> float:
        """Imbalance over initial energy plus external work (0 where both are)."""
        scale = start.stored + abs(self.external - start.external)
        return abs(self.imbalance(start)) / scale if scale > 0 else 0.0

    def error_of_plate(self, start: "Ledger", floor: float) -> float:
        """Imbalance over the energy of the plate at the start and what it was given since.

        It is given the bodies' loss and external work.

        Args:
            floor: least denominator, J, so that the first microseconds give no false alarm.
        """
        given = start.kinetic_bodies - self.kinetic_bodies + self.external - start.external
        given += start.kinetic_plate + start.strain
        scale = max(given, floor)
        return abs(self.imbalance(start)) / scale if scale > 0 else 0.0


@ti.data_oriented
class EnergySums:
    """Sums of the plate's energies, added up on the device one after the other.

    Kinetic energy and losses by damping come from a measured step (``State.node_sums``). On a GPU,
    where one thread is slow, rows are cut into pieces and added up in groups.

    Attributes:
        rows: vectors in f64, one for each row of sites or piece of it: strain, fracture (J),
            broken bars; then the work of gravity and what was lost where crack faces met (J), if
            the lattice has them.
        group_sums: vectors in f64, as ``total`` returns them.
        work, faces: places of those two in ``total``; None where there is none.
        count: number of sums, 5 to 7.
    """

    def __init__(self, dynamics: Dynamics):
        self.state, self.bars, self.driver = dynamics, dynamics.bars, dynamics.driver
        self.volumes = dynamics.volumes
        nz, ny, _ = dynamics.sites
        weighs, meet = dynamics.features.gravity, dynamics.features.meeting
        self.work = 5 if weighs else None
        self.faces = 5 + weighs if meet else None
        self.count = 5 + weighs + meet
        self.rows = field_apart(ti.f64, nz * ny * dynamics.layout.pieces, self.count - 2)
        rows = max(part.shape[0] for part in (self.rows, dynamics.node_sums))
        self.group = rows if dynamics.on_cpu else GROUP
        self.group_sums = field_apart(ti.f64, -(-rows // self.group), self.count)

    @ti.func
    def bar_energy(self, bar, strain, at: ti.template(), lane, step: ti.template()):
        """Strain energy and dissipated energy of a bar at a strain, J, and 1 if it is broken.

        Args:
            at, step: structs of ``bars``.
        """
        whole = self.bars.stiffness(bar, at, lane)
        if ti.static(self.state.features.notch):
            if self.bars.is_removed(bar, at, lane):
                whole = 0.0
        length = step.spacing * self.state.lengths[bar][0]
        twice = ti.cast(whole, ti.f64) * length * length
        if ti.static(self.state.features.perturbed):
            # EA L0 is EA / L0 times the square of the bar's own length
            twice /= ti.cast(
                self.bars.square_of_length_ratio(bar, self.bars.vector(bar, at, lane)), ti.f64
            )
        result = ti.Vector([0.5 * twice * strain * strain, 0.0, 0.0], ti.f64)
        if ti.static(self.state.features.damage):
            peak = self.state.peak[bar, at.k, at.j, at.m][lane]
            if peak > 1 or peak < 0:
                result[0] *= self.bars.integrity(bar, strain, peak)
                own = self.bars.peak_strain(bar, at, lane, step.peak_strain)
                result[1] = twice * own**2 * self.bars.dissipated(bar, peak)
                if whole > 0 and self.bars.has_failed(bar, peak):
                    result[2] = 1.0
        return result

    @ti.func
    def work_of_gravity(self, at: ti.template(), step: ti.template()):
        """Work of gravity on a column's nodes up to their displacement, J."""
        work = ti.cast(0.0, ti.f64)
        for s, axis in ti.static(self.state.cell.node_axes):
            u = self.state.displacement[s][axis][step.now, at.k, at.j, at.m]
            for lane in ti.static(range(self.state.lanes.width)):
                # not from lane_masses, whose vector of bytes Taichi's optimiser fails on here
                mass = self.state.mass[int(self.state.code[at.k, at.j, at.m][lane])][s]
                if ti.static(self.state.features.density):
                    mass = self.state.own_mass[s][at.k, at.j, at.m][lane]
                work += ti.cast(mass, ti.f64) * self.state.gravity[0][axis] * u[lane]
        return work

    @ti.kernel
    def _potential(self, now: int, spacing: float, peak_strain: float, volumetric: float):
        nz, ny, _ = ti.static(self.state.sites)
        pieces, piece_length = ti.static(self.state.layout.pieces, self.state.layout.piece)
        for row in range(self.rows.shape[0]):
            step = ti.Struct(
                now=now, spacing=spacing, peak_strain=peak_strain, volumetric=volumetric
            )
            total, more = ti.Vector.zero(ti.f64, 3), ti.Vector.zero(ti.f64, 2)
            k, j = row // pieces // ny, row // pieces % ny
            piece = row % pieces
            if k > 0 and j > 0 and k < nz - 1 and j < ny - 1:
                begin = HALO + piece * piece_length
                for m in range(begin, self.driver.piece_end(piece)):
                    at = ti.Struct(k=k, j=j, m=m)
                    strains = ti.Matrix.zero(float, self.state.cell.bars, self.state.lanes.width)
                    for bar in ti.static(range(self.state.cell.bars)):
                        q = self.bars.twice_green_strain_of_lanes(bar, at, step)
                        strain = self.bars.strain(q)
                        for lane in ti.static(range(self.state.lanes.width)):
                            strains[bar, lane] = strain[lane]
                    for bar, lane in ti.ndrange(self.state.cell.bars, self.state.lanes.width):
                        total += self.bar_energy(bar, strains[bar, lane], at, lane, step)
                    if ti.static(self.state.features.volumetric):
                        stored, lost = self.volumes.column_energy(at, step)
                        total[0] += stored
                        total[1] += lost
                    if ti.static(self.state.features.gravity):
                        more[0] += self.work_of_gravity(at, step)
                    if ti.static(self.state.features.meeting):
                        lost = self.state.face_loss[k, j, m]
                        for lane in ti.static(range(self.state.lanes.width)):
                            more[1] += ti.cast(lost[lane], ti.f64)
            for n in ti.static(range(3)):
                self.rows[row][n] = total[n]
            if ti.static(self.state.features.gravity):
                self.rows[row][3] = more[0]
            if ti.static(self.state.features.meeting):
                self.rows[row][ti.static(self.count - 3)] = more[1]

    def potential(self, now: int) -> None:
        """Sum strain energy, dissipated energy and broken bars at the displacement ``now``."""
        state = self.state
        self._potential(now, state.lattice.spacing, state.peak_strain, state.volumetric)

    @ti.func
    def add_up(self):
        """Add up the rows of each group, in their order."""
        for group in range(self.group_sums.shape[0]):
            first = group * self.group
            bars, nodes = ti.Vector.zero(ti.f64, self.rows.n), ti.Vector.zero(ti.f64, 2)
            for row in range(first, ti.min(first + self.group, self.rows.shape[0])):
                bars += self.rows[row]
            for row in range(first, ti.min(first + self.group, self.state.node_sums.shape[0])):
                nodes += self.state.node_sums[row]
            sums = ti.Vector.zero(ti.f64, self.count)
            for n in ti.static(range(self.rows.n)):
                sums[n if n < KINETIC else n + 2] = bars[n]
            sums[KINETIC], sums[DAMPED] = nodes[0], nodes[1]
            self.group_sums[group] = sums

    @ti.func
    def sums(self):
        """Sum over the groups, in their order; for one thread."""
        total = ti.Vector.zero(ti.f64, self.count)
        for group in range(self.group_sums.shape[0]):
            total += self.group_sums[group]
        return total

    @ti.kernel
    def _total(self, values: ti.types.ndarray()):
        self.add_up()
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = self.sums()
            for n in ti.static(range(self.count)):
                values[n] = total[n]

    def total(self) -> npt.NDArray[np.float64]:
        """(count,) sums over the plate: strain, fracture, broken bars, kinetic, damped.

        Then come those at ``work`` and ``faces``.
        """
        values = np.zeros(self.count)
        self._total(values)
        return values

    def work_of_gravity_in(self, total: npt.NDArray[np.float64]) -> float:
        """The work of gravity among the sums of ``total``, J; 0 without gravity."""
        return 0.0 if self.work is None else float(total[self.work])

    def lost_at_faces(self, total: npt.NDArray[np.float64]) -> float:
        """What was lost where crack faces met, among the sums of ``total``, J."""
        return 0.0 if self.faces is None else float(total[self.faces])
