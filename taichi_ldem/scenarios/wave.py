"""A pulse through a bar or a plate: arrival and dispersion against the lattice's exact waves.

The pulse is a sum of exact waves of the lattice (``model.waves``) that travel towards larger
coordinates. At t = 0 the sum gives displacement and velocity, afterwards the solution with which
the run is compared. Plane waves (longitudinal, shear) cover the whole section and are read on its
axis until waves from the free sides can arrive there; the free ends reflect them as mirrors do. The
waves of a bar are those of its section with free sides. They are read as a mean over the section
until the reflection from the far end arrives.
"""

import math
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import SceneError
from taichi_ldem.model import waves
from taichi_ldem.model.cell import CELLS, CORNER
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.model.material import elastic_constants
from taichi_ldem.scenarios import runner
from taichi_ldem.scenarios.drawing import Draw
from taichi_ldem.scenarios.runner import History, Instrument
from taichi_ldem.scene import Pulse, Scene
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation

Array = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

WAVELENGTHS = (80, 60, 40, 30, 24, 20, 16, 12, 10, 8, 7, 6, 5, 4)
"""Wavelengths, in module edges, at which the dispersion is read if the pulse contains them."""
TAIL = 4.5
"""Distance from the Gaussian's middle beyond which the pulse counts as zero, in deviations."""
HEAD = 3.5
"""Least distance of the first probe from the Gaussian's middle, in deviations.

There the Gaussian has 0.2 % of its height.
"""
WEAKEST = 0.05
"""Amplitude over the spectrum's largest below which a wavelength is not read."""
LEFT = 0.03
"""Share of the second probe's largest displacement that may be left when reading ends."""
PROFILES = 5
"""Number of times at which the displacement along the axis is written."""


def run(
    scene: Scene, out: Path, *, force: bool = False, quiet: bool = False, draw: Draw | None = None
) -> int:
    """Run a pulse into a folder; arguments, exit codes and errors are ``runner.run``'s.

    Raises:
        SceneError: also for a prism too narrow for the pulse to pass the probes undisturbed.
    """
    packet = Packet(scene)
    packet.check()
    probes = Probes(packet)

    def summary(simulation: "Simulation", history: History, folder: RunFolder) -> dict[str, Any]:
        probes.write(folder.path)
        return probes.summary()

    instrument = Instrument(probes.prepare, probes.take)
    return runner.run(
        scene, out, summary, force=force, quiet=quiet, draw=draw, instrument=instrument
    )


@dataclass(frozen=True)
class Packet:
    """The waves of a scene's pulse, u = Re sum a shape exp(i (k x - omega t)), M of them."""

    scene: Scene

    @property
    def pulse(self) -> Pulse:
        """The table of the pulse."""
        assert self.scene.pulse is not None  # the scene refuses scenario "wave" without it
        return self.scene.pulse

    @property
    def axis(self) -> int:
        """Axis of travel: 0, 1 or 2."""
        return "xyz".index(self.pulse.axis)

    @property
    def polarisation(self) -> int:
        """Axis along which the pulse displaces nodes: 0, 1 or 2."""
        return (self.axis + (self.pulse.kind == "shear")) % 3

    @property
    def deviation(self) -> float:
        """Standard deviation of the Gaussian, m."""
        return self.pulse.wavelength / (2 * math.pi)

    @property
    def ends(self) -> tuple[float, float]:
        """Coordinates of the specimen's ends along the axis, m."""
        side = self.scene.plate.actual_size[self.axis]
        return (0.0, side) if self.axis == 2 else (-side / 2, side / 2)

    @cached_property
    def wave_numbers(self) -> Array:
        """(M,) wave numbers, 1/m.

        Their period is twice the specimen's length; they go up to five over the deviation.
        """
        base = math.pi / (self.ends[1] - self.ends[0])
        largest = min(5 / self.deviation, 2 * math.pi / self.scene.plate.spacing)
        return np.asarray(base * np.arange(int(largest / base) + 1), dtype=np.float64)

    @cached_property
    def amplitudes(self) -> Complex:
        """(M,) amplitudes of the Gaussian, m."""
        k, w = self.wave_numbers, self.deviation
        peak = self.pulse.amplitude * w * math.exp(0.5)  # the strain is largest at one deviation
        share = np.where(k > 0, 2.0, 1.0) * w * math.sqrt(2 * math.pi)
        period = 2 * (self.ends[1] - self.ends[0])
        gauss = np.exp(-0.5 * (k * w) ** 2 - 1j * k * self.pulse.position)
        return np.asarray(peak * share / period * gauss)

    @cached_property
    def medium(self) -> waves.Bulk:
        """The infinite lattice."""
        plate = self.scene.plate
        return waves.bulk(self.scene.material, plate.spacing, plate.stiffness, plate.lattice)

    @cached_property
    def guide(self) -> waves.Waveguide:
        """The infinite bar with the specimen's section."""
        plate = self.scene.plate
        modules = list(plate.modules)
        modules[self.axis] = 6
        cell = CELLS[plate.lattice]
        piece = Lattice(prism(*modules), plate.spacing, plate.surface_weights, cell=cell)
        return waves.waveguide(self.scene.material, piece, self.axis, plate.stiffness)

    @cached_property
    def _modes(self) -> tuple[Array, Complex]:
        # (M,) frequencies and (M, n, 3) shapes; plane waves have one for each node of a site
        k, direction = self.wave_numbers, np.eye(3)[self.axis]
        if self.pulse.kind != "bar":
            along = np.eye(3)[self.polarisation]
            omega, shares = self.medium.straight(k[1:, None] * direction, along)
            shares = np.concatenate([np.ones((1, shares.shape[1])), shares])
            return np.concatenate([[0.0], omega]), (shares[..., None] * along).astype(complex)
        omega, shape = self.guide.longitudinal(k[1:])
        still = np.broadcast_to(direction, (1, *shape.shape[1:]))
        return np.concatenate([[0.0], omega]), np.concatenate([still, shape])

    @cached_property
    def probe_amplitudes(self) -> Complex:
        """(M,) amplitudes of what the probes read, m."""
        if self.pulse.kind != "bar":
            return self.amplitudes * self._modes[1][:, CORNER, self.polarisation].real
        mean = self._modes[1][..., self.polarisation] @ self.guide.corner_shares
        return np.asarray(self.amplitudes * mean)

    @property
    def frequencies(self) -> Array:
        """(M,) angular frequencies in continuous time, 1/s."""
        return self._modes[0]

    def _phases(self, place: Array, time_step: float, time: Array) -> Complex:
        """(M, times, places) exp(i (k x - omega t)) at the frequencies of central differences."""
        omega = waves.discrete_frequency(self.frequencies, time_step)
        turn = self.wave_numbers[:, None, None] * place - omega[:, None, None] * time[:, None]
        return np.asarray(np.exp(1j * turn))

    def signal(self, place: Array, time_step: float, time: Array) -> Array:
        """(times, places) exact displacement that the probes read, m."""
        waves_there = self._phases(place, time_step, time)
        if self.pulse.kind != "bar":
            waves_there += self._phases(2 * self.ends[1] - place, time_step, time)
        return np.asarray(np.einsum("m,mtx->tx", self.probe_amplitudes, waves_there).real)

    def state(self, lattice: Lattice, time_step: float) -> tuple[Array, Array]:
        """Displacement (m) and velocity (m/s) at t = 0, (2, *S, 3), corner then centre.

        The velocity is (u(dt) - u(-dt)) / (2 dt), with which the first step is exact.
        """
        place = lattice.positions()
        where = np.moveaxis(place[..., self.axis], 3 - self.axis, 3)[:, 0, 0, :]
        omega = waves.discrete_frequency(self.frequencies, time_step)
        rate = -1j * np.sin(omega * time_step) / time_step
        fields = []
        for factor in (np.ones(len(omega), dtype=complex), rate):
            values = np.zeros(place.shape)
            view = np.moveaxis(values, 3 - self.axis, 3)
            for sublattice, x in enumerate(where):
                self._fill(view[sublattice], sublattice, x, factor, time_step)
            fields.append(values * lattice.exists()[..., None])
        return fields[0], fields[1]

    def _fill(
        self, view: Array, sublattice: int, x: Array, factor: Complex, time_step: float
    ) -> None:
        """Put one sublattice's values at t = 0 into its view (A, B, N, 3)."""
        start = np.zeros(1)
        factor = factor * self.amplitudes
        if self.pulse.kind != "bar":
            factor = factor * self._modes[1][:, sublattice, self.polarisation].real
        wave = factor[:, None] * self._phases(x, time_step, start)[:, 0]
        if self.pulse.kind != "bar":
            mirror = self._phases(2 * self.ends[1] - x, time_step, start)[:, 0]
            wave = wave + factor[:, None] * mirror
            view[..., self.polarisation] = wave.sum(axis=0).real
            return
        nodes = self.guide.nodes
        corners = np.count_nonzero(nodes[0])
        mine = slice(0, corners) if sublattice == 0 else slice(corners, None)
        view[nodes[sublattice]] = np.einsum("mx,mnc->nxc", wave, self._modes[1][:, mine]).real

    # -- speeds, and how long the exact solution holds

    @cached_property
    def reference(self) -> tuple[str, float]:
        """Speed of long waves in the continuum: its formula and its value, m/s."""
        material, plate = self.scene.material, self.scene.plate
        c11, _, c44 = elastic_constants(
            material.youngs_modulus, material.poisson_ratio, plate.stiffness
        )
        name, modulus = {
            "longitudinal": ("sqrt(C11/rho)", c11),
            "shear": ("sqrt(C44/rho)", c44),
            "bar": ("sqrt(E/rho)", material.youngs_modulus),
        }[self.pulse.kind]
        return name, math.sqrt(modulus / material.density)

    @property
    def side_arrival(self) -> float | None:
        """Earliest time at which the sides can disturb the axis of a plane wave, s."""
        if self.pulse.kind == "bar":
            return None
        sides = self.scene.plate.actual_size
        half = min(side for a, side in enumerate(sides) if a != self.axis) / 2
        return half / self.medium.fastest

    @property
    def passed(self) -> float:
        """Time at which the pulse has passed the second probe, at the continuum's speed, s."""
        distance = self.pulse.probes[1] - self.pulse.position + TAIL * self.deviation
        return distance / self.reference[1]

    @property
    def window(self) -> float:
        """Time until which the probes read the outgoing pulse alone, s."""
        distance = 2 * self.ends[1] - self.pulse.probes[1] - self.pulse.position
        echo = (distance - TAIL * self.deviation) / self.reference[1]
        return min(self.scene.solver.duration, echo, self.side_arrival or math.inf)

    @property
    def followed(self) -> float:
        """Time until which the exact solution holds on the whole axis, s.

        Plane waves include their reflection from the far end, those of a bar do not.
        """
        end = self.scene.solver.duration
        if self.side_arrival is not None:
            return min(end, self.side_arrival)
        distance = self.ends[1] - self.pulse.position - TAIL * self.deviation
        return min(end, distance / self.reference[1])

    def check(self) -> None:
        """Check that the pulse passes both probes undisturbed.

        Raises:
            SceneError: it does not; the message names the key to change.
        """
        start = self.pulse.position - self.ends[0] - TAIL * self.deviation
        if start < 0:
            least = self.ends[0] + TAIL * self.deviation
            raise SceneError(
                f"pulse.position = {self.pulse.position}: must be at least {least:.4g} m, so that "
                "the whole pulse starts inside the specimen"
            )
        near = self.pulse.position + HEAD * self.deviation
        if self.pulse.probes[0] < near:
            raise SceneError(
                f"pulse.probes = {list(self.pulse.probes)}: the first must be at least {near:.4g} "
                "m, where the pulse has not arrived at t = 0"
            )
        if self.window >= self.passed:
            return
        late = f"the pulse has passed pulse.probes only at {self.passed:.3g} s, but "
        if self.scene.solver.duration < self.passed:
            raise SceneError(f"solver.duration = {self.scene.solver.duration}: {late}the run ends")
        if self.side_arrival is not None and self.side_arrival < self.passed:
            raise SceneError(
                f"plate.size = {list(self.scene.plate.size)}: {late}waves from the free sides "
                f"arrive at {self.side_arrival:.3g} s; take a wider plate"
            )
        raise SceneError(
            f"pulse.probes = {list(self.pulse.probes)}: {late}its echo from the end arrives at "
            f"{self.window:.3g} s; take a longer specimen or a shorter pulse"
        )


class Probes:
    """Reads the displacement of the planes of corner nodes along the axis at every sample.

    Attributes:
        place: (planes,) coordinates, m.
        chosen: planes of the scene's two probes.
        times: of the samples so far, s.
        seen: (planes,) displacement at each of them, m.
    """

    def __init__(self, packet: Packet):
        self.packet = packet
        plate, low = packet.scene.plate, packet.ends[0]
        planes = np.arange(plate.modules[packet.axis] + 1, dtype=np.float64)
        self.place = low + plate.spacing * planes
        self.chosen = [int(np.abs(self.place - x).argmin()) for x in packet.pulse.probes]
        self.times: list[float] = []
        self.seen: list[Array] = []
        self.time_step = math.nan

    def prepare(self, simulation: "Simulation") -> None:
        """Set the pulse in motion."""
        lattice = simulation.dynamics.lattice
        self.time_step = simulation.time_step
        simulation.start_from(*self.packet.state(lattice, self.time_step))
        middle = np.take(lattice.code, 3, axis=2 - self.packet.axis)
        self.weights = np.zeros(middle.shape)
        if self.packet.pulse.kind == "bar":
            corners = self.packet.guide.nodes[0]
            self.weights[corners] = self.packet.guide.corner_shares[: np.count_nonzero(corners)]
        else:
            self.weights[tuple((n - 1) // 2 for n in middle.shape)] = 1.0

    def take(self, simulation: "Simulation", sample: "Sample") -> None:
        """Read one sample."""
        component = simulation.displacement_before()[0, ..., self.packet.polarisation]
        planes = np.moveaxis(component, 2 - self.packet.axis, 2)[..., 1:-1]
        self.times.append(sample.time)
        self.seen.append(np.einsum("abn,ab->n", planes, self.weights))

    def write(self, folder: Path) -> None:
        """Write probes.csv (both probes) and profiles.csv (the axis at some times)."""
        time, seen = np.array(self.times), np.array(self.seen)
        exact = self.packet.signal(self.place[self.chosen], self.time_step, time)
        names = [f"probe_{n}{kind}_m" for kind in ("", "_exact") for n in (1, 2)]
        with HistoryWriter(folder / "probes.csv", ["time_s", *names]) as file:
            for row in zip(time, *seen[:, self.chosen].T, *exact.T, strict=True):
                file.append(row)
        last = int(np.searchsorted(time, self.packet.followed * (1 + 1e-9))) - 1
        rows = np.unique(np.linspace(0, last, PROFILES).round().astype(int))
        names = ["time_s", "position_m", "displacement_m", "exact_m"]
        with HistoryWriter(folder / "profiles.csv", names) as file:
            for n in rows:
                profile = self.packet.signal(self.place, self.time_step, time[n : n + 1])[0]
                for x, u, other in zip(self.place, seen[n], profile, strict=True):
                    file.append([time[n], x, u, other])

    # -- the numbers

    def summary(self) -> dict[str, Any]:
        """Measured and exact speeds, m/s; an error is the ratio of measured to exact, minus 1."""
        packet = self.packet
        time = np.array(self.times)
        keep = time <= packet.window * (1 + 1e-9)
        time, seen = time[keep], np.array(self.seen)[keep][:, self.chosen]
        place = self.place[self.chosen]
        exact = packet.signal(place, self.time_step, time)
        distance = float(place[1] - place[0])
        formula, reference = packet.reference
        measured_speed = distance / delay(time, seen)
        exact_speed = distance / delay(time, exact)
        rows = self.dispersion(time, seen, exact, distance)
        left = float(np.abs(exact[-1, 1]) / np.abs(exact[:, 1]).max())
        if not rows or left > LEFT:
            print(
                f"warning: {100 * left:.1f} % of the pulse's height is still at the second probe "
                "when the reading ends: phase speeds are inaccurate",
                file=sys.stderr,
            )
        return {
            "long_wave_formula": formula,
            "long_wave_speed_m_s": reference,
            "lattice_long_wave_speed_m_s": float(packet.frequencies[1] / packet.wave_numbers[1]),
            "speed_cross_correlation_m_s": measured_speed,
            "speed_cross_correlation_exact_m_s": exact_speed,
            "speed_cross_correlation_error": measured_speed / exact_speed - 1,
            "dispersion": rows,
            "dispersion_largest_error": max((abs(r["error"]) for r in rows), default=None),
            "waveform_error": float(np.abs(seen - exact).max() / np.abs(exact).max()),
            "left_at_second_probe": left,
            "probes_m": place.tolist(),
            "window_s": packet.window,
            "side_arrival_s": packet.side_arrival,
        }

    def dispersion(
        self, time: Array, seen: Array, exact: Array, distance: float
    ) -> list[dict[str, float]]:
        """Phase speed between the probes for each wavelength of the pulse, measured and exact.

        ``reading_error`` is the error of the same reading applied to the exact signals: the part of
        ``error`` that comes from the finite time between pulse and echo.
        """
        from scipy.interpolate import CubicSpline

        packet, spacing = self.packet, self.packet.scene.plate.spacing
        omega = waves.discrete_frequency(packet.frequencies, self.time_step)
        rising = int(np.argmax(np.diff(omega) <= 0)) or len(omega)
        relation = CubicSpline(packet.wave_numbers[:rising], omega[:rising])
        rows = []
        for modules in WAVELENGTHS:
            k = 2 * math.pi / (modules * spacing)
            weak = math.exp(-0.5 * (k * packet.deviation) ** 2) < WEAKEST
            long = modules * spacing > 5 * packet.pulse.wavelength
            if weak or long or k > packet.wave_numbers[rising - 1]:
                continue
            distance_passed = packet.pulse.probes[1] - packet.pulse.position + 2 * packet.deviation
            if distance_passed > float(relation(k, 1)) * packet.window:  # has not passed yet
                continue
            turns = [
                phase_difference(time, signals, float(relation(k)), k * distance)
                for signals in (seen, exact)
            ]
            speed = float(relation(k)) / k
            measured, read = (speed * k * distance / turn for turn in turns)
            rows.append(
                {
                    "wavelength_modules": float(modules),
                    "wavelength_m": modules * spacing,
                    "measured_m_s": measured,
                    "exact_m_s": speed,
                    "error": measured / speed - 1,
                    "reading_error": read / speed - 1,
                }
            )
        return rows


def delay(time: Array, signals: Array) -> float:
    """Time by which the second of two signals (times, 2) lags the first, s.

    It is the maximum of their cross-correlation, refined by the parabola through three samples.
    """
    score = np.correlate(signals[:, 1], signals[:, 0], "full")
    best = int(np.clip(score.argmax(), 1, len(score) - 2))
    before, at, after = score[best - 1 : best + 2]
    shift = best - (len(time) - 1) + 0.5 * (before - after) / (before - 2 * at + after)
    return float(shift * (time[1] - time[0]))


def phase_difference(time: Array, signals: Array, omega: float, near: float) -> float:
    """Phase by which the second of two signals (times, 2) lags the first at a frequency.

    Args:
        omega: 1/s.
        near: an estimate of the phase; the result is the nearest to it of those 2 pi apart.
    """
    first, second = signals.T @ np.exp(1j * omega * time)
    phase = float(np.angle(second / first))
    return phase + 2 * math.pi * round((near - phase) / (2 * math.pi))
