"""From a scene to a run folder: what every scenario that steps in time has in common.

A scenario adds its numbers (``summary``) to those of the run; files, progress, warnings, guard and
pictures are the same for all.

A run can be cut off at any moment and resumed: checkpoints are taken between two steps, on the
scene's interval of wall time, on SIGINT and SIGTERM, and at the end.
"""

import contextlib
import itertools
import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.describe import implied, warnings
from taichi_ldem.scene import Scene, load_scene, parse_scene, scene_to_toml
from taichi_ldem.solver import backend
from taichi_ldem.solver.contact import bodies_of, observables
from taichi_ldem.solver.memory import peak_bytes, refuse_too_large
from taichi_ldem.storage.provenance import changed_machine, provenance
from taichi_ldem.storage.store import FieldWriter, HistoryWriter, RunFolder, hexahedral_mesh

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation
    from taichi_ldem.storage.checkpoint import Checkpoint

STOPPED, UNWRITABLE, INTERRUPTED, TERMINATED = 3, 4, 130, 143
LINES = 20
"""Progress lines that a run prints where there is no terminal."""


def columns(scene: Scene) -> list[str]:
    """Names of the history's columns: those of features that the scene names."""
    present = bodies_of(scene)
    own = [observable for body in present for observable in body.observables]
    names = {
        "time_s": True,
        **{o.column: True for o in own if not o.energy},
        "kinetic_plate_j": True,
        **{o.column: True for o in own if o.energy},
        "strain_j": True,
        "fracture_j": scene.material.damage,
        "damping_j": scene.solver.damping > 0,
        "contact_j": any(body.dissipates for body in present),
        "external_j": any(body.works(scene) for body in present),
        "energy_error": True,
        "broken_bars": scene.material.damage,
    }
    return [name for name, shown in names.items() if shown]


def row(sample: "Sample") -> dict[str, float | int | None]:
    """A sample under the names of the history's columns: None for bodies that it lacks."""
    ledger, observed = sample.ledger, sample.observed
    values = {
        "time_s": sample.time,
        **{o.column: observed.get(o.column) for o in observables(energy=False)},
        "kinetic_plate_j": ledger.kinetic_plate,
        **{o.column: observed.get(o.column, 0.0) for o in observables(energy=True)},
        "strain_j": ledger.strain,
        "fracture_j": ledger.fracture,
        "damping_j": ledger.damping,
        "contact_j": ledger.contact,
        "external_j": ledger.external,
        "energy_error": sample.energy_error,
        "broken_bars": sample.broken_bars,
    }
    return {name: _plain(value) for name, value in values.items()}


def _plain(value: float | int | None) -> float | int | None:
    """The value; 0 for the negative zero of a force whose sign was changed."""
    return 0.0 if isinstance(value, float) and value == 0 else value


def _newtons(force: float) -> str:
    """A force to a tenth, without the sign of a zero."""
    return f"{round(force, 1) + 0.0:7.1f}"


class FieldOutput:
    """Writes fields at the first sample that reaches each of the scene's times, and broken bars.

    Broken bars are kept until the next fields or the next checkpoint: a file that is not open
    between two writes is dear to open at every sample.

    Args:
        resumed: go on with the fields of an earlier process.
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
                self._forget_until(resumed.history[-1]["time_s"])
        told = {key: _text(value) for key, value in provenance(scene).items()}
        old = None if resumed is None else self.written
        self.writer = FieldWriter(folder.fields_file, points, cells, old, told)

    @property
    def bytes_per_time(self) -> int:
        """Uncompressed size of the fields at one time, bytes."""
        return 4 * (6 * len(self.at[0]) + int(self.module.sum()))

    def take(self, sample: "Sample") -> None:
        """Write what is due at a sample; the step after it has been taken already."""
        if self.damage and sample.broken_bars > self.broken:
            sites, bars = self.simulation.dynamics.new_broken()
            place = self.simulation.dynamics.lattice.bar_midpoints(sites, bars)
            self.pending.append((np.full(len(bars), sample.time), place, bars))
            self.broken = sample.broken_bars
        if self._forget_until(sample.time):
            self.write(sample.time)

    def _forget_until(self, time_s: float) -> bool:
        """Drop the times that a sample has reached; whether there were any."""
        before = len(self.due)
        slack = 0.5 * self.simulation.time_step
        self.due = [t for t in self.due if t > time_s + slack]
        return len(self.due) < before

    def flush(self) -> None:
        """Write the broken bars that wait."""
        if self.pending:
            times, places, bars = (np.concatenate(part) for part in zip(*self.pending, strict=True))
            self.writer.append_broken(times, places, bars)
            self.written = (self.written[0], self.written[1] + len(bars))
            self.pending = []

    def write(self, at: float) -> None:
        """Write the fields of the last sampled step."""
        self.flush()
        s = self.simulation
        displacement = s.displacement_before()[0][self.at]
        velocity = s.dynamics.get_velocity()[0][self.at]
        fraction = np.zeros(int(self.module.sum()))
        if self.damage:
            fraction = s.broken_fraction()[self.module]
        self.writer.append(at, displacement, velocity, fraction)
        self.written = (self.written[0] + 1, self.written[1])


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


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
        observe: looks at the simulation at every sample, just after that step was taken. With one
            of the two a run has no checkpoints: what it knows beyond them would be lost.

    Returns:
        0; 3 where the guard stopped the run; 4 where a file could no longer be written; 130 after
        Ctrl-C and 143 after SIGTERM. What was computed until then is kept, ``resume`` goes on from
        the last checkpoint, and only a finished run has a summary.json.

    Raises:
        SceneError: the scene or the folder is refused; nothing has been written then.
    """
    console = _console(quiet)
    RunFolder.check(out, force=force)
    started = time.perf_counter()
    simulation = _build(scene)
    if prepare is not None:
        prepare(simulation)
    expected = simulation.measure_step() * simulation.steps
    compiled = time.perf_counter() - started
    with RunFolder.held(out):
        folder = RunFolder.create(out, force=force)
        folder.write_scene(scene_to_toml(scene))
        folder.write_provenance(provenance(scene))
        work = _Work(folder, simulation)
        if prepare is not None or observe is not None:
            work.interval, work.checkpoints = 0.0, None
        work.observe = observe
        _announce(console, simulation, expected, work.fields)
        return _work_off(console, work, summary, compiled)


def resume(out: Path, summary: Summary, *, extend: float = 0.0, quiet: bool = False) -> int:
    """Go on with a run from its last good checkpoint; returns what ``run`` does.

    Args:
        extend: seconds of simulation to run on past the scene's end.

    Raises:
        SceneError: there is no run, or no checkpoint of it that can be used.
    """
    from taichi_ldem.storage.checkpoint import Checkpoints

    console = _console(quiet)
    folder = RunFolder(out)
    scene = load_scene(folder.scene_file)
    if folder.summary_file.is_file() and not extend:
        console.print(f"{out} holds a finished run; --extend SECONDS runs on past its end")
        return 0
    if extend:
        scene = _extended(scene, extend)
    with RunFolder.held(out):
        found = Checkpoints(out).usable(scene)
        latest = next(found, None)
        if latest is None:  # told before Taichi is started
            raise SceneError(f"'{out}' has no checkpoint that can be resumed; run its scene again")
        started = time.perf_counter()
        simulation = _build(scene)
        work = _restored(folder, simulation, itertools.chain([latest], found))
        if extend:
            folder.summary_file.unlink(missing_ok=True)  # first: the run is no longer finished
            folder.write_scene(scene_to_toml(scene))
        told = provenance(scene)
        changed = changed_machine((folder.processes() or [None])[-1], told)
        if changed is not None:
            print(
                f"warning: the run was begun elsewhere ({changed}): it goes on, but not as to the "
                "last bit it would have there",
                file=sys.stderr,
            )
        folder.write_provenance(told | {"resumed_at_s": simulation.time})
        console.print(f"resumed at t = {simulation.time:.6g} s, step {simulation.step_number}")
        return _work_off(console, work, summary, time.perf_counter() - started)


def _console(quiet: bool) -> Console:
    return Console(quiet=quiet, highlight=False, markup=False, soft_wrap=True)


def _build(scene: Scene) -> "Simulation":
    refuse_too_large(scene)
    backend.start(scene.solver)
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(scene)
    simulation.compile()
    return simulation


def _extended(scene: Scene, by: float) -> Scene:
    """The scene with a later end; SceneError where that is none."""
    data = scene.model_dump(by_alias=True, exclude_none=True)
    data["solver"]["duration"] += by
    if not by > 0:
        raise SceneError(f"--extend {by}: must be a number of seconds above 0")
    return parse_scene(data, "--extend")


def _restored(
    folder: RunFolder, simulation: "Simulation", found: "Iterable[tuple[str, Checkpoint]]"
) -> "_Work":
    """The work of the latest checkpoint that fits; SceneError where none does."""
    for name, checkpoint in found:
        try:
            simulation.restore_state(checkpoint.state)
            if simulation.step_number > simulation.steps + 1:
                raise SceneError(
                    f"lies behind solver.duration = {simulation.scene.solver.duration}"
                )
            return _Work(folder, simulation, checkpoint, name)
        except ValueError as error:  # a SceneError of the fields' file is one, too
            print(f"refused: {folder.path / name}: {error}", file=sys.stderr)
    raise SceneError(f"'{folder.path}' has no checkpoint that can be resumed; run its scene again")


class _Signalled(Exception):
    """SIGINT or SIGTERM came; ``args[0]`` is its number."""


class _Work:
    """A simulation, its files, and when they are written.

    Args:
        resumed: the checkpoint that the simulation has been restored from; name: its file.

    Attributes:
        history: the rows so far. wall: seconds of stepping by earlier processes.
    """

    def __init__(
        self,
        folder: RunFolder,
        simulation: "Simulation",
        resumed: "Checkpoint | None" = None,
        name: str | None = None,
    ):
        self.folder, self.simulation = folder, simulation
        self.names = columns(simulation.scene)
        self.history: History = [] if resumed is None else [dict(row) for row in resumed.history]
        self.wall = 0.0 if resumed is None else resumed.wall
        self.fields = FieldOutput(folder, simulation, resumed)
        rows = [[row[name] for name in self.names] for row in self.history]
        self.writer = HistoryWriter(folder.history_file, self.names, rows)
        self.interval = simulation.scene.output.checkpoint_interval
        self.begun = self.saved = time.monotonic()
        self.signal: int | None = None
        self.observe: Callable[[Simulation, Sample], None] | None = None
        self.checkpoints = None
        if self.interval:
            from taichi_ldem.storage.checkpoint import Checkpoints

            self.checkpoints = Checkpoints(folder.path, name)

    def add(self, sample: "Sample") -> None:
        """Write a sample."""
        values = row(sample)
        self.writer.append([values[name] for name in self.names])  # type: ignore[misc]
        self.history.append(values | {"energy_error_of_plate": sample.energy_error_of_plate})
        self.fields.take(sample)
        if self.observe is not None:
            self.observe(self.simulation, sample)

    def between(self) -> None:
        """Between two steps: stop on a signal, take a checkpoint when it is due."""
        if self.signal is not None:
            raise _Signalled(self.signal)
        if self.interval and time.monotonic() - self.saved >= self.interval:
            self.save()

    def stepped(self) -> float:
        """Seconds of stepping so far, those of earlier processes too."""
        return self.wall + time.monotonic() - self.begun

    def save(self) -> None:
        """Put everything on the disk, the checkpoint last: it tells how much there is."""
        self.fields.flush()
        if self.checkpoints is None:
            return
        from taichi_ldem.storage.checkpoint import Checkpoint

        self.writer.sync()
        s = self.simulation
        state = s.saved_state()
        self.checkpoints.write(
            Checkpoint(s.scene, state, self.history, s.time, self.stepped(), *self.fields.written)
        )
        self.saved = time.monotonic()

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Note SIGINT and SIGTERM for ``between``; a second SIGINT interrupts at once."""

        def note(number: int, _frame: Any) -> None:
            self.signal = number
            signal.signal(signal.SIGINT, signal.default_int_handler)

        if threading.current_thread() is not threading.main_thread():
            yield
            return
        old = {n: signal.signal(n, note) for n in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in old.items():
                signal.signal(number, handler)


def _work_off(console: Console, work: _Work, summary: Summary, compiled: float) -> int:
    """Step to the end, whatever comes between, and tell how it went; the exit code."""
    folder = work.folder
    code = 0
    try:
        with work.writer:
            code = _step_or_stop(console, work)
        wall = work.stepped()
        if code == 0:
            _finish(work, summary, wall, compiled)
        scene = work.simulation.scene
        if code != TERMINATED:
            _pictures(console, folder, scene, code)
    except OSError as error:
        _tell_unwritable(work, error)
        return UNWRITABLE
    console.print(f"{wall:.1f} s of stepping, {compiled:.1f} s of setup; results in {folder.path}")
    return code


def _step_or_stop(console: Console, work: _Work) -> int:
    from taichi_ldem.errors import SimulationStopped, TooManyNodes

    try:
        with work.listening():
            try:
                _step_through(console, work)
            except _Signalled as error:
                work.save()
                return _tell_signal(work, int(error.args[0]))
            work.save()
    except KeyboardInterrupt:
        return _tell_signal(work, signal.SIGINT)
    except (SimulationStopped, TooManyNodes) as error:
        work.fields.flush()
        print(f"stopped: {error}", file=sys.stderr)
        return STOPPED
    return 0


def _tell_signal(work: _Work, number: int) -> int:
    word, code = ("interrupted", INTERRUPTED)
    if number == signal.SIGTERM:
        word, code = ("terminated", TERMINATED)
    kept = work.folder.path
    line = f"{word} at t = {work.simulation.time:.6g} s; kept in {kept}"
    if work.checkpoints is not None:
        line += f"; `ldem resume {kept}` goes on"
    print(line, file=sys.stderr)
    return code


def _tell_unwritable(work: _Work, error: OSError) -> None:
    from taichi_ldem.storage.checkpoint import LATEST, PREVIOUS

    path = work.folder.path
    line = f"error: {error}; stopped at t = {work.simulation.time:.6g} s"
    if (path / LATEST).is_file() or (path / PREVIOUS).is_file():
        line += f"; make room, then `ldem resume {path}` goes on from the last checkpoint"
    else:
        line += "; there is no checkpoint to go on from"
    print(line, file=sys.stderr)


def _finish(work: _Work, summary: Summary, wall: float, compiled: float) -> None:
    """Write the numbers of a finished run."""
    scene, history = work.simulation.scene, work.history
    for body in bodies_of(scene):
        for line in body.warnings(history):
            print(f"warning: {line}", file=sys.stderr)
    numbers = summary(work.simulation, history)
    numbers |= cost(work.simulation, history, wall, compiled)
    work.folder.write_summary(numbers | {"provenance": provenance(scene)})


def _announce(
    console: Console, simulation: "Simulation", expected: float, fields: FieldOutput
) -> None:
    scene = simulation.scene
    lattice = simulation.dynamics.lattice
    for name, value in implied(scene).items():
        console.print(f"{name:36s}{value}")
    for line in warnings(scene, simulation.steps):
        console.print(f"note: {line}")
    samples = simulation.steps // simulation.sample_every + 1
    disk = 250 * samples + fields.bytes_per_time * len(scene.field_times)
    console.print(
        f"{lattice.bars:,} bars, {lattice.nodes:,} nodes; {simulation.steps:,} steps of "
        f"{simulation.time_step:.4g} s (critical {simulation.critical_time_step:.4g} s); about "
        f"{expected:.0f} s to compute, {disk / 1e6:.0f} MB on disk at most"
    )


def _step_through(console: Console, work: _Work) -> None:
    from taichi_ldem.solver.guard import WARN_ERROR

    warned = False
    with _progress(console, work.simulation) as tell:
        for sample in work.simulation.samples(work.between):
            work.add(sample)
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
    begun, first = time.perf_counter(), simulation.step_number

    shown = [body.force for body in bodies_of(simulation.scene) if body.force is not None]

    def text(sample: "Sample") -> str:
        given = sample.observed[shown[-1]] if shown else None
        force = "" if given is None else f"  F {_newtons(given)} N"
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
            left = gone * (simulation.steps - sample.step) / max(sample.step - first, 1)
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
        "peak_memory_bytes": peak_bytes(),
    }


def _pictures(console: Console, folder: RunFolder, scene: Scene, code: int) -> None:
    from taichi_ldem.output.figures.run import plot_run

    figures = plot_run(folder)
    if code != INTERRUPTED and scene.pulse is None:  # a pulse is too small to be seen
        from taichi_ldem.output.render.snapshots import render_run

        figures += render_run(folder, None)
    for figure in figures:
        console.print(f"wrote {figure}")
