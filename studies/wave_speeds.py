"""Speeds of plane waves on the lattice as the kernels run it, compared with the exact relation.

A cube is filled with one travelling plane wave, whose phase is read in its middle until its sides
can disturb it; the phase grows as omega t. The study covers many wave vectors, polarisations and
three Poisson's ratios and takes less than ten minutes on one core:

    python -m studies.wave_speeds outputs/wave_speeds [--modules 40]

writes ``wave_speeds.csv``, ``wave_speeds.md``, ``dispersion.png`` and ``anisotropy.png``.
"""

import math
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from rich.progress import track

from taichi_ldem.model import waves
from taichi_ldem.output.figures.wave import POISSON_RATIOS, isotropic_speeds
from taichi_ldem.scene import Material, Scene, Solver, parse_scene
from taichi_ldem.solver import backend

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

Array = npt.NDArray[np.float64]

SPACING = 3.2e-3 / 6
STRAIN = 1e-6
PATCH = 3
"""Half the side of the cube that is read, in module edges."""
MARGIN = 4
"""Margin for the lattice's fastest precursor ahead of the fastest wave, module edges."""
WAVELENGTHS = (40, 20, 12, 8, 6, 5, 4)
DIRECTIONS = {
    "[100]": (1.0, 0.0, 0.0),
    "[110]": (1.0, 1.0, 0.0),
    "[111]": (1.0, 1.0, 1.0),
    "[210]": (2.0, 1.0, 0.0),
}
ANGLES = (0, 15, 30, 45)


class Wave(NamedTuple):
    """A plane wave to be measured: P along k, S1 across k in the (001) plane, S2 across both."""

    poisson_ratio: float
    direction: str
    vector: tuple[float, float, float]
    wavelength_modules: float
    polarisation: str

    @property
    def unit(self) -> Array:
        """Direction of travel."""
        vector = np.array(self.vector)
        return np.asarray(vector / np.linalg.norm(vector))

    @property
    def wanted(self) -> Array:
        """Direction of motion if the wave were pure."""
        x, y, _ = self.unit
        across = np.array([-y, x, 0.0]) / math.hypot(x, y)
        shapes = {"P": self.unit, "S1": across, "S2": np.cross(self.unit, across)}
        return shapes[self.polarisation]


def all_waves() -> Iterator[Wave]:
    """The waves to be measured: dispersion along four directions, anisotropy in the (001) plane."""
    for name, vector in DIRECTIONS.items():
        for modules in WAVELENGTHS:
            for polarisation in ("P", "S1") if name in ("[100]", "[111]") else ("P", "S1", "S2"):
                yield Wave(0.25, name, vector, modules, polarisation)
    for nu in POISSON_RATIOS:
        for degrees in ANGLES:
            angle = math.radians(degrees)
            vector = (math.cos(angle), math.sin(angle), 0.0)
            for modules in (40, 8, 4):
                for polarisation in ("P", "S1", "S2"):
                    yield Wave(nu, f"{degrees} degrees", vector, modules, polarisation)


def cube(modules: int, poisson_ratio: float = 0.25) -> Scene:
    """A free elastic cube of PMMA, even number of modules a side."""
    material = {"youngs_modulus": 3.35e9, "poisson_ratio": poisson_ratio, "density": 1190.0}
    return parse_scene(
        {
            "scenario": "impact",  # the paper's solver settings, without a striker
            "plate": {
                "size": [modules * SPACING] * 3,
                "modules_through_thickness": modules,
                "stiffness": "equation-2",
            },
            "material": material | {"damage": False},
            "solver": {"duration": 1e-3, "safety": 0.5},
        }
    )


@dataclass(frozen=True)
class Speed:
    """Phase speeds of one wave, m/s: of the run, and exact with and without the time step."""

    measured: float
    exact: float
    exact_continuous: float
    time_step: float
    wave_number: float

    @property
    def measured_continuous(self) -> float:
        """The run's speed without the effect of central differences."""
        half = 0.5 * self.time_step
        return math.sin(half * self.measured * self.wave_number) / (half * self.wave_number)


def measure(simulation: "Simulation", medium: waves.Bulk, wave: Wave) -> Speed:
    """Send a plane wave through a cube and read its phase speed in the middle."""
    lattice, step = simulation.dynamics.lattice, simulation.time_step
    number = 2 * math.pi / (wave.wavelength_modules * lattice.spacing)
    omega, shape = medium.branch(number * wave.unit, wave.wanted)
    discrete = float(waves.discrete_frequency(omega, step))
    place = lattice.positions()
    phase = place @ (number * wave.unit)
    peak = STRAIN / number * lattice.exists()[..., None] * shape
    rate = math.sin(discrete * step) / step
    simulation.now = simulation.step_number = 0
    simulation.start_from(peak * np.cos(phase)[..., None], peak * rate * np.sin(phase)[..., None])
    half = lattice.modules[0] / 2
    middle = np.abs(place - [0.0, 0.0, half * lattice.spacing]).max(axis=-1)
    patch = (middle < (PATCH + 0.1) * lattice.spacing) & lattice.exists()
    parts = np.stack([np.cos(phase[patch]), np.sin(phase[patch])], axis=1)
    end = (half - PATCH - MARGIN) * lattice.spacing / medium.fastest
    every = max(1, int(end / step) // 20)
    times, turns = [], []
    while simulation.time <= end:
        displacement = simulation.displacement()[patch] @ shape
        cosine, sine = np.linalg.lstsq(parts, displacement, rcond=None)[0]
        times.append(simulation.time)
        turns.append(math.atan2(sine, cosine))
        simulation.advance(every)
    slope = np.polyfit(times, np.unwrap(turns), 1)[0]
    return Speed(float(slope) / number, discrete / number, float(omega) / number, step, number)


def study(modules: int, threads: int | None = None) -> list[dict[str, Any]]:
    """All waves in a cube, a row each."""
    scene = cube(modules)
    backend.start(Solver(duration=1.0, threads=threads))
    from taichi_ldem.model.material import bar_families
    from taichi_ldem.solver.simulation import Simulation
    from taichi_ldem.solver.stability import critical_time_step

    simulation = Simulation(scene)
    rows: list[dict[str, Any]] = []
    ratio = scene.material.poisson_ratio
    for wave in track(list(all_waves()), "plane waves"):
        material: Material = scene.material.model_copy(update={"poisson_ratio": wave.poisson_ratio})
        medium = waves.bulk(material, SPACING)
        if wave.poisson_ratio != ratio:
            ratio = wave.poisson_ratio
            simulation.dynamics.set_bars(bar_families(material, SPACING))
            critical = critical_time_step(simulation.dynamics)
            simulation.time_step = scene.solver.safety * critical
        speed = measure(simulation, medium, wave)
        whole = isotropic_speeds(material)[wave.polarisation != "P"]
        x, y, _ = wave.unit
        rows.append(
            {
                "poisson_ratio": wave.poisson_ratio,
                "direction": wave.direction,
                "angle_deg": math.degrees(math.atan2(y, x)),
                "polarisation": wave.polarisation,
                "wavelength_modules": wave.wavelength_modules,
                "measured_m_s": speed.measured,
                "exact_m_s": speed.exact,
                "measured_continuous_m_s": speed.measured_continuous,
                "exact_continuous_m_s": speed.exact_continuous,
                "error": speed.measured / speed.exact - 1,
                "over_isotropic": speed.measured_continuous / whole,
            }
        )
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Speeds along four directions (errors in 1e-6), and the largest error of all, as Markdown."""
    lines = ["| direction | wave | " + " | ".join(f"{n} L" for n in WAVELENGTHS) + " |"]
    lines.append("|---" * (len(WAVELENGTHS) + 2) + "|")
    for name in DIRECTIONS:
        for polarisation in ("P", "S1", "S2"):
            mine = [r for r in rows if (r["direction"], r["polarisation"]) == (name, polarisation)]
            if mine:
                cells = [f"{r['measured_m_s']:.1f} ({1e6 * r['error']:+.2f})" for r in mine]
                lines.append(f"| {name} | {polarisation} | " + " | ".join(cells) + " |")
    worst = max(rows, key=lambda r: abs(r["error"]))
    lines.append(f"\n{len(rows)} waves, largest error {worst['error']:+.1e}: {worst}")
    return "\n".join(lines) + "\n"


def figures(rows: list[dict[str, Any]], scene: Scene, folder: Path) -> None:
    """Draw ``dispersion.png`` and ``anisotropy.png``."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    from taichi_ldem.output.figures.draw import STYLE
    from taichi_ldem.output.figures.wave import draw_anisotropy, draw_directions

    with rc_context(STYLE):
        figure = Figure(figsize=(10.0, 8.0), dpi=130, layout="constrained")
        draw_directions(figure, scene, rows, DIRECTIONS)
        figure.savefig(folder / "dispersion.png")
        figure = Figure(figsize=(12.0, 9.0), dpi=130, layout="constrained")
        draw_anisotropy(figure, scene, rows)
        figure.savefig(folder / "anisotropy.png")


def main() -> None:
    """Measure, then write table and figures."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--modules", type=int, default=32, help="a side of the cube, even")
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    rows = study(options.modules, options.threads)
    header = ",".join(rows[0])
    lines = [",".join(str(value) for value in row.values()) for row in rows]
    (options.folder / "wave_speeds.csv").write_text("\n".join([header, *lines]) + "\n")
    (options.folder / "wave_speeds.md").write_text(table(rows))
    figures(rows, cube(options.modules), options.folder)


if __name__ == "__main__":
    main()
