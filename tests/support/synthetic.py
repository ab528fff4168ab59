"""A run folder made from formulas: a bent plate with radial and circular cracks, a plausible test.

Stands in for a solver's run in the tests of the store's readers, the figures and the pictures.
"""

from pathlib import Path

import numpy as np

from taichi_ldem.storage.fields import FieldWriter, hexahedral_mesh
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.fragments import COLUMNS as COLUMNS_OF_FRAGMENTS
from taichi_ldem.storage.fragments import FragmentWriter
from taichi_ldem.storage.history import HistoryWriter

SCENE = """
scenario = "impact"
[plate]
size = [0.0928, 0.0928, 0.0032]
modules_through_thickness = {layers}
[material]
youngs_modulus = 3.35e9
poisson_ratio = 0.25
density = 1190.0
fracture_energy = 1034.0
failure_factor = 31.45
[striker]
diameter = 0.0127
mass = 18.49
velocity = 1.065
[clamp]
kind = "rings"
inner_diameter = 0.076
outer_diameter = 0.090
[solver]
duration = 1e-2
[output]
image_times = [0.005]
"""
COLUMNS = (
    "time_s",
    "striker_displacement_m",
    "striker_velocity_m_s",
    "striker_force_n",
    "ring_force_n",
    "kinetic_plate_j",
    "kinetic_striker_j",
    "strain_j",
    "fracture_j",
    "contact_j",
    "energy_error",
    "broken_bars",
)
THICKNESS, SIDE, RADIUS = 3.2e-3, 92.8e-3, 38e-3
FAILURE = 7.5e-3


def synthetic_run(path: Path, *, layers: int = 2, cracked: bool = True) -> RunFolder:
    """Fields at 0, 5 and 10 ms; `cracked = False` leaves every bar whole."""
    folder = RunFolder.create(path, force=False)
    folder.write_scene(SCENE.format(layers=layers))
    _write_history(folder, cracked)
    spacing = THICKNESS / layers
    across = round(SIDE / spacing)
    origin = (-across * spacing / 2, -across * spacing / 2, 0.0)
    mask = np.ones((layers, across, across), dtype=bool)
    points, hexahedra, _ = hexahedral_mesh(mask, spacing, origin)
    writer = FieldWriter(folder.fields_file, points, hexahedra)
    centres = points[hexahedra].mean(axis=1)
    for time in (0.0, 5e-3, 10e-3):
        reach = (time / 10e-3) * RADIUS * 0.85 if cracked else 0.0
        broken = _broken_fraction(centres, spacing, reach)
        moved = _displacement(points, 6e-3 * time / 10e-3)
        writer.append(time, moved, moved * 100.0, broken)
    dead = np.flatnonzero(broken > 0.5)
    when = np.hypot(*centres[dead, :2].T) / RADIUS * 1e-2
    for bar in range(14):
        writer.append_broken(when, centres[dead], np.full(len(dead), bar, dtype=np.uint8))
    if cracked:
        folder.write_summary(
            {
                "first_peak_force_n": 605.0,
                "first_peak_time_s": 1.8e-3,
                "second_peak_force_n": 750.0,
                "second_peak_time_s": 7.4e-3,
                "failure_time_s": FAILURE,
                "failure_time_velocity_s": FAILURE,
                "failure_time_energy_s": FAILURE,
                "damage_onset_time_s": 1.4e-3,
                "broken_bars": 14 * len(dead),
            }
        )
    return folder


def add_fragments(folder: RunFolder) -> None:
    """At the end: debris with 1 % of the mass, two pieces of 2 mm with 9 %, one with 90 %."""
    folder.write_scene(
        folder.scene_file.read_text() + "fragments = true\n"
    )  # in [output], the last
    writer = FragmentWriter(folder.fragments_file)
    for time, numbers, masses, sizes in (
        (0.0, [1], [1.0], [0.03]),
        (1e-2, [0, 1, 2, 3], [0.01, 0.90, 0.06, 0.03], [1e-3, 0.028, 2e-3, 2e-3]),
    ):
        values = {name: np.zeros(len(numbers)) for name in COLUMNS_OF_FRAGMENTS}
        known = {"fragment": numbers, "mass_kg": masses, "equivalent_diameter_m": sizes}
        writer.append(time, values | {name: np.array(v) for name, v in known.items()})


def _displacement(points: np.ndarray, depth: float) -> np.ndarray:
    """Clamped circular plate, w = depth (1 - r^2/a^2)^2, with the rotation of its sections."""
    x, y, z = points.T
    inside = np.maximum(0.0, 1.0 - (x * x + y * y) / RADIUS**2)
    slope = 4.0 * depth * inside / RADIUS**2
    lever = z - THICKNESS / 2
    return np.stack([-lever * slope * x, -lever * slope * y, -depth * inside**2], axis=1)


def _broken_fraction(centres: np.ndarray, spacing: float, reach: float) -> np.ndarray:
    """Five radial cracks out to `reach` and a circular one at 60 % of it; most broken below."""
    x, y, z = centres.T
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    away = np.abs((angle + np.pi / 5) % (2 * np.pi / 5) - np.pi / 5) * radius
    distance = np.where(radius < reach, away, np.inf)
    if reach > 0.3 * RADIUS:
        distance = np.minimum(distance, np.abs(radius - 0.6 * reach))
    broken = np.clip(1.5 - distance / spacing, 0.0, 1.0) * (1.0 - 0.3 * z / THICKNESS)
    return np.where(reach > 0.0, broken, 0.0)


def _write_history(folder: RunFolder, cracked: bool) -> None:
    rng = np.random.default_rng(20)
    mass, start = 18.49, 1.065
    with HistoryWriter(folder.history_file, COLUMNS) as history:
        for time in np.arange(0.0, 10e-3, 2e-5):
            whole = time < FAILURE or not cracked
            smooth = 600.0 * min(1.0, time / 1.75e-3) + 20e3 * max(0.0, time - 1.75e-3)
            force = (smooth if whole else 20.0) + rng.normal(0.0, 40.0) * (time > 0)
            depth = time * start - 0.5 * smooth / mass * time**2 / 3
            velocity = start - min(time, FAILURE) ** 2 * 1.5e3
            strain = 0.4 * smooth * depth if whole else 0.2
            fracture = max(0.0, time - 1.4e-3) * 20 + (0.0 if whole else 0.6)
            kinetic = 0.5 * mass * velocity**2
            plate = 1e-3 if whole else 0.3
            count = int(fracture * 1e4) if cracked else 0
            ring = 0.9 * (smooth if whole else 20.0)
            row = (time, depth, velocity, force, ring, plate, kinetic, strain, fracture)
            history.append((*row, 1e-4 * time, rng.normal(0.0, 1e-5), count))
