"""From a scene to a run folder: the run of every scenario that steps in time.

A scenario adds its numbers (``summary``) to those of the run. Files, progress, warnings and the
guard are the same for all of them; figures are drawn by a function that the caller passes on.

A run can be stopped at any moment and resumed. Checkpoints are written between two steps: on the
scene's interval of wall time, on SIGINT, SIGTERM and SIGHUP, and at the end.
"""

import contextlib
import itertools
import shlex
import signal
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from taichi_ldem.errors import ExitCode, SceneError, SimulationStopped, TooManyNodes
from taichi_ldem.scenarios.drawing import Draw
from taichi_ldem.scenarios.field_output import FieldOutput
from taichi_ldem.scenarios.interrupts import WORDS, Interrupts, Signalled
from taichi_ldem.scenarios.progress import announce, make_console, progress
from taichi_ldem.scenarios.registry import entry_of
from taichi_ldem.scenarios.workbench import WORKBENCH
from taichi_ldem.scene import Scene, parse_scene
from taichi_ldem.solver.contact import HELD, bodies_of, contacts_of, observables
from taichi_ldem.solver.memory import peak_bytes
from taichi_ldem.storage import plate_shape
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter
from taichi_ldem.storage.place import unlink
from taichi_ldem.storage.provenance import changed_machine, provenance

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation
    from taichi_ldem.storage.checkpoint import Checkpoint


def columns(scene: Scene) -> list[str]:
    """Names of the history's columns, which depend on the features that the scene names."""
    present = contacts_of(scene)
    own = [observable for body in present for observable in body.observables_in(scene)]
    names = {
        "time_s": True,
        **{o.column: True for o in own if not o.energy},
        **{column: True for probe in scene.probes for column in probe.columns},
        "kinetic_plate_j": True,
        **{o.column: True for o in own if o.energy},
        "strain_j": True,
        "fracture_j": scene.material.damage,
        "damping_j": scene.solver.damping > 0,
        "notch_j": any(notch.time for notch in scene.notch),
        "contact_j": any(body.dissipates for body in present),
        HELD.column: scene.lands_elastically,
        "external_j": scene.plate.falls or any(body.works(scene) for body in present),
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
        "notch_j": ledger.opened,
        "contact_j": ledger.contact,
        HELD.column: observed.get(HELD.column, 0.0),
        "external_j": ledger.external,
        "energy_error": sample.energy_error,
        "broken_bars": sample.broken_bars,
        **observed,
    }
    return {name: _plain(value) for name, value in values.items()}


def _plain(value: float | int | None) -> float | int | None:
    """The value; 0.0 for a negative zero, which comes from a change of sign."""
    return 0.0 if isinstance(value, float) and value == 0 else value


History = list[dict[str, Any]]
"""Rows of the history: its columns' names and values, and ``energy_error_of_plate``."""

Summary = Callable[["Simulation", History, RunFolder], dict[str, Any]]
"""A scenario's own numbers of a finished run, for ``summary.json``."""


@dataclass(frozen=True)
class Instrument:
    """Actions of a run that its scene does not describe. Such a run has no checkpoints.

    Attributes:
        prepare: changes the simulation before its first step.
        observe: is called with every sample, just after the sampled step has been completed.
    """

    prepare: "Callable[[Simulation], None] | None" = None
    observe: "Callable[[Simulation, Sample], None] | None" = None


def run(
    scene: Scene,
    out: Path,
    summary: Summary,
    *,
    force: bool = False,
    quiet: bool = False,
    draw: Draw | None = None,
    instrument: Instrument | None = None,
) -> int:
    """Run a scene into a folder.

    Args:
        force: replace the run that the folder holds.
        quiet: print nothing on success.
        draw: draws figures and pictures at the end; None: no figures.
        instrument: its state is in no checkpoint, so a run with one takes none.

    Returns:
        DONE, STOPPED (by the guard), UNWRITABLE, INTERRUPTED (Ctrl-C), TERMINATED (SIGTERM) or
        HUNG_UP (SIGHUP) of ``ExitCode``. What has been computed is kept, ``resume`` continues from
        the last checkpoint, and only a finished run has a summary.json.

    Raises:
        SceneError: the scene or the folder is refused; nothing has been written then.
    """
    console = make_console(quiet)
    files = entry_of(scene).writes
    RunFolder.check(out, force=force, files=files)
    started, body = time.perf_counter(), plate_shape.read(scene)
    simulation = WORKBENCH.build(scene)
    if instrument is not None and instrument.prepare is not None:
        instrument.prepare(simulation)
    expected = simulation.measure_step() * simulation.steps
    compiled = time.perf_counter() - started
    with RunFolder.held(out):
        folder = RunFolder.create(out, force=force, files=files)
        folder.write_provenance(provenance(scene))
        plate_shape.write_scene(folder, scene, body)
        recorder = Recorder(folder, simulation, instrument=instrument)
        announce(console, simulation, expected, recorder.fields.bytes_per_frame)
        return _complete(console, recorder, summary, compiled, draw)


def resume(
    out: Path,
    summary: Summary,
    *,
    scene: Scene | None = None,
    extend: float = 0.0,
    quiet: bool = False,
    draw: Draw | None = None,
) -> int:
    """Resume a run from its last good checkpoint; the exit codes are those of ``run``.

    Args:
        scene: what is run, equal to the folder's but for keys without effect; None: the folder's.
        extend: simulated time to add after the scene's end, s.

    Raises:
        SceneError: there is no run, or no checkpoint of it that can be used.
    """
    from taichi_ldem.storage.checkpoint import Checkpoints

    console = make_console(quiet)
    folder = RunFolder(out)
    scene = folder.read_scene() if scene is None else scene
    if folder.summary_file.is_file() and not extend:
        console.print(f"{out} holds a finished run; --extend SECONDS runs on past its end")
        return ExitCode.DONE
    if extend:
        scene = _extended(scene, extend)
    with RunFolder.held(out):
        found = Checkpoints(out).usable(scene)
        latest = next(found, None)
        if latest is None:  # refused before Taichi is started
            raise SceneError(f"'{out}' has no checkpoint that can be resumed; run its scene again")
        folder.processes()  # so is a record of them that is damaged
        started = time.perf_counter()
        simulation = WORKBENCH.build(scene)
        folder = folder.now()
        recorder = _restored(folder, simulation, itertools.chain([latest], found))
        if extend:
            unlink(folder.summary_file)  # from here on the run is not finished
            plate_shape.write_scene(folder, scene)
        _note_origin(folder, simulation)
        console.print(f"resumed at t = {simulation.time:.6g} s, step {simulation.step_number}")
        compiled = time.perf_counter() - started
        return _complete(console, recorder, summary, compiled, draw)


def _note_origin(folder: RunFolder, simulation: "Simulation") -> None:
    """Record where a run is resumed, with a warning where another machine began it."""
    here = provenance(simulation.scene)
    changed = changed_machine((folder.processes() or [None])[-1], here)
    if changed is not None:
        print(
            f"warning: the run began on another machine or version ({changed}): it continues, but "
            "its last digits may differ",
            file=sys.stderr,
        )
    folder.write_provenance(here | {"resumed_at_s": simulation.time})


def _extended(scene: Scene, by: float) -> Scene:
    """The scene with a later end.

    Raises:
        SceneError: the time to add is not a positive number.
    """
    data = scene.model_dump(by_alias=True, exclude_none=True)
    data["solver"]["duration"] += by
    if not by > 0:
        raise SceneError(f"--extend {by}: must be a number of seconds above 0")
    return parse_scene(data, "--extend")


def _restored(
    folder: RunFolder, simulation: "Simulation", found: "Iterable[tuple[str, Checkpoint]]"
) -> "Recorder":
    """The recorder of a run put back to its latest checkpoint that fits.

    Raises:
        SceneError: none of the checkpoints fits.
    """
    for name, checkpoint in found:
        try:
            simulation.restore_state(checkpoint.state)
            if simulation.step_number > simulation.steps + 1:
                raise SceneError(
                    f"is later than solver.duration = {simulation.scene.solver.duration}"
                )
            return Recorder(folder, simulation, checkpoint, name)
        except ValueError as error:  # includes a SceneError of the fields' file
            print(f"refused: {folder.path / name}: {error}", file=sys.stderr)
    raise SceneError(f"'{folder.path}' has no checkpoint that can be resumed; run its scene again")


class Recorder:
    """Writes a simulation's history, fields and checkpoints.

    Args:
        resumed: the checkpoint that the simulation has been restored from.
        name: the file name of that checkpoint.

    Attributes:
        history: the rows so far.
        stepped_before: time that earlier processes spent on stepping, s.
    """

    def __init__(
        self,
        folder: RunFolder,
        simulation: "Simulation",
        resumed: "Checkpoint | None" = None,
        name: str | None = None,
        instrument: Instrument | None = None,
    ):
        self.folder, self.simulation = folder, simulation
        self.names = columns(simulation.scene)
        self.history: History = [] if resumed is None else [dict(row) for row in resumed.history]
        self.stepped_before = 0.0 if resumed is None else resumed.wall
        self.fields = FieldOutput(folder, simulation, resumed)
        rows = [[row[name] for name in self.names] for row in self.history]
        self.writer = HistoryWriter(folder.history_file, self.names, rows)
        self.observe = None if instrument is None else instrument.observe
        self.interval = 0.0 if instrument else simulation.scene.output.checkpoint_interval
        self.begun = self.saved = time.monotonic()
        self.interrupts = Interrupts()
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

    def between_steps(self) -> None:
        """Stop on a signal (``Signalled``), and write a checkpoint where one is due."""
        self.interrupts.answer()
        if self.interval and time.monotonic() - self.saved >= self.interval:
            self.save()

    def stepping_time(self) -> float:
        """Time spent on stepping so far, earlier processes included, s."""
        return self.stepped_before + time.monotonic() - self.begun

    def save(self) -> None:
        """Write everything to disk, the checkpoint last, which records the lengths of the files."""
        self.fields.flush()
        if self.checkpoints is None:
            return
        from taichi_ldem.storage.checkpoint import Checkpoint

        self.writer.sync()
        s = self.simulation
        seconds, written = self.stepping_time(), self.fields.written
        self.checkpoints.write(
            Checkpoint(s.scene, s.saved_state(), self.history, s.time, seconds, *written)
        )
        self.saved = time.monotonic()


def _complete(
    console: Console, recorder: Recorder, summary: Summary, compiled: float, draw: Draw | None
) -> int:
    """Step to the end, write the summary, draw, and report how the run ended; the exit code."""
    code = ExitCode.DONE
    try:
        with recorder.writer:
            code = _step_or_stop(console, recorder)
        seconds = recorder.stepping_time()
        folder = recorder.folder = recorder.folder.now()
        if code == ExitCode.DONE:
            _write_summary(recorder, summary, seconds, compiled)
        if code not in AT_ONCE and draw is not None:
            whole = code != ExitCode.INTERRUPTED
            pictures = whole and entry_of(recorder.simulation.scene).pictures
            for file in draw(folder, pictures=pictures):
                console.print(f"wrote {file}")
    except OSError as error:
        _report_unwritable(recorder, error)
        return ExitCode.UNWRITABLE
    console.print(
        f"{seconds:.1f} s of stepping, {compiled:.1f} s of setup; results in {folder.path}"
    )
    return code


def _step_or_stop(console: Console, recorder: Recorder) -> ExitCode:
    try:
        with recorder.interrupts.noted():
            try:
                _step_through(console, recorder)
            except Signalled as signalled:
                recorder.save()
                return _report_signal(recorder, signalled.number)
            recorder.save()
    except KeyboardInterrupt:
        return _report_signal(recorder, signal.SIGINT)
    except (SimulationStopped, TooManyNodes) as error:
        recorder.fields.flush()
        print(f"stopped: {error}", file=sys.stderr)
        return ExitCode.STOPPED
    return ExitCode.DONE


def _step_through(console: Console, recorder: Recorder) -> None:
    from taichi_ldem.solver.guard import WARN_ERROR

    warned = False
    with progress(console, recorder.simulation) as show:
        for sample in recorder.simulation.samples(recorder.between_steps):
            recorder.add(sample)
            show(sample)
            worst = max(sample.energy_error, sample.energy_error_of_plate)
            if worst > WARN_ERROR and not warned:
                warned = True
                text = f"warning: energy error {100 * worst:.1f} % of what the plate was given"
                print(f"{text} at t = {sample.time:.6g} s; see solver.safety", file=sys.stderr)


AT_ONCE = (ExitCode.TERMINATED, ExitCode.HUNG_UP)
"""Ends after which nothing is drawn: whoever sent the signal kills after a grace period."""


def _report_signal(recorder: Recorder, number: int) -> ExitCode:
    code = ExitCode(128 + number)
    word = WORDS[code]
    kept = recorder.folder.now().path
    line = f"{word} at t = {recorder.simulation.time:.6g} s; kept in {kept}"
    if recorder.checkpoints is not None:
        line += f"; `ldem resume {shlex.quote(str(kept))}` goes on"
    print(line, file=sys.stderr)
    return code


def _report_unwritable(recorder: Recorder, error: OSError) -> None:
    with contextlib.suppress(OSError):  # where it is gone the error says so
        recorder.folder = recorder.folder.now()
    path = recorder.folder.path
    line = f"error: {error}; stopped at t = {recorder.simulation.time:.6g} s"
    if recorder.folder.has_checkpoint:
        again = f"ldem resume {shlex.quote(str(path))}"
        line += f"; make room, then `{again}` goes on from the last checkpoint"
    else:
        line += "; there is no checkpoint to go on from"
    print(line, file=sys.stderr)


def _write_summary(recorder: Recorder, summary: Summary, seconds: float, compiled: float) -> None:
    """Write the numbers of a finished run."""
    scene, history = recorder.simulation.scene, recorder.history
    for body in bodies_of(scene):
        for line in body.warnings(scene, history):
            print(f"warning: {line}", file=sys.stderr)
    numbers = summary(recorder.simulation, history, recorder.folder)
    numbers |= recorder.fields.summary()
    numbers |= cost(recorder.simulation, history, seconds, compiled)
    recorder.folder.write_summary(numbers | {"provenance": provenance(scene)})


def cost(
    simulation: "Simulation", history: History, wall: float, compiled: float
) -> dict[str, Any]:
    """The numbers of every finished run: energy balance, steps and time.

    Args:
        wall: time spent on stepping, s.
        compiled: time spent on building and compiling before, s.
    """
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
