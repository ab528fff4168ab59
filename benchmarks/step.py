"""Time the full step of a scene: damage, contact and sampling as a run has them.

    python benchmarks/step.py configs/impact.toml f64 2 [STEPS]

Prints one line: ms a step, million bars a second.
"""

import sys
import time


def main() -> None:
    scene_file, precision, threads, steps = (*sys.argv[1:], "160")[:4]
    from taichi_ldem import backend
    from taichi_ldem.scene import load_scene

    scene = load_scene(scene_file, [f"solver.precision={precision}", f"solver.threads={threads}"])
    backend.start(scene.solver)
    from taichi_ldem.simulation import Simulation

    simulation = Simulation(scene)
    simulation.sample_step()  # compiles all that a run needs
    # ahead of the first wave lie subnormal displacements, which no later step sees: let it pass
    simulation.advance(4 * max(simulation.dynamics.sites))
    wanted = max(int(steps), simulation.sample_every)
    started, first = time.perf_counter(), simulation.step_number
    while simulation.step_number - first < wanted:
        simulation.sample_step()
        simulation.advance(simulation.sample_every - 1)
    taken = (time.perf_counter() - started) / (simulation.step_number - first)
    rate = simulation.dynamics.lattice.bars / taken / 1e6
    print(f"{1e3 * taken:.4f} ms/step {rate:.2f} Mbar/s")


if __name__ == "__main__":
    main()
