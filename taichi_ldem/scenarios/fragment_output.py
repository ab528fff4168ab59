"""Counts the pieces of the plate during a run, for its fields, fragments.csv and summary."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.analysis.fragments import Array, Labels, Pieces, labels_of, of_modules, pieces_of
from taichi_ldem.storage.fields import read_broken_bars
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.fragments import FragmentWriter

if TYPE_CHECKING:
    from pathlib import Path

    from taichi_ldem.solver.simulation import Simulation


class FragmentOutput:
    """Counts the pieces at the times at which fields are written.

    Args:
        path: of fragments.csv.
        until: time up to which an earlier process has written it, s; None: a new run.

    Attributes:
        last: the pieces at the latest of these times; None before the first.
    """

    def __init__(self, path: "Path", simulation: "Simulation", until: float | None = None):
        self.simulation = simulation
        self.writer = FragmentWriter(path, until)
        self.last: Pieces | None = None

    def write(self, at: float, displacement: Array) -> Labels:
        """Write the pieces of the last sampled step, and return the piece of each module.

        Velocities are those half a step later, as in the fields.

        Args:
            displacement: (sublattices, *S, 3) at the sample, m.
        """
        labels, self.last = count(self.simulation, displacement)
        self.writer.append(at, _columns(self.last))
        return of_modules(self.simulation.dynamics.lattice, labels)

    def summary(self) -> dict[str, float | int]:
        """Numbers of the pieces at the end, for the summary of a finished run."""
        if self.last is None:  # resumed after the last fields had been written
            _, self.last = count(self.simulation, self.simulation.displacement_before())
        return self.last.summary()


def count(simulation: "Simulation", displacement: Array) -> tuple[Labels, Pieces]:
    """The pieces of a simulation's plate now.

    Bars that have failed must have been recorded (``Dynamics.new_broken``).

    Args:
        displacement: (sublattices, *S, 3), m.
    """
    dynamics = simulation.dynamics
    failed = np.zeros(dynamics.lattice.sites, dtype=np.uint16)
    if dynamics.features.notch:
        failed |= dynamics.lanes.gather(dynamics.removed.to_numpy())
    if dynamics.features.damage:
        failed |= dynamics.recorded_bits()
    labels = labels_of(dynamics.lattice, failed)
    moving = displacement, dynamics.get_velocity()
    return labels, pieces_of(dynamics.lattice, labels, dynamics.masses(), *moving)


def fragments_of(folder: RunFolder, time_s: float) -> Labels:
    """(modules,) the piece of each module of a run at a stored time, from its broken bars.

    Every run stores these, whether its scene asks for fragments or not.

    Raises:
        SceneError: a file of the run cannot be read.
    """
    from taichi_ldem.solver.build import build_lattice, notch_bars

    scene, bars = folder.read_scene(), read_broken_bars(folder.fields_file)
    lattice = build_lattice(scene)
    before = bars.time_s <= time_s
    failed = lattice.failed_bits(bars.position_m[before], bars.bar[before])
    cut = notch_bars(scene, lattice, time_s)
    return of_modules(lattice, labels_of(lattice, failed | cut))


def _columns(pieces: Pieces) -> dict[str, npt.NDArray[Any]]:
    """The pieces under the names of the columns of fragments.csv."""
    columns: dict[str, npt.NDArray[Any]]
    columns = {"fragment": pieces.number, "nodes": pieces.nodes, "mass_kg": pieces.mass}
    for form, vectors in (
        ("{}_m", pieces.centre),
        ("velocity_{}_m_s", pieces.velocity),
        ("momentum_{}_kg_m_s", pieces.momentum),
        ("extent_{}_m", pieces.extent),
    ):
        columns |= {form.format(axis): vectors[:, n] for n, axis in enumerate("xyz")}
    return columns | {"equivalent_diameter_m": np.asarray(pieces.diameter)}
