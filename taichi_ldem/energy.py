"""The ledger: every energy from state alone, in a fixed order of summation.

A bar's elastic energy follows from its strain and its dissipated energy from its peak strain, so
the hot loop carries nothing for them. Kinetic energy at t_n is 1/2 v(n-1/2) M v(n+1/2): with it,
central differences conserve the discrete energy of a linear lattice exactly.
"""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from taichi_ldem.dynamics import CENTRE, CORNER, STIFFNESS_KIND, Dynamics
from taichi_ldem.lattice import BARS_PER_SITE

STRAIN, FRACTURE, BROKEN, KINETIC, DAMPED = range(5)


@dataclass(frozen=True)
class Ledger:
    """Energies at one time, J (the plate's, and what crossed its border).

    ``imbalance`` is what the others fail to add up to since the start.
    """

    kinetic_plate: float = 0.0
    kinetic_striker: float = 0.0
    strain: float = 0.0
    fracture: float = 0.0
    damping: float = 0.0
    contact: float = 0.0
    external: float = 0.0

    @property
    def stored(self) -> float:
        """Kinetic, strain and dissipated energy."""
        return (
            self.kinetic_plate
            + self.kinetic_striker
            + self.strain
            + self.fracture
            + self.damping
            + self.contact
        )

    def imbalance(self, start: "Ledger") -> float:
        """Energy that appeared (positive) or vanished since ``start``, beyond external work, J."""
        return self.stored - start.stored - (self.external - start.external)

    def error(self, start: "Ledger") -> float:
        """Imbalance over initial energy plus external work (0 where both are)."""
        scale = start.stored + abs(self.external - start.external)
        return abs(self.imbalance(start)) / scale if scale > 0 else 0.0

    def error_of_plate(self, start: "Ledger", floor: float) -> float:
        """Imbalance over what the plate was given: the striker's loss plus external work.

        Args:
            floor: smallest scale, J, so that the first microseconds raise no alarm.
        """
        given = start.kinetic_striker - self.kinetic_striker + self.external - start.external
        scale = max(given, floor)
        return abs(self.imbalance(start)) / scale if scale > 0 else 0.0


@ti.data_oriented
class EnergySums:
    """Partial sums of the plate's energies, a row of sites each, added up on the host.

    Attributes:
        rows: (rows,) 5-vectors in f64: strain, fracture, broken bars, kinetic (J), damped (J).
    """

    def __init__(self, dynamics: Dynamics):
        self.dynamics = dynamics
        self.rows = ti.Vector.field(5, ti.f64, shape=dynamics.rows)

    @ti.func
    def bar_energy(self, bar: ti.template(), now, k, j, i, spacing, peak_strain):
        """Strain energy and dissipated energy of a bar (J), and 1 if it is broken."""
        e, _ = self.dynamics.elongation(bar, now, k, j, i, spacing)
        whole = self.dynamics.stiffness[int(self.dynamics.code[k, j, i])][
            ti.static(STIFFNESS_KIND[bar])
        ]
        if ti.static(self.dynamics.features.notch):
            if (self.dynamics.removed[k, j, i] >> bar) & 1:
                whole = 0.0
        length = spacing * ti.static(1.0 if bar < 6 else 0.75**0.5)
        twice = ti.cast(whole, ti.f64) * length * length
        result = ti.Vector([0.5 * twice * e * e, 0.0, 0.0], ti.f64)
        if ti.static(self.dynamics.features.damage):
            peak = self.dynamics.peak[k, j, i][bar]
            result[0] *= self.dynamics.integrity(bar, e, peak)
            result[1] = twice * peak_strain**2 * self.dynamics.dissipated(bar, peak)
            if (
                whole > 0
                and peak >= self.dynamics.softening[ti.static(self.dynamics.softening_row(bar))][0]
            ):
                result[2] = 1.0
        return result

    @ti.kernel
    def _potential(self, now: int, spacing: float, peak_strain: float):
        _, ny, nx = ti.static(self.dynamics.sites)
        for row in range(self.dynamics.rows):
            total = ti.Vector.zero(ti.f64, 3)
            if row // ny > 0 and row % ny > 0 and row // ny < self.dynamics.sites[0] - 1:
                for i in range(1, nx - 1):
                    for bar in ti.static(range(BARS_PER_SITE)):
                        total += self.bar_energy(
                            bar, now, row // ny, row % ny, i, spacing, peak_strain
                        )
            for n in ti.static(range(3)):
                self.rows[row][n] = total[n]

    @ti.kernel
    def _kinetic(self, now: int, spacing: float, time_step: float, damping: float):
        nz, ny, nx = ti.static(self.dynamics.sites)
        for row in range(self.dynamics.rows):
            total = ti.Vector.zero(ti.f64, 2)
            k, j = row // ny, row % ny
            if k > 0 and j > 0 and k < nz - 1 and j < ny - 1:
                for i in range(1, nx - 1):
                    for s in ti.static((CORNER, CENTRE)):
                        after = self.dynamics.free_velocity(
                            s, now, k, j, i, spacing, time_step, damping
                        )
                        mass = self.dynamics.mass[int(self.dynamics.code[k, j, i])][s]
                        before = self.dynamics.velocity[s, k, j, i]
                        total[0] += 0.5 * mass * before.dot(after)
                        if ti.static(self.dynamics.features.damping):
                            # of this step's work the half done before t_n
                            half = 0.25 * damping * time_step * mass * (before + after).dot(before)
                            total[1] += self.dynamics.damped[s, k, j, i] + half
            for n in ti.static(range(2)):
                self.rows[row][KINETIC + n] = total[n]

    def potential(self, now: int) -> None:
        """Sum strain energy, dissipated energy and broken bars at the displacement ``now``."""
        d = self.dynamics
        self._potential(now, d.lattice.spacing, d.peak_strain)

    def kinetic(self, now: int, time_step: float, damping: float) -> None:
        """Sum kinetic energy at t_n, after the bar forces and before the nodes move.

        Contact is not in it yet: it adds half the work of its impulses in this step.
        """
        self._kinetic(now, self.dynamics.lattice.spacing, time_step, damping)

    def total(self) -> np.ndarray:
        """(5,) sums over the rows, see ``rows``."""
        return self.rows.to_numpy().sum(axis=0)
