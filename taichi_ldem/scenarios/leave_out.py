"""The cost of a scene compared with that of everything switched on: fields, bytes, kernels, time.

Everything means all features of ``solver.fields``, a striker and rings that rub, and what the scene
has besides, on the scene's own lattice and in its precision: further strikers, supports, a floor,
loads, probes, a start, notches and contact of pieces. Both are measured in
turn in processes of their own, and medians are taken.
``python -m taichi_ldem.scenarios.leave_out SCENE.toml`` prints one cost as JSON.
"""

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.scene import FILES, Scene, load_scene, parse_scene, scene_to_toml
from taichi_ldem.scene.loads import OF_NODES
from taichi_ldem.solver.contact.grips import GRIPS
from taichi_ldem.solver.features import tables_of_all_features

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

AMPLITUDE = 1e-10
"""Random displacement at the start, m: zeros and subnormal numbers would distort the time."""

SECONDS = 1.0
"""Shortest time to measure, s."""


@dataclass(frozen=True)
class Cost:
    """The cost of a scene: fields, their bytes, compiled kernels, milliseconds a step."""

    fields: int
    bytes: int
    kernels: int
    ms: float | None = None


KEPT = ("supports", "floor", "contact", "load", "start", "probe", "notch")
"""Tables that everything has where the scene has them."""


def everything(scene: Scene) -> Scene:
    """The scene's plate and precision with every feature that a plate can have."""
    data = scene.model_dump(by_alias=True, exclude_none=True)
    plate, material = data["plate"], data["material"]
    plate["angle"] = 0
    width = scene.plate.diameter or min(scene.plate.actual_size[:2])
    if plate["shape"] != "disc":
        plate["shape"] = "rectangle"
        for key in ("narrow_width", "narrow_length", "fillet_radius", *FILES, "file_sha256"):
            plate.pop(key, None)
    material = {k: v for k, v in material.items() if k != "failure_factor"}
    tables: dict[str, Any] = {
        "scenario": "impact",
        "plate": plate,
        "material": {"fracture_energy": 1034.0} | material,
        "striker": _strikers(scene, 0.2 * width),
        "clamp": {
            "kind": "rings",
            "inner_diameter": 0.6 * width,
            "outer_diameter": 0.99 * width,
            "friction": 0.1,
        },
        "solver": data["solver"],
        "output": data["output"],
    }
    kept = {name: data[name] for name in KEPT if data.get(name)}
    for body in {"supports", "floor"} & {*kept}:
        kept[body] = kept[body] | {"friction": 0.1}
    tables |= kept
    for feature in tables_of_all_features(scene):
        for name, table in feature.items():
            tables[name] = table if isinstance(table, list) else tables.get(name, {}) | table
    if scene.notch:  # in place of the one that switches the feature on
        tables["notch"] = kept["notch"]
    return parse_scene(tables)


def _strikers(scene: Scene, diameter: float) -> list[dict[str, Any]]:
    """One striker that rubs, or as many as the scene has, all of one diameter (m)."""
    found = []
    for striker in scene.strikers or (None,):
        own = {} if striker is None else striker.model_dump(by_alias=True, exclude_none=True)
        kept = {name: own[name] for name in ("guided", "velocity") if name in own}
        found.append({"velocity": 1.0, "mass": 1.0, "friction": 0.1} | kept)
        found[-1]["diameter"] = diameter
    return found


KERNELS_OF_EVERYTHING = (
    "step",
    "energies",
    "contact: striker",
    "nodes near: striker",
    "contact: rings",
    "nodes near: rings",
    "broken bars",
    "damage before the step",
)
"""The ``kernels`` of a scene of ``everything`` that has nothing besides."""

OF_THE_STEP = ("contact: ", "damage before the step")
"""Names, or their beginnings, of what is a part of the step's kernel where one thread takes it."""


def kernels_of_everything(simulation: "Simulation") -> int:
    """Number of ``kernels`` that the scene compiles with everything switched on.

    Everything has no grips, because it has rings instead.
    """
    grips = simulation.scene.grips is not None
    without = {"gauge", *(f"{kind}: {GRIPS.name}" for kind in ("contact", "nodes near"))}
    own = {name for name in kernels(simulation) if not (grips and name in without)}
    return len(own | {*_of_their_own(simulation, KERNELS_OF_EVERYTHING)})


def kernels(simulation: "Simulation") -> list[str]:
    """The kernels that a run of the simulation compiles, apart from those that copy fields."""
    found = ["step", "energies"]
    found += [kernel for body in simulation.bodies for kernel in body.kernel_names()]
    if simulation.fragments is not None:
        found += simulation.fragments.kernel_names()
    if simulation.dynamics.features.damage:
        found.append("broken bars")
    recorded = {quantity for probe in simulation.scene.probes for quantity in probe.quantities}
    if not recorded.isdisjoint(OF_NODES):
        found.append("motions of probes")
    if recorded - {*OF_NODES}:
        found.append("strains of probes")
    if "stress" in recorded:
        found.append("stresses of probes")
    features = simulation.dynamics.features
    if (features.crack or features.weakening) and simulation.dynamics.in_strips:
        found.append("damage before the step")
    return _of_their_own(simulation, found)


def _of_their_own(simulation: "Simulation", names: Sequence[str]) -> list[str]:
    """The names of kernels less those that the step's kernel holds."""
    return [name for name in names if not (simulation.alone and name.startswith(OF_THE_STEP))]


def cost(simulation: "Simulation") -> Cost:
    """The fields and kernels that a simulation has built."""
    sizes = simulation.field_bytes()
    return Cost(len(sizes), sum(sizes.values()), len(kernels(simulation)))


def measure(simulation: "Simulation", seconds: float = SECONDS) -> float:
    """Milliseconds a step, contact and a history row at the scene's interval included."""
    dynamics = simulation.dynamics
    exists = dynamics.lattice.exists()[..., None]
    shape = (*exists.shape[:-1], 3)
    start = AMPLITUDE * exists * np.random.default_rng(0).uniform(-1, 1, shape)
    simulation.start_from(start, np.zeros(shape))
    simulation.sample_step()
    simulation.advance(20)
    started, first = time.perf_counter(), simulation.step_number
    while time.perf_counter() - started < seconds:
        simulation.sample_step()
        simulation.advance(simulation.sample_every - 1)
        simulation.energies.total()  # waits for the device
    return 1e3 * (time.perf_counter() - started) / (simulation.step_number - first)


def child(file: Path) -> None:
    """Print the cost of the scene in a file as JSON."""
    from taichi_ldem.solver import backend

    scene = load_scene(file)
    backend.start(scene.solver)
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(scene)
    print(json.dumps(vars(cost(simulation)) | {"ms": measure(simulation)}))


def compare(scenes: dict[str, Scene], folder: Path, rounds: int) -> dict[str, Cost]:
    """Costs by name, each the median of rounds in which all take turns."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in scenes}
    for _ in range(rounds):
        for name, scene in scenes.items():
            file = folder / f"{name}.toml"
            file.write_text(scene_to_toml(scene), encoding="utf-8")
            command = [sys.executable, "-m", "taichi_ldem.scenarios.leave_out", str(file)]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            found[name].append(json.loads(done.stdout))
    return {
        name: Cost(**rows[0] | {"ms": statistics.median(row["ms"] for row in rows)})
        for name, rows in found.items()
    }


if __name__ == "__main__":
    child(Path(sys.argv[1]))
