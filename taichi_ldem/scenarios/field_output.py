"""Fields and broken bars of a run, written to its fields file while it runs."""

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.scenarios.fragment_output import FragmentOutput
from taichi_ldem.solver.module_fields import ModuleFields
from taichi_ldem.storage.fields import FieldWriter, hexahedral_mesh, read_times, widths
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.provenance import provenance

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation
    from taichi_ldem.storage.checkpoint import Checkpoint


class FieldOutput:
    """Writes fields at the first sample that reaches each of the scene's times, and broken bars.

    Broken bars are collected until the next fields or the next checkpoint, because the file is
    opened anew for each writing and that is slow.

    Args:
        resumed: a checkpoint of an earlier process, whose file is continued.

    Attributes:
        bytes_per_frame: uncompressed size of the fields at one time, bytes.
    """

    def __init__(
        self, folder: RunFolder, simulation: "Simulation", resumed: "Checkpoint | None" = None
    ):
        self.simulation = simulation
        lattice = simulation.dynamics.lattice
        points, cells, sites = hexahedral_mesh(lattice.mask, lattice.spacing, lattice.origin)
        self.at = tuple((sites + 1).T)
        points = lattice.positions()[0][self.at]
        self.module = lattice.mask
        scene = simulation.scene
        self.due = list(scene.field_times)
        self.damage = scene.material.damage
        self.broken, self.written = 0, (0, 0)
        self.pending: list[tuple[Any, Any, Any]] = []
        if resumed is not None:
            self.written = (resumed.field_steps, resumed.broken_bars)
            if resumed.history:
                self.broken = resumed.history[-1]["broken_bars"]
                self._drop_due(resumed.history[-1]["time_s"])
        origin = {key: _text(value) for key, value in provenance(scene).items()}
        old = None if resumed is None else self.written
        names = [*scene.output.fields, *(["fragment"] if scene.output.fragments else [])]
        self.writer = FieldWriter(
            folder.fields_file, points, cells, old, origin, lattice.cell, names
        )
        self.bytes_per_frame = 4 * (6 * len(self.at[0]) + len(cells) * (1 + widths(names)))
        self.quantities = ModuleFields(simulation.dynamics, scene.output.fields, points, cells)
        self.fragments: FragmentOutput | None = None
        if scene.output.fragments:
            until = None
            if self.written[0]:
                until = float(read_times(folder.fields_file)[self.written[0] - 1])
            self.fragments = FragmentOutput(folder.fragments_file, simulation, until)

    def take(self, sample: "Sample") -> None:
        """Write the fields that are due at a sample, whose step has been completed."""
        if self.damage and sample.broken_bars > self.broken:
            sites, bars = self.simulation.dynamics.new_broken()
            place = self.simulation.dynamics.lattice.bar_midpoints(sites, bars)
            self.pending.append((np.full(len(bars), sample.time), place, bars))
            self.broken = sample.broken_bars
        if self._drop_due(sample.time):
            self.write(sample.time)

    def _drop_due(self, time_s: float) -> bool:
        """Drop the output times up to that of a sample, and return whether there were any."""
        before = len(self.due)
        slack = 0.5 * self.simulation.time_step
        self.due = [t for t in self.due if t > time_s + slack]
        return len(self.due) < before

    def flush(self) -> None:
        """Write the broken bars collected so far."""
        if self.pending:
            times, places, bars = (np.concatenate(part) for part in zip(*self.pending, strict=True))
            self.writer.append_broken(times, places, bars)
            self.written = (self.written[0], self.written[1] + len(bars))
            self.pending = []

    def summary(self) -> dict[str, float | int]:
        """Numbers of a finished run."""
        return {} if self.fragments is None else self.fragments.summary()

    def write(self, at: float) -> None:
        """Write the fields of the last sampled step as those at a time, s."""
        self.flush()
        s = self.simulation
        moved = s.displacement_before()
        displacement = moved[0][self.at]
        velocity = s.dynamics.get_velocity()[0][self.at]
        fraction = np.zeros(int(self.module.sum()))
        if self.damage:
            fraction = s.broken_fraction()[self.module]
        quantities: dict[str, Any] = self.quantities.at_sample(1 - s.now, moved, displacement)
        if self.fragments is not None:
            quantities["fragment"] = self.fragments.write(at, moved)
        self.writer.append(at, displacement, velocity, fraction, quantities)
        self.written = (self.written[0] + 1, self.written[1])


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
