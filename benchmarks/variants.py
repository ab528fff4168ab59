"""Time the step of variants of a scene, interleaved in one process, so that only they differ.

    python benchmarks/variants.py configs/impact.toml disorder.fracture_energy_cv=0.25 \
        "disorder.fracture_energy_cv=0.25 disorder.density_cv=0.1" [--touched 0 0.05 0.2]

The first variant is the scene itself. A step of free flight: no contact, no sampling; the plate
starts with displacements of 1e-10 m drawn at random. ``--touched``: shares of columns, drawn at
random, that count as damaged, so that their bars are looked at one by one. Prints a table of
milliseconds a step, by the clock and as processor time of all threads, which other programs disturb
less: medians of the rounds, and of the ratios to the scene within a round.
"""

import argparse
import statistics
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
STEPS = 4
"""Steps timed at once, in every variant by turns."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("variants", nargs="*", help="settings section.key=value, blanks between")
    parser.add_argument("--precision", default="f64")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--touched", nargs="*", type=float, default=[0.0])
    options = parser.parse_args()
    sys.path[:0] = [str(HERE), str(HERE.parent)]
    import numpy as np
    import taichi as ti

    from taichi_ldem.scene import load_scene
    from taichi_ldem.solver import backend

    solver = [f"solver.precision={options.precision}", f"solver.threads={options.threads}"]
    variants = ["", *options.variants]
    scenes = [load_scene(options.scene, solver + variant.split()) for variant in variants]
    backend.start(scenes[0].solver)
    from taichi_ldem.solver.build import build_dynamics

    plates = [build_dynamics(scene)[0] for scene in scenes]
    for plate in plates:
        shape = (2, *plate.sites, 3)
        start = 1e-10 * plate.lattice.exists()[..., None]
        plate.set_displacement(0, start * np.random.default_rng(0).uniform(-1, 1, shape))
    clocks = (time.perf_counter, time.process_time)

    def steps(plate: object, count: int) -> list[float]:
        started = [clock() for clock in clocks]
        for number in range(count):
            plate.step(number % 2, 5e-8, 5e-8, 0.0, False)
        ti.sync()
        ended = [clock() for clock in clocks]
        return [(end - start) / count for start, end in zip(started, ended, strict=True)]

    print("| variant | columns touched | ms/step | over the scene's | processor time | over it |")
    print("|---|---:|---:|---:|---:|---:|")
    for share in options.touched:
        for plate in plates:
            if plate.features.history:
                chosen = np.random.default_rng(1).random(plate.touched.shape) < share
                every_lane = (1 << plate.lanes.width) - 1
                plate.touched.from_numpy((every_lane * chosen).astype(np.uint8))
            steps(plate, STEPS)
        times = [[steps(plate, STEPS) for plate in plates] for _ in range(options.rounds)]
        for number, variant in enumerate(variants):
            found = f"| {variant or 'the scene'} | {share:.0%}"
            for n in range(len(clocks)):
                mine = statistics.median(row[number][n] for row in times)
                ratio = statistics.median(row[number][n] / row[0][n] for row in times)
                found += f" | {1e3 * mine:.2f} | {ratio:.2f}"
            print(f"{found} |")


if __name__ == "__main__":
    main()
