"""One run of the convergence study in a process of its own: its signals and its cost.

    python -m taichi_ldem.studies.convergence.run SCENE.toml FILE.json [--set KEY=VALUE ...]

The scene's kind decides what is measured (``kind``). Compilation and samples are not timed.
"""

import json
import math
import time
from argparse import ArgumentParser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene, load_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation

Array = npt.NDArray[np.float64]

SEED_REACH = 0.1
"""Largest distance of the striker from the scene's place along x and y, in thicknesses of the
plate, for a cracking scene: half a module where five fill the thickness."""

IMPACT, VIBRATION, WAVE, CRACKING = "impact", "vibration", "wave", "cracking"


def kind(scene: Scene) -> str:
    """The kind of study that a scene is made for.

    Raises:
        SceneError: no kind fits.
    """
    if scene.scenario == "wave":
        return WAVE
    if scene.scenario == "modes" and not scene.material.damage:
        return VIBRATION
    if scene.scenario == "impact" and scene.striker is not None:
        return CRACKING if scene.material.damage else IMPACT
    raise SceneError(
        f'scenario = "{scene.scenario}": a convergence study needs an impact, a vibration '
        '(scenario = "modes", damage = false) or a wave'
    )


def run(scene: Scene, mode: Path | None = None) -> dict[str, Any]:
    """Run a scene that does not crack and return its signals and its cost.

    Args:
        mode: file of a vibration's mode: read where it is there, else computed (in f64) and kept.
    """
    from taichi_ldem.solver import backend

    backend.start(scene.solver)
    from taichi_ldem.solver.simulation import Simulation

    started = time.perf_counter()
    simulation = Simulation(scene)
    _step_exactly(simulation)
    simulation.compile()
    what = kind(scene)
    reader: _Impact | _Vibration | _Wave
    if what == VIBRATION:
        reader = _Vibration(simulation, mode)
    else:
        reader = (_Impact if what == IMPACT else _Wave)(simulation)
    compiled = time.perf_counter() - started
    wall, used, samples = time.perf_counter(), time.process_time(), 0.0
    for sample in simulation.samples():
        before = time.process_time()
        reader.take(sample)
        samples += time.process_time() - before
    used, wall = time.process_time() - used - samples, time.perf_counter() - wall
    return {
        **reader.signals(),
        "cpu_s": used,
        "wall_s": wall,
        "compile_s": compiled,
        "steps": simulation.steps,
        "time_step_s": simulation.time_step,
        "share": simulation.time_step / simulation.critical_time_step,
        "spacing_m": scene.plate.spacing,
        "bars": simulation.dynamics.lattice.bars,
        "energy_error": reader.error,
    }


def _step_exactly(simulation: "Simulation") -> None:
    """Take the scene's share of the critical step as it is, not rounded to history intervals."""
    scene = simulation.scene
    simulation.time_step = scene.solver.safety * simulation.critical_time_step
    simulation.steps = round(scene.solver.duration / simulation.time_step)
    every = round(scene.output.history_interval / simulation.time_step)
    simulation.sample_every = max(1, every)


class _Impact:
    """The striker's velocity, and the impulses of striker and clamp on the plate."""

    def __init__(self, simulation: "Simulation"):
        self.simulation = simulation
        self.error = 0.0
        self.rows: list[tuple[float, ...]] = []

    def take(self, sample: "Sample") -> None:
        """Add a sample."""
        self.error = max(self.error, sample.energy_error)
        observed = sample.observed
        # forces are impulses over the time since the sample before
        since = sample.time - self.rows[-1][0] if self.rows else self.simulation.time_step
        before = self.rows[-1][2:] if self.rows else (0.0, 0.0)
        forces = (observed["striker_force_n"], observed.get("ring_force_n", 0.0))
        impulses = (b + f * since for b, f in zip(before, forces, strict=True))
        self.rows.append((sample.time, observed["striker_velocity_m_s"], *impulses))

    def signals(self) -> dict[str, Any]:
        """Histories by quantity."""
        time_s, velocity, striker, ring = np.array(self.rows).T
        found = {"velocity": velocity, "striker impulse": striker}
        if self.simulation.body("rings") is not None:
            found["ring impulse"] = ring
        return {"time": time_s.tolist(), "signals": {k: v.tolist() for k, v in found.items()}}


class _Vibration:
    """Free vibration in the lowest elastic mode: its frequency from the motion along it."""

    def __init__(self, simulation: "Simulation", mode: Path | None):
        self.simulation = simulation
        self.error = 0.0
        self.rows: list[tuple[float, float]] = []
        if mode is not None and mode.exists():
            with np.load(mode) as kept:
                self.frequency, shape = float(kept["frequency"]), kept["shape"]
        else:
            self.frequency, shape = lowest_elastic_mode(simulation)
            if mode is not None:
                np.savez(mode, frequency=self.frequency, shape=shape)
        mass = simulation.dynamics.masses()[..., None]
        self.weight = mass * shape / float((mass * shape**2).sum())
        # bars rotate by far less than 1e-6, so the lattice is linear
        amplitude = 1e-6 * simulation.spacing
        simulation.start_from(amplitude * shape, np.zeros_like(shape))
        self.weight /= amplitude

    def take(self, sample: "Sample") -> None:
        """Add a sample."""
        self.error = max(self.error, sample.energy_error)
        displacement = self.simulation.displacement_before()
        self.rows.append((sample.time, float((self.weight * displacement).sum())))

    def signals(self) -> dict[str, Any]:
        """The frequency in time and that of the eigenvalue problem, Hz."""
        from scipy.optimize import least_squares

        at, along = np.array(self.rows).T

        def misfit(unknown: Array) -> Array:
            ratio, a, b = unknown
            phase = 2 * math.pi * self.frequency * ratio * at
            return np.asarray(a * np.cos(phase) + b * np.sin(phase) - along)

        fit = least_squares(misfit, (1.0, 1.0, 0.0), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        return {
            "values": {"frequency": float(fit[0]) * self.frequency},
            "eigenfrequency_hz": self.frequency,
        }


def lowest_elastic_mode(simulation: "Simulation") -> tuple[float, Array]:
    """Frequency (Hz) and shape (2, *S, 3) of the lowest mode that is not a rigid motion."""
    from taichi_ldem.solver import eigen

    rings = simulation.body("rings")
    fixed = rings.listed() if rings is not None else np.zeros(0, dtype=np.int32)
    operator = eigen.TangentOperator(simulation.dynamics, fixed)
    found = eigen.lowest(operator, 1 if rings is not None else 7)
    elastic = int(np.argmax(found.frequencies > 1e-3 * found.frequencies.max()))
    return float(found.frequencies[elastic]), found.shapes[elastic]


class _Wave:
    """The displacement of a pulse at the second probe."""

    def __init__(self, simulation: "Simulation"):
        from taichi_ldem.scenarios.wave import Packet, Probes

        self.simulation = simulation
        self.error = 0.0
        self.packet = Packet(simulation.scene)
        self.packet.check()
        self.probes = Probes(self.packet)
        self.probes.prepare(simulation)

    def take(self, sample: "Sample") -> None:
        """Add a sample."""
        self.error = max(self.error, sample.energy_error)
        self.probes.take(self.simulation, sample)

    def signals(self) -> dict[str, Any]:
        """History at the second probe's place, m, interpolated where no plane of nodes lies."""
        from scipy.interpolate import CubicSpline

        displacement = CubicSpline(self.probes.place, np.array(self.probes.seen), axis=1)(
            self.packet.pulse.probes[1]
        )
        return {"time": self.probes.times, "signals": {"displacement": displacement.tolist()}}


def exact_wave(scene: Scene, sections: tuple[int, ...] = (3, 4, 6)) -> dict[str, Any]:
    """The second probe's signal in a bar of vanishing modules, in continuous time.

    Every wave of the packet has the frequency to which those of finer and finer sections tend: the
    polynomial in the module edge through ``sections`` (modules), at zero. For a plane wave it is
    d'Alembert's.
    """
    from taichi_ldem.scenarios.wave import Packet

    plate, time_s = scene.plate, sample_times(scene)
    packets = []
    for modules in sections:
        finer = plate.model_copy(update={"modules_through_thickness": modules})
        packets.append(Packet(scene.model_copy(update={"plate": finer})))
    k = packets[0].wave_numbers
    count = min(len(p.wave_numbers) for p in packets)
    place = np.array([scene.pulse.probes[1]]) if scene.pulse is not None else np.zeros(1)
    if packets[0].pulse.kind != "bar":
        omega = packets[0].reference[1] * k
        seen = packets[0].amplitudes
    else:
        edges = [1 / modules for modules in sections]
        rows = np.stack([p.frequencies[:count] for p in packets])
        weights = [
            math.prod(e / (e - d) for e in edges if e != d) for d in edges
        ]  # of Lagrange's polynomial at zero
        omega = np.asarray(weights) @ rows
        seen = packets[-1].probe_amplitudes[:count]
    turn = k[: len(omega), None] * place - omega[:, None] * time_s
    displacement = (seen[: len(omega), None] * np.exp(1j * turn)).sum(axis=0).real
    if packets[0].pulse.kind != "bar":
        turn = k[:, None] * (2 * packets[0].ends[1] - place) - omega[:, None] * time_s
        displacement = displacement + (seen[:, None] * np.exp(1j * turn)).sum(axis=0).real
    speed = float(omega[1] / k[1])
    flight = (float(place[0]) - packets[0].pulse.position) / speed
    return {
        "time": time_s.tolist(),
        "signals": {"displacement": displacement.tolist()},
        "flight_s": flight,
        "speed_m_s": speed,
        "continuum_m_s": packets[0].reference[1],
    }


def finite_elements(scene: Scene, levels: tuple[int, ...] = (2, 3)) -> dict[str, Any]:
    """The lowest bending frequency of a clamped plate by finite elements (scikit-fem), Hz.

    The edge of a clamp is singular, and a staircase on the lattice, so the lattice's own series has
    no reliable limit.

    Args:
        levels: of refinement; the last one's value counts, the others show its convergence.
    """
    from taichi_ldem.studies import finite_elements as fem

    constants, density = fem.scene_constants(scene), scene.material.density
    values = [
        fem.plate_modes(fem.scene_part(scene, n), constants, density, 1)[0][0] for n in levels
    ]
    return {"values": {"frequency": values[-1]}, "coarser_hz": values[:-1]}


def sample_times(scene: Scene) -> Array:
    """Times of the history rows, s."""
    interval = scene.output.history_interval
    rows = int(scene.solver.duration / interval * (1 + 1e-9)) + 1
    return np.asarray(interval * np.arange(rows), dtype=np.float64)


def main() -> None:
    """Run one point and write its record."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path)
    parser.add_argument("file", type=Path)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    parser.add_argument("--mode", type=Path, metavar="FILE.npz", help="of a vibration, kept")
    parser.add_argument("--reference", choices=["wave", "finite-elements"])
    options = parser.parse_args()
    scene = load_scene(options.scene, options.settings)
    if options.reference == "wave":
        record = exact_wave(scene)
    elif options.reference:
        record = finite_elements(scene)
    else:
        record = run(scene, options.mode)
    partial = options.file.with_suffix(".tmp")
    partial.write_text(json.dumps(record), encoding="utf-8")
    partial.replace(options.file)


if __name__ == "__main__":
    main()
