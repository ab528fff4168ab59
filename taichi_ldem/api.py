"""The Python interface: a scene, a simulation to step and look at, a run into a folder.

    from taichi_ldem import Scene, Simulation

    scene = Scene.load("configs/impact_quick.toml", "striker.velocity=2.0")
    with Simulation(scene) as simulation:
        history = simulation.run(until=1e-3)
        deflection = -simulation.displacement[:, 2].min()

The class wraps the engine, ``taichi_ldem.solver.simulation.Simulation``: it starts Taichi, returns
plain arrays of the nodes that exist, and gives the memory back at the end.
"""

from __future__ import annotations

import gc
import math
import operator
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.registry import entry_of
from taichi_ldem.scene import Scene, load_scene, parse_scene
from taichi_ldem.solver import backend
from taichi_ldem.solver.memory import refuse_too_large
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.streams import courteous

if TYPE_CHECKING:
    from taichi_ldem.analysis.fragments import Pieces
    from taichi_ldem.solver.simulation import Sample
    from taichi_ldem.solver.simulation import Simulation as Engine

FloatArray = NDArray[np.float64]

_TAICHI = threading.RLock()
"""Held while Taichi works for a simulation: it has one state a process, and no locks of its own."""


@contextmanager
def _alone() -> Iterator[None]:
    """Keep other threads from Taichi; the same thread may enter again, as callbacks do.

    Raises:
        RuntimeError: another thread is using it.
    """
    if not _TAICHI.acquire(blocking=False):
        raise RuntimeError(
            "another thread is using a simulation, and Taichi has one state a process: let one "
            "thread work at a time, or give each simulation a process of its own"
        )
    try:
        yield
    finally:
        _TAICHI.release()


@dataclass(frozen=True)
class BrokenBars:
    """Bars that have failed, each listed once.

    Attributes:
        position: (n, 3) mid-points at rest, m.
        bar: (n,) its number at its site, see ``taichi_ldem.model.cell``.
    """

    position: FloatArray
    bar: NDArray[np.int64]


class Simulation:
    """A scene that is stepped from Python.

    Taichi has one state per process. A new simulation therefore starts Taichi afresh, which frees
    the memory of earlier simulations and closes them: using one afterwards raises RuntimeError.
    ``beside=True`` keeps the earlier ones open. Precision, arch and threads must then be equal to
    theirs, and memory is freed by the next simulation without ``beside``. Arrays taken from a
    simulation are copies and remain valid.

    One thread works with simulations at a time; another one is refused meanwhile. A simulation that
    a thread has left open is closed from that thread only, as long as the thread lives.

    Args:
        scene: a scene, its tables as a mapping, or a scene file.
        beside: keep the open simulations open.

    Raises:
        SceneError: the scene cannot be run; the message is one line.
        RuntimeError: another thread is using a simulation, or has left one open.
    """

    _open: ClassVar[weakref.WeakSet[Simulation]] = weakref.WeakSet()
    _running: ClassVar[tuple[object, ...] | None] = None  # what Taichi was started with

    def __init__(self, scene: Scene | Mapping[str, Any] | str | Path, *, beside: bool = False):
        self._engine: Engine | None = None
        self.scene = as_scene(scene)
        if not entry_of(self.scene).resumable:
            raise SceneError(
                f'scenario = "{self.scene.scenario}": does not start from rest; use '
                "taichi_ldem.run(scene, folder)"
            )
        refuse_too_large(self.scene)
        with _alone():
            self._build(beside)

    def _build(self, beside: bool) -> None:
        solver = self.scene.solver
        wanted = (solver.arch, solver.precision, solver.threads)
        if beside and Simulation._open:
            if wanted != Simulation._running:
                raise SceneError(
                    "solver: arch, precision and threads must be those of the simulation "
                    "that stays open"
                )
        else:
            _refuse_other_threads()
            close_all()
            backend.start(solver)
            Simulation._running = wanted
        # not at the top: it has kernels, and Taichi must have been started
        engine = import_module("taichi_ldem.solver.simulation")
        self._engine = engine.Simulation(self.scene)
        self._thread = threading.current_thread()
        Simulation._open.add(self)
        self._callbacks: list[Callable[[Simulation, Sample], object]] = []
        self._stopped = False
        self._samples: list[Sample] = []
        lattice = self._engine.dynamics.lattice
        self._exists = lattice.exists()
        self._places = lattice.positions()[self._exists]

    # -- stepping --

    @property
    def engine(self) -> Engine:
        """The ``taichi_ldem.solver.simulation.Simulation`` itself, for what this class lacks.

        Raises:
            RuntimeError: the simulation is closed.
        """
        if self._engine is None:
            raise RuntimeError(
                "this simulation is closed (a later one was started without beside=True, or "
                "close() was called); arrays and histories taken before remain valid"
            )
        return self._engine

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.engine.time

    @property
    def time_step(self) -> float:
        """Time step, s."""
        return self.engine.time_step

    @property
    def finished(self) -> bool:
        """Whether the scene's end has been reached."""
        return self.engine.step_number > self.engine.steps

    def step(self, count: int = 1) -> None:
        """Take a number of time steps without measuring energies or forces."""
        if operator.index(count) < 0:
            raise ValueError(f"count = {count}: must not be negative")
        with _alone():
            self.engine.advance(operator.index(count))

    def sample(self) -> Sample:
        """Take one step, measure energies and forces at its start, and add them to the history.

        A force is the impulse since the last sample over the time since then.
        """
        with _alone():
            sample = self.engine.sample_step()
            self._take(sample)
        return sample

    def _take(self, sample: Sample) -> None:
        self._samples.append(sample)
        for callback in list(self._callbacks):
            callback(self, sample)

    def run(self, until: float | None = None) -> dict[str, FloatArray]:
        """Step until a time, with a sample each ``output.history_interval``; return the history.

        A later call continues from there.

        Args:
            until: time at which to stop, s; None: the scene's end. Where it has passed, nothing is
                done.

        Raises:
            ValueError: ``until`` is not a number.
            SimulationStopped: the state is not finite, or the energy error is above 5 %.
        """
        end = math.inf if until is None else float(until)
        if math.isnan(end):
            raise ValueError(f"until = {until}: must be a time in seconds")
        engine = self.engine
        half = 0.5 * engine.time_step
        with _alone():
            self._stopped = False
            for sample in engine.samples() if engine.time <= end + half else ():
                self._take(sample)
                if sample.time >= end - half or self._stopped:
                    engine.guard(sample)
                    break
        return self.history

    def on_sample(
        self, callback: Callable[[Simulation, Sample], object]
    ) -> Callable[[Simulation, Sample], object]:
        """Call a function with the simulation and each sample; also works as a decorator."""
        self._callbacks.append(callback)
        return callback

    def stop(self) -> None:
        """From a callback: end ``run`` after this sample."""
        self._stopped = True

    # -- reading --

    @property
    def samples(self) -> list[Sample]:
        """The samples so far."""
        return list(self._samples)

    @property
    def history(self) -> dict[str, FloatArray]:
        """The samples so far as columns, (n,) each, under the names of ``history.csv``."""
        from taichi_ldem.scenarios.runner import columns, row

        rows = [row(sample) for sample in self._samples]
        return {
            name: np.array([r[name] for r in rows], dtype=float) for name in columns(self.scene)
        }

    @property
    def positions(self) -> FloatArray:
        """(n, 3) nodes at rest, m: corner nodes first, then those at the modules' centres."""
        return self._places.copy()

    @property
    def masses(self) -> FloatArray:
        """(n,) masses of the nodes, kg, in the order of ``positions``."""
        with _alone():
            return np.asarray(self.engine.dynamics.masses()[self._exists])

    @property
    def displacement(self) -> FloatArray:
        """(n, 3) displacement of the nodes at ``time``, m."""
        with _alone():
            return np.asarray(self.engine.displacement()[self._exists])

    @property
    def velocity(self) -> FloatArray:
        """(n, 3) velocity of the nodes half a step before ``time``, m/s."""
        with _alone():
            return np.asarray(self.engine.dynamics.get_velocity()[self._exists])

    @property
    def broken_fraction(self) -> FloatArray:
        """(nz, ny, nx) share of each module's twenty bars that have failed; 0 without damage.

        It is up to date at every step, not only at samples.
        """
        engine = self.engine
        if not self.scene.material.damage:
            return np.zeros(engine.dynamics.lattice.mask.shape)
        with _alone():
            self._note_broken()
            return engine.broken_fraction()

    @property
    def broken_bars(self) -> BrokenBars:
        """All bars that have failed so far."""
        engine = self.engine
        lattice = engine.dynamics.lattice
        if not self.scene.material.damage:
            return BrokenBars(np.zeros((0, 3)), np.zeros(0, dtype=np.int64))
        with _alone():
            self._note_broken()
            recorded = engine.dynamics.recorded_bits()
        found = [np.argwhere(recorded >> bar & 1) for bar in range(14)]
        bar = np.repeat(np.arange(14), [len(sites) for sites in found])
        return BrokenBars(lattice.bar_midpoints(np.concatenate(found), bar), bar)

    @property
    def fragments(self) -> Pieces:
        """The pieces into which the plate has broken, and debris: masses, motion and sizes."""
        from taichi_ldem.scenarios.fragment_output import count

        engine = self.engine
        with _alone():
            if self.scene.material.damage:
                self._note_broken()
            return count(engine, engine.displacement())[1]

    def _note_broken(self) -> None:
        self.engine.dynamics.new_broken()

    # -- ending --

    def close(self) -> None:
        """Close the simulation; memory is freed when no other one is open. It may be repeated."""
        if self._engine is None:
            return
        with _alone():
            self._engine = None
            Simulation._open.discard(self)
            if not Simulation._open:
                _reset()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        if self._engine is None:
            return f"<Simulation of {self.scene.scenario}, closed>"
        nodes, bars = len(self._places), self._engine.dynamics.lattice.bars
        return (
            f"<Simulation of {self.scene.scenario}: {nodes:,} nodes, {bars:,} bars, "
            f"t = {self.time:.4g} of {self.scene.solver.duration:.4g} s>"
        )


def as_scene(scene: Scene | Mapping[str, Any] | str | Path) -> Scene:
    """A scene from a scene, its tables or its file.

    Raises:
        SceneError: it is not acceptable; the message is one line.
    """
    if isinstance(scene, Scene):
        return scene
    if isinstance(scene, Mapping):
        return parse_scene(scene)
    return load_scene(scene)


def _refuse_other_threads() -> None:
    """Raise RuntimeError where another thread that lives has left a simulation open."""
    for simulation in list(Simulation._open):
        owner = simulation._thread
        if owner is not threading.current_thread() and owner.is_alive():
            raise RuntimeError(
                f"a simulation is open in the thread '{owner.name}', and Taichi has one state a "
                "process: close it there first, or give each simulation a process of its own"
            )


def close_all() -> None:
    """Close every open simulation and free their memory."""
    for simulation in list(Simulation._open):
        simulation._engine = None
    Simulation._open.clear()
    if Simulation._running is not None:
        _reset()


def _reset() -> None:
    import taichi as ti

    Simulation._running = None
    gc.collect()
    ti.reset()


def draw_run(folder: RunFolder, *, pictures: bool, data: Any = None) -> list[Path]:
    """Draw the figures of a run, and pictures of the plate, as scenarios ask for it (``Draw``).

    Matplotlib and the renderer are imported here, when a run has ended.
    """
    from taichi_ldem.scenarios.modes import Shapes

    if isinstance(data, Shapes):
        from taichi_ldem.output.figures.modes import plot_modes

        file = folder.path / "modes.png"
        plot_modes(file, data.modes, data.planes, data.circles)
        return [file]
    from taichi_ldem.output.figures.run import plot_run

    files = plot_run(folder)
    if pictures:
        from taichi_ldem.output.render.snapshots import render_run

        files += render_run(folder, None)
    return files


def run(
    scene: Scene | Mapping[str, Any] | str | Path,
    out: str | Path,
    *,
    force: bool = False,
    quiet: bool = True,
) -> RunFolder:
    """Run a scene into a folder, as the command ``ldem SCENARIO`` does: files, figures, summary.

    Taichi is started afresh, so open simulations are closed.

    Args:
        scene: a scene, its tables as a mapping, or a scene file.
        out: the run folder; must be empty unless ``force``.
        force: replace the run that the folder holds.
        quiet: print nothing on success.

    Raises:
        SceneError: the scene or the folder cannot be used.
        RuntimeError: the run did not finish; its exit code is in the message. Or another thread
            is using a simulation.
    """
    from taichi_ldem.scenarios import launch

    given = as_scene(scene)
    entry = entry_of(given)
    if isinstance(scene, (str, Path)):
        RunFolder.check(Path(out), force=force, files=entry.writes, source=Path(scene))
    with _alone(), courteous():
        _refuse_other_threads()
        close_all()
        code = launch.run(entry, given, Path(out), force=force, quiet=quiet, draw=draw_run)
    if code:
        raise RuntimeError(f"the run in '{out}' ended with exit code {int(code)}")
    return RunFolder(Path(out))


def open_run(folder: str | Path) -> RunFolder:
    """A run folder: ``read_history()``, ``read_summary()`` and the paths of its files.

    Raises:
        SceneError: the folder holds no run.
    """
    return RunFolder.open(Path(folder))
