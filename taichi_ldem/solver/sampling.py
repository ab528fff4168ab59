"""Samples of a simulation: the energies and the values of the bodies, in one small array."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact import BODIES, HELD
from taichi_ldem.solver.contact.kernels.body import (
    IMPULSE,
    LOSS_AFTER,
    LOSS_BEFORE,
    PLATE_BEFORE,
    Reading,
    RigidBody,
)
from taichi_ldem.solver.dynamics import Dynamics
from taichi_ldem.solver.energy import EnergySums, Ledger
from taichi_ldem.solver.state import field_apart

LOST, POSITION = range(2)
"""Values of a body recorded before a measured step: its losses after the last sample time, and its
displacement."""

# values of a rigid body in a sample: its sums, those recorded before the step, its
# velocities before and after the step, and the most nodes that were ever near
SUMS, RECORDED, VELOCITIES, NEAR = 0, 4, 6, 8
ENTRIES = NEAR + 1


@dataclass(frozen=True)
class Sample:
    """One row of the history.

    Attributes:
        time: s. step: its number.
        ledger: energies at that time.
        energy_error: imbalance over initial energy plus external work.
        energy_error_of_plate: imbalance over the energy given to the plate.
        broken_bars: so far.
        observed: values of the rigid bodies by the history's columns: see their declarations in
            ``contact``. A force is an impulse over the time since the last sample.
    """

    time: float
    step: int
    ledger: Ledger
    energy_error: float
    energy_error_of_plate: float
    broken_bars: int
    observed: Mapping[str, Any]


@ti.data_oriented
class Sampler:
    """Reads the sums of the plate and of the rigid bodies around a measured step.

    Attributes:
        recorded: (bodies, 2) f64: see ``LOST``.
        impulses: of every body at the last sample, N s, by name; 0 for absent bodies. Then those
            on bodies that have any along x and y.
        probes: of the scene; None where it has none.
    """

    def __init__(
        self, bodies: list[RigidBody], energies: EnergySums, dynamics: Dynamics, scene: Scene
    ):
        self.bodies, self.energies = bodies, energies
        self.lands_elastically = scene.lands_elastically
        self.probes: Any = None
        if scene.probes:
            from taichi_ldem.solver.probes import Probes

            self.probes = Probes(dynamics, scene)
        self.recorded = field_apart(ti.f64, (max(len(bodies), 1), 2))
        self.start()

    def start(self) -> None:
        """Clear the last sample."""
        names = [body.name for body in BODIES]
        names += [f"{b.name}.{axis}" for b in self.bodies if b.sideways for axis in "xy"]
        self.impulses = dict.fromkeys(names, 0.0)

    def place(self, scene: Scene) -> None:
        """Take the probes of another scene.

        Raises:
            ValueError: they need other fields.
        """
        if bool(scene.probes) != (self.probes is not None):
            raise ValueError("probes: no probes can be added or taken away")
        if self.probes is not None:
            self.probes.place(scene)

    def record(self, now: int) -> None:
        """Record the values of bodies and probes before a measured step from buffer ``now``."""
        self._record()
        if self.probes is not None:
            self.probes.record(now)

    @ti.kernel
    def _record(self):
        for n in ti.static(range(len(self.bodies))):
            self.bodies[n].add_up()
        ti.loop_config(serialize=True)
        for _ in range(1):
            for n in ti.static(range(len(self.bodies))):
                self.recorded[n, LOST] = self.bodies[n].sums[LOSS_AFTER]
                self.recorded[n, POSITION] = self.bodies[n].travelled()

    @ti.kernel
    def _collect(self, values: ti.types.ndarray()):
        """Add up the values of a sample into one small array."""
        self.energies.add_up()
        for n in ti.static(range(len(self.bodies))):
            self.bodies[n].add_up()
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = self.energies.sums()
            for n in ti.static(range(self.energies.count)):
                values[0, n] = total[n]
            for n in ti.static(range(len(self.bodies))):
                for m in ti.static(range(4)):
                    values[1 + n, SUMS + m] = self.bodies[n].sums[m]
                for m in ti.static(range(2)):
                    values[1 + n, RECORDED + m] = self.recorded[n, m]
                before, after = self.bodies[n].velocities()
                values[1 + n, VELOCITIES] = before
                values[1 + n, VELOCITIES + 1] = after
                values[1 + n, NEAR] = self.bodies[n].count[1]

    def collected(self) -> tuple[Any, list[Reading]]:
        """Sums of the plate (see ``EnergySums.total``), and the readings of all bodies.

        Raises:
            TooManyNodes: more nodes came near a body than its list holds.
        """
        values = np.zeros((len(self.bodies) + 1, ENTRIES))
        self._collect(values)
        readings = []
        for body, row in zip(self.bodies, values[1:].tolist(), strict=True):
            body.refuse_more(int(row[NEAR]))
            recorded = row[RECORDED : RECORDED + 2]
            lost, held = recorded[LOST] + row[LOSS_BEFORE], 0.0
            if body.elastic:  # what is lost before t_n comes back after it
                lost, held = row[LOSS_BEFORE] + row[LOSS_AFTER], recorded[LOST] - row[LOSS_AFTER]
            readings.append(
                Reading(
                    impulse=row[IMPULSE],
                    plate_before=row[PLATE_BEFORE],
                    lost=lost,
                    displacement=recorded[POSITION],
                    velocity_before=row[VELOCITIES],
                    velocity_after=row[VELOCITIES + 1],
                    held=held,
                )
            )
        return values[0], readings

    def observed(
        self, readings: list[Reading], at: float, since: float, now: int
    ) -> dict[str, Any]:
        """Values that the bodies add to the history's row, by column.

        Args:
            readings: of all bodies. at: time of the sample, s.
            since: time since the last sample, s. now: buffer of the displacement at the sample.
        """
        by_name = {body.name: (body, r) for body, r in zip(self.bodies, readings, strict=True)}
        observed: dict[str, Any] = {}
        for declared in BODIES:
            if declared.name in by_name:
                body, reading = by_name[declared.name]
                force = self._force(body.name, reading.impulse, since)
                values = body.observe(reading, force, at, now)
                across = zip("xy", body.impulses_sideways(), strict=False)
                values += tuple(self._force(f"{body.name}.{a}", i, since) for a, i in across)
                observed |= dict(zip(body.columns, values, strict=True))
        if self.lands_elastically:
            observed[HELD.column] = sum(reading.held for reading in readings)
        if self.probes is not None:
            observed |= self.probes.observed(now)
        return observed

    def _force(self, name: str, impulse: float, since: float) -> float:
        """The mean force since the last sample, N, from an impulse since the start, N s."""
        force = (impulse - self.impulses[name]) / since
        self.impulses[name] = impulse
        return force
