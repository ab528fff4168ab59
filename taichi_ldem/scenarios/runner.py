"""From a scene to a run folder: what every scenario that steps in time has in common.

A scenario adds its numbers (``summary``) to those of the run; files, progress, warnings, guard and
pictures are the same for all.
"""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from taichi_ldem import backend
from taichi_ldem.describe import implied, warnings
from taichi_ldem.scene import Scene, scene_to_toml
from taichi_ldem.store import FieldWriter, HistoryWriter, RunFolder, hexahedral_mesh

if TYPE_CHECKING:
    from taichi_ldem.simulation import Sample, Simulation

STOPPED, INTERRUPTED = 3, 130
LINES = 20
"""Progress lines that a run prints where there is no terminal."""


def columns(scene: Scene) -> list[str]:
    """Names of the history's columns: those of features that the scene names."""
    damping, striker = scene.solver.damping > 0, scene.striker is not None
    gravity = scene.striker is not None and scene.striker.gravity > 0
    grips = scene.grips is not None
    names = {
        "time_s": True,
        "striker_displacement_m": striker,
        "striker_velocity_m_s": striker,
        "striker_force_n": striker,
        "ring_force_n": scene.held,
        "grip_displacement_m": grips,
        "grip_force_n": grips,
        "gauge_strain": grips,
        "gauge_lateral_strain": grips,
        "support_force_n": scene.supports is not None,
        "kinetic_plate_j": True,
        "kinetic_striker_j": striker,
        "strain_j": True,
        "fracture_j": scene.material.damage,
        "damping_j": damping,
        "contact_j": striker or scene.held or scene.supports is not None,
        "external_j": gravity or grips,
        "energy_error": True,
        "broken_bars": scene.material.damage,
    }
    return [name for name, present in names.items() if present]


def row(sample: "Sample") -> dict[str, float | int | None]:
    """A sample under the names of the history's columns."""
    ledger = sample.ledger
    return {
        "time_s": sample.time,
        "striker_displacement_m": sample.striker_displacement,
        "striker_velocity_m_s": sample.striker_velocity,
        "striker_force_n": sample.striker_force,
        "ring_force_n": sample.ring_force,
        "grip_displacement_m": sample.grip_displacement,
        "grip_force_n": sample.grip_force,
        "gauge_strain": sample.gauge_strain,
        "gauge_lateral_strain": sample.gauge_lateral_strain,
        "support_force_n": sample.support_force,
        "kinetic_plate_j": ledger.kinetic_plate,
        "kinetic_striker_j": ledger.kinetic_striker,
        "strain_j": ledger.strain,
        "fracture_j": ledger.fracture,
        "damping_j": ledger.damping,
        "contact_j": ledger.contact,
        "external_j": ledger.external,
        "energy_error": sample.energy_error,
        "broken_bars": sample.broken_bars,
    }


class FieldOutput:
    """Writes broken bars, and fields at the first sample that reaches each of the scene's times."""

    def __init__(self, folder: RunFolder, simulation: "Simulation"):
        self.simulation = simulation
        lattice = simulation.dynamics.lattice
        points, cells, sites = hexahedral_mesh(lattice.mask, lattice.spacing, lattice.origin)
        self.at = tuple((sites + 1).T)
        self.module = lattice.mask
        self.writer = FieldWriter(folder.fields_file, points, cells)
        self.due = list(simulation.scene.field_times)
        self.damage = simulation.scene.material.damage
        self.broken = 0

    @property
    def bytes_per_time(self) -> int:
        """Uncompressed size of the fields at one time, bytes."""
        return 4 * (6 * len(self.at[0]) + int(self.module.sum()))

    def take(self, sample: "Sample") -> None:
        """Write what is due at a sample; the step after it has been taken already."""
        if self.damage and sample.broken_bars > self.broken:
            sites, bars = self.simulation.dynamics.new_broken()
            place = self.simulation.dynamics.lattice.bar_midpoints(sites, bars)
            self.writer.append_broken(np.full(len(bars), sample.time), place, bars)
            self.broken = sample.broken_bars
        slack = 0.5 * self.simulation.time_step
        if self.due and self.due[0] <= sample.time + slack:
            self.due = [t for t in self.due if t > sample.time + slack]
            self.write(sample.time)

    def write(self, at: float) -> None:
        """Write the fields of the last sampled step."""
        s = self.simulation
        displacement = s.displacement_before()[0][self.at]
        velocity = s.dynamics.get_velocity()[0][self.at]
        fraction = np.zeros(int(self.module.sum()))
        if self.damage:
            fraction = s.broken_fraction()[self.module]
        self.writer.append(at, displacement, velocity, fraction)


History = list[dict[str, Any]]
"""Rows of the history: its columns' names and values, and ``energy_error_of_plate``."""

Summary = Callable[["Simulation", History], dict[str, Any]]
"""A scenario's own numbers of a finished run, for ``summary.json``."""


def run(
    scene: Scene,
    out: Path,
    summary: Summary,
    *,
    force: bool = False,
    quiet: bool = False,
    prepare: Callable[["Simulation"], None] | None = None,
    observe: Callable[["Simulation", "Sample"], None] | None = None,
) -> int:
    """Run a scene into a folder, with figures and snapshots.

    Args:
        prepare: changes the simulation before its first step, in a way that no scene describes.
        observe: looks at the simulation at every sample, just after that step was taken.

    Returns:
        0; 3 where the guard stopped the run; 130 after Ctrl-C. What was computed until then is
        kept, and only a finished run has a summary.json.

    Raises:
        SceneError: the scene or the folder is refused; nothing has been written then.
    """
    console = Console(quiet=quiet, highlight=False, markup=False, soft_wrap=True)
    RunFolder.check(out, force=force)
    started = time.perf_counter()
    backend.start(scene.solver)
    from taichi_ldem.contact import TooManyNodes
    from taichi_ldem.simulation import Simulation, SimulationStopped

    simulation = Simulation(scene)
    simulation.compile()
    if prepare is not None:
        prepare(simulation)
    expected = simulation.measure_step() * simulation.steps
    compiled = time.perf_counter() - started
    folder = RunFolder.create(out, force=force)
    folder.write_scene(scene_to_toml(scene))
    fields = FieldOutput(folder, simulation)
    _announce(console, simulation, expected, fields)
    code = 0
    begun = time.perf_counter()
    history: History = []
    try:
        _step_through(console, simulation, folder, fields, history, observe)
    except KeyboardInterrupt:
        code = INTERRUPTED
        print(f"interrupted at t = {simulation.time:.6g} s; kept in {out}", file=sys.stderr)
    except (SimulationStopped, TooManyNodes) as error:
        code = STOPPED
        print(f"stopped: {error}", file=sys.stderr)
    wall = time.perf_counter() - begun
    if code == 0:
        if scene.striker is not None and not any(r["striker_force_n"] for r in history):
            print("warning: the striker never touched the plate (striker.gap?)", file=sys.stderr)
        numbers = summary(simulation, history) | cost(simulation, history, wall, compiled)
        folder.write_summary(numbers)
    _pictures(console, folder, scene, code)
    console.print(f"{wall:.1f} s of stepping, {compiled:.1f} s of setup; results in {out}")
    return code


def _announce(
    console: Console, simulation: "Simulation", expected: float, fields: FieldOutput
) -> None:
    scene = simulation.scene
    lattice = simulation.dynamics.lattice
    for name, value in implied(scene).items():
        console.print(f"{name:36s}{value}")
    for line in warnings(scene):
        console.print(f"note: {line}")
    samples = simulation.steps // simulation.sample_every + 1
    disk = 250 * samples + fields.bytes_per_time * len(scene.field_times)
    console.print(
        f"{lattice.bars:,} bars, {lattice.nodes:,} nodes; {simulation.steps:,} steps of "
        f"{simulation.time_step:.4g} s (critical {simulation.critical_time_step:.4g} s); about "
        f"{expected:.0f} s to compute, {disk / 1e6:.0f} MB on disk at most"
    )


def _step_through(
    console: Console,
    simulation: "Simulation",
    folder: RunFolder,
    fields: FieldOutput,
    history: History,
    observe: Callable[["Simulation", "Sample"], None] | None,
) -> None:
    from taichi_ldem.simulation import WARN_ERROR

    names = columns(simulation.scene)
    warned = False
    with (
        HistoryWriter(folder.history_file, names) as writer,
        _progress(console, simulation) as tell,
    ):
        for sample in simulation.samples():
            values = row(sample)
            writer.append([values[name] for name in names])  # type: ignore[misc]
            history.append(values | {"energy_error_of_plate": sample.energy_error_of_plate})
            fields.take(sample)
            if observe is not None:
                observe(simulation, sample)
            tell(sample)
            worst = max(sample.energy_error, sample.energy_error_of_plate)
            if worst > WARN_ERROR and not warned:
                warned = True
                text = f"warning: energy error {100 * worst:.1f} % of what the plate was given"
                print(f"{text} at t = {sample.time:.6g} s; see solver.safety", file=sys.stderr)


@contextlib.contextmanager
def _progress(console: Console, simulation: "Simulation") -> Iterator[Any]:
    """A function that tells about a sample: a bar on a terminal, plain lines elsewhere."""
    end = simulation.scene.solver.duration
    begun = time.perf_counter()

    def text(sample: "Sample") -> str:
        given = sample.striker_force if sample.grip_force is None else sample.grip_force
        force = "" if given is None else f"  F {given:7.1f} N"
        return (
            f"t {1e3 * sample.time:8.4f} ms  step {sample.step:7d}{force}  "
            f"broken {sample.broken_bars:7d}  energy error {sample.energy_error:.1e}"
        )

    if console.is_terminal and not console.quiet:
        with Progress(
            TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn(), console=console
        ) as bar:
            task = bar.add_task("", total=end)
            yield lambda sample: bar.update(task, completed=sample.time, description=text(sample))
        return
    every = max(1, simulation.steps // simulation.sample_every // LINES)

    def tell(sample: "Sample") -> None:
        if sample.step // simulation.sample_every % every == 0 or sample.step == simulation.steps:
            gone = time.perf_counter() - begun
            left = gone * (simulation.steps - sample.step) / max(sample.step, 1)
            console.print(f"{text(sample)}  ETA {left:.0f} s" if sample.step else text(sample))

    yield tell


def cost(
    simulation: "Simulation", history: History, wall: float, compiled: float
) -> dict[str, Any]:
    """The numbers of any finished run: balance, steps and time."""
    lattice, last = simulation.dynamics.lattice, history[-1]
    return {
        "fracture_j": last["fracture_j"],
        "contact_j": last["contact_j"],
        "energy_error": max(r["energy_error"] for r in history),
        "energy_error_of_plate": max(r["energy_error_of_plate"] for r in history),
        "broken_bars": last["broken_bars"],
        "time_step_s": simulation.time_step,
        "critical_time_step_s": simulation.critical_time_step,
        "steps": simulation.steps,
        "wall_s": wall,
        "compile_s": compiled,
        "bars": lattice.bars,
        "nodes": lattice.nodes,
        "bars_per_s": lattice.bars * simulation.steps / wall,
    }


def _pictures(console: Console, folder: RunFolder, scene: Scene, code: int) -> None:
    from taichi_ldem.plots import plot_run

    figures = plot_run(folder)
    if code != INTERRUPTED and scene.pulse is None:  # a pulse is too small to be seen
        from taichi_ldem.render import render_run

        figures += render_run(folder, None)
    for figure in figures:
        console.print(f"wrote {figure}")
