"""Strips that are pulled apart until a crack runs along them, and what it has cost.

    python -m taichi_ldem.studies.toughness.strip FILE.jsonl SCENE.toml ...

All scenes must need the same kernels; they are run one after another in this process, and a line of
JSON is added to the file for each.

A strip of free height H between its grips and of elastic modulus E' = E / (1 - nu^2) (it cannot
contract along its long edges, but through its thickness) stores

    G = E' delta^2 / (2 H)

per area of its middle plane at a separation delta of the grips. This is what a crack that runs
along it releases, wherever it is, as long as both ends of the strip are further away than H or so
(Rivlin and Thomas 1953; the pure-shear specimen). No compliance has to be calibrated.
"""

import json
import math
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import ExitCode, SceneError, SimulationStopped
from taichi_ldem.model.flaws import turned
from taichi_ldem.model.material import failure_strain
from taichi_ldem.scene import Scene, load_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

Array = npt.NDArray[np.float64]

STARTED = 2.0
"""Modules that a crack has advanced when it counts as having started."""

WINDOW = (0.2, 0.6)
"""Share of the ligament, from the notch, in which a running crack is measured.

In configs/tension_strip.toml, the free edge is then still 12 mm away, and the strip is 15 mm high.
"""

ALL_OVER = 0.25
"""A bar that fails further than this share of H from where a crack may be belongs to no crack."""

TURNED = math.tan(math.radians(22.5))
"""How far a crack may have left the notch's plane, over its length: half of the angle between the
lattice planes (100) and (110)."""


@dataclass(frozen=True)
class Reading:
    """What one strip showed; None for what it did not come to.

    Attributes:
        start: G over G_f when the crack had advanced by ``STARTED`` modules.
        run: G over G_f when it entered ``WINDOW``: it has then left the notch behind and runs.
        bars: energy that bars dissipated within the window, per area of crack, over G_f.
        deviation: of the crack's path within the window from the notch's plane, degrees; positive
            towards the lattice plane (100) from which ``plate.angle`` counts.
        speed: mean speed within the window over that of Rayleigh waves.
        strain: mean strain of the strip over eps_p when the crack started. Close to 1, the strip
            fails all over and shows no cost of a crack.
        energy_error: largest imbalance of energy over what the plate held.
    """

    start: float | None = None
    run: float | None = None
    bars: float | None = None
    deviation: float | None = None
    speed: float | None = None
    strain: float | None = None
    energy_error: float = 0.0

    @property
    def radiated(self) -> float | None:
        """What a running crack released beyond what bars dissipated, over G_f: waves, damping."""
        return None if self.run is None or self.bars is None else self.run - self.bars


def rayleigh_speed(youngs_modulus: float, poisson_ratio: float, density: float) -> float:
    """Speed of Rayleigh waves by Viktorov's approximation, good to 0.5 %; Pa and kg/m3, m/s."""
    shear = math.sqrt(youngs_modulus / (2 * (1 + poisson_ratio) * density))
    return shear * (0.87 + 1.12 * poisson_ratio) / (1 + poisson_ratio)


@dataclass
class Record:
    """What is kept of a run, row by row, and of every bar that failed.

    Attributes:
        separation: (n,) of the grips, m.
        fracture: (n,) energy dissipated in bars, J.
        time: (n,) s.
        when: (m,) row in which a bar was found broken.
        along, across: (m,) its mid-point along the strip from the tip of the notch, and from the
            notch's plane, m.
        energy_error: largest imbalance of energy over what the plate held.
    """

    separation: Array
    fracture: Array
    time: Array
    when: npt.NDArray[np.int64]
    along: Array
    across: Array
    energy_error: float


def run(simulation: "Simulation") -> Record:
    """Pull a strip until its crack has left ``WINDOW``."""
    scene, dynamics = simulation.scene, simulation.dynamics
    tip, plane, far = geometry(scene)
    rows: list[tuple[float, float, float]] = []
    when, places = [], []
    error = 0.0
    for sample in simulation.samples():
        sites, bars = dynamics.new_broken()
        middle = dynamics.lattice.bar_midpoints(sites, bars)
        place = turned(middle, math.radians(scene.plate.angle))
        when += [len(rows)] * len(bars)
        places.append(place)
        separation = sample.observed["grip_displacement_m"]
        rows.append((sample.time, separation, sample.ledger.fracture))
        error = max(error, sample.energy_error_of_plate)
        along, across = place[:, 1] - tip, place[:, 0] - plane
        if (belongs_to_crack(scene, along, across) & (along > WINDOW[1] * far)).any():
            break
    place = np.concatenate(places)
    time, separation, fracture = np.array(rows, dtype=float).T
    return Record(
        separation,
        fracture,
        time,
        np.array(when, dtype=np.int64),
        place[:, 1] - tip,
        place[:, 0] - plane,
        error,
    )


def belongs_to_crack(scene: Scene, along: Array, across: Array) -> npt.NDArray[np.bool_]:
    """Whether bars that fail at some places from the notch's tip and plane (m) are of its crack."""
    band = ALL_OVER * scene.plate.size[0] + TURNED * np.maximum(along, 0.0)
    return np.asarray(np.abs(across) < band)


def geometry(scene: Scene) -> tuple[float, float, float]:
    """Place of the notch's tip along the strip, of its plane across it, and the ligament; m.

    Raises:
        SceneError: the scene has no notch normal to x that ends within the strip.
    """
    notches = [notch for notch in scene.notch if notch.normal == "x"]
    if scene.scenario != "tension" or len(notches) != 1:
        raise SceneError('a strip needs scenario = "tension" and one [[notch]] with normal = "x"')
    for number, notch in enumerate(scene.notch):
        if notch.normal is None:
            raise SceneError(
                f"notch[{number}]: a strip takes notches that are normal to an axis only"
            )
    tip, edge = notches[0].bounds[0][1], scene.plate.size[1] / 2
    if tip >= edge:
        raise SceneError(f"notch[0].to = {notches[0].to}: must leave a ligament along y")
    return tip, notches[0].place, edge - tip


def free_height(simulation: "Simulation") -> float:
    """Height of the strip between the innermost nodes that the grips hold, m."""
    angle, lattice = math.radians(simulation.scene.plate.angle), simulation.dynamics.lattice
    held = lattice.positions().reshape(-1, 3)[simulation.body("grips").listed()]
    return 2 * float(np.abs(turned(held, angle)[:, 0]).min())


def read(simulation: "Simulation", record: Record) -> Reading:
    """What a record says; the definitions are those of ``Reading``."""
    scene = simulation.scene
    material, height = scene.material, free_height(simulation)
    _, _, ligament = geometry(scene)
    assert material.fracture_energy is not None  # `strips` refuses a scene without it
    modulus = material.youngs_modulus / (1 - material.poisson_ratio**2)
    released = modulus * record.separation**2 / (2 * height) / material.fracture_energy
    of_crack = belongs_to_crack(scene, record.along, record.across)
    front = np.full(len(record.time), 0.0)
    np.maximum.at(front, record.when[of_crack], record.along[of_crack])
    front = np.maximum.accumulate(front)
    started = first(front, STARTED * scene.plate.spacing)
    if started is None:
        return Reading(energy_error=record.energy_error)
    strain = float(record.separation[started] / height)
    found = Reading(
        start=float(released[started]),
        strain=strain / failure_strain(material),
        energy_error=record.energy_error,
    )
    begin, end = (first(front, share * ligament) for share in WINDOW)
    if begin is None or end is None:
        return found
    advance = front[end] - front[begin]
    area = advance * scene.plate.size[2]
    within = of_crack & (record.along > WINDOW[0] * ligament)
    slope = float(np.polyfit(record.along[within], record.across[within], 1)[0])
    speed = None
    if end > begin:
        wave = rayleigh_speed(material.youngs_modulus, material.poisson_ratio, material.density)
        speed = float(advance / (record.time[end] - record.time[begin]) / wave)
    dissipated = record.fracture[end] - record.fracture[begin]
    return replace(
        found,
        run=float(released[begin]),
        bars=float(dissipated / area / material.fracture_energy),
        deviation=math.degrees(math.atan(slope)),
        speed=speed,
    )


def first(values: Array, limit: float) -> int | None:
    """Index of the first value that is above a limit."""
    above = np.flatnonzero(values > limit)
    return int(above[0]) if len(above) else None


def main(words: list[str]) -> int:
    """Run the scenes and add a line for each to the file."""
    file, scenes = Path(words[0]), [(Path(word), load_scene(Path(word))) for word in words[1:]]
    from taichi_ldem.solver import backend

    backend.start(scenes[0][1].solver)
    from taichi_ldem.solver.simulation import Simulation

    simulation = None
    for path, scene in scenes:
        if simulation is None:
            simulation = Simulation(scene)
        else:
            simulation.reset(scene)
        try:
            found: dict[str, Any] = asdict(read(simulation, run(simulation)))
        except SimulationStopped as error:
            print(f"stopped: {error}", file=sys.stderr)
            return ExitCode.STOPPED
        with file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"name": path.stem, **found}) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
