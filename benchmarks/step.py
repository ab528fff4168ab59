"""Time the full step of a scene in a process of its own: damage, contact, sampling as in a run.

    python benchmarks/step.py configs/impact.toml --precision f64 --threads 2 [--modules 60]

The plate starts with displacements of 1e-10 m drawn at random: ahead of the first wave of a plate
at rest lie subnormal numbers, which slow any code and which no later step sees. Prints one JSON
object.
"""

import argparse
import json
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
AMPLITUDE = 1e-10
WARM_UP = 20
"""Steps taken before the clock starts."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--precision", default="f64")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--arch", default="cpu", help="cpu, cuda or vulkan")
    parser.add_argument("--modules", type=int, help="a square plate of so many along x and y")
    parser.add_argument("--seconds", type=float, default=1.0, help="time at least so long")
    options = parser.parse_args()
    sys.path[:0] = [str(HERE), str(HERE.parent)]
    import numpy as np
    from layout import passes_bytes, scaled, step_bytes

    from taichi_ldem.scene import load_scene
    from taichi_ldem.solver import backend

    begun = time.perf_counter()
    solver = [f"solver.precision={options.precision}", f"solver.threads={options.threads}"]
    solver.append(f"solver.arch={options.arch}")
    scene = load_scene(options.scene, solver)
    if options.modules:
        scene = load_scene(options.scene, solver + scaled(scene, options.modules))
    backend.start(scene.solver)
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(scene)
    dynamics = simulation.dynamics
    exists = dynamics.lattice.exists()[..., None]
    shape = (*exists.shape[:-1], 3)
    start = AMPLITUDE * exists * np.random.default_rng(0).uniform(-1, 1, shape)
    simulation.start_from(start, np.zeros(shape))
    simulation.sample_step()  # compiles all that a run needs
    simulation.advance(WARM_UP)
    simulation.sample_step()  # waits for the device
    setup = time.perf_counter() - begun
    started, first = time.perf_counter(), simulation.step_number
    while time.perf_counter() - started < options.seconds:
        simulation.sample_step()  # waits for the device
        simulation.advance(simulation.sample_every - 1)
        simulation.energies.total()  # waits, too
    taken = (time.perf_counter() - started) / (simulation.step_number - first)
    bars = dynamics.lattice.bars
    item = np.dtype(dynamics.numpy_float()).itemsize
    moved = step_bytes(dynamics.sites, dynamics.lanes, item, dynamics.features.history)
    if not dynamics.in_strips:
        moved += passes_bytes(dynamics.sites, item)
    found = {
        "bars": bars,
        "ms": 1e3 * taken,
        "mbar_s": bars / taken / 1e6,
        "steps": simulation.step_number - first,
        "step_bytes": moved,
        "setup_s": setup,
        "field_bytes": sum(simulation.field_bytes().values()),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
