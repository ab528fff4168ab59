"""The lines that a run prints: the announcement before its first step and its progress."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from taichi_ldem.scenarios.describe import implied, warnings
from taichi_ldem.solver.contact import bodies_of

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation

LINES = 20
"""Progress lines that a run prints where there is no terminal."""

ROW_BYTES = 250
"""Size of a row of history.csv, bytes, for the estimate of disk space."""


def make_console(quiet: bool) -> Console:
    """A console that prints plain lines, or nothing."""
    return Console(quiet=quiet, highlight=False, markup=False, soft_wrap=True)


def announce(
    console: Console, simulation: "Simulation", expected: float, bytes_per_frame: int
) -> None:
    """Print the quantities that the scene implies, remarks on them, and the cost of the run.

    Args:
        expected: time to compute, s.
        bytes_per_frame: size of the fields at one of their times, bytes.
    """
    scene = simulation.scene
    lattice = simulation.dynamics.lattice
    for name, value in implied(scene).items():
        console.print(f"{name:36s}{value}")
    for line in warnings(scene, simulation.steps):
        console.print(f"note: {line}")
    samples = simulation.steps // simulation.sample_every + 1
    disk = ROW_BYTES * samples + bytes_per_frame * len(scene.field_times)
    console.print(
        f"{lattice.bars:,} bars, {lattice.nodes:,} nodes; {simulation.steps:,} steps of "
        f"{simulation.time_step:.4g} s (critical {simulation.critical_time_step:.4g} s); about "
        f"{expected:.0f} s to compute, {disk / 1e6:.0f} MB on disk at most"
    )


@contextlib.contextmanager
def progress(console: Console, simulation: "Simulation") -> Iterator["Callable[[Sample], None]"]:
    """A function that shows a sample: in a bar on a terminal, in plain lines elsewhere."""
    columns = {b.name: b.force for b in bodies_of(simulation.scene) if b.force is not None}

    def state(sample: "Sample") -> str:
        return _state(sample, {name: sample.observed[column] for name, column in columns.items()})

    if console.is_terminal and not console.quiet:
        with Progress(
            TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn(), console=console
        ) as bar:
            task = bar.add_task("", total=simulation.scene.solver.duration)
            yield lambda sample: bar.update(task, completed=sample.time, description=state(sample))
        return
    every = max(1, simulation.steps // simulation.sample_every // LINES)
    begun, first = time.perf_counter(), simulation.step_number

    def show(sample: "Sample") -> None:
        if sample.step // simulation.sample_every % every and sample.step != simulation.steps:
            return
        line = state(sample)
        if sample.step:
            elapsed = time.perf_counter() - begun
            left = elapsed * (simulation.steps - sample.step) / max(sample.step - first, 1)
            line += f"  ETA {left:.0f} s"
        console.print(line)

    yield show


def _state(sample: "Sample", forces: Mapping[str, float]) -> str:
    """Time, step, force, broken bars and energy error of a sample."""
    return (
        f"t {1e3 * sample.time:8.4f} ms  step {sample.step:7d}{in_words(forces)}  "
        f"broken {sample.broken_bars:7d}  energy error {sample.energy_error:.1e}"
    )


def in_words(forces: Mapping[str, float]) -> str:
    """The forces of a sample: each with the name of its body, where there are several.

    More than two strikers have their sum, because the line would be too long.
    """
    strikers = [name for name in forces if name.startswith("striker")]
    shown = dict(forces)
    if len(strikers) > 2:
        total = sum(shown.pop(name) for name in strikers)
        shown = {f"{len(strikers)} strikers": total} | shown
    return "".join(
        f"  F {f'{name} ' if len(forces) > 1 else ''}{newtons(force)} N"
        for name, force in shown.items()
    )


def newtons(force: float) -> str:
    """A force to a tenth of a newton, without the sign of a negative zero."""
    return f"{round(force, 1) + 0.0:7.1f}"
