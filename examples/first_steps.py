"""Load a scene, change it, run a part of it, look at the arrays, and run on to the end."""

from pathlib import Path

import numpy as np

from taichi_ldem import Scene, Simulation

HERE = Path(__file__).parent

scene = Scene.load(HERE / "plate.toml", "striker.velocity=4.0")
with Simulation(scene) as simulation:
    print(simulation)

    history = simulation.run(until=5e-5)
    lowest = simulation.displacement[:, 2].argmin()
    x, y, z = 1e3 * simulation.positions[lowest]
    depth = -1e3 * simulation.displacement[lowest, 2]
    print(f"deepest: {depth:.3f} mm at x = {x:.2f}, y = {y:.2f}, z = {z:.2f} mm")

    simulation.step(100)  # no sample is taken in between
    speed = np.linalg.norm(simulation.velocity, axis=1).max()
    print(f"fastest node at {1e6 * simulation.time:.1f} us: {speed:.1f} m/s")

    history = simulation.run()
    peak = history["striker_force_n"].argmax()
    print(
        f"largest force {history['striker_force_n'][peak]:.0f} N "
        f"at {1e6 * history['time_s'][peak]:.0f} us; "
        f"{simulation.broken_fraction.max():.0%} of the worst module's bars are broken"
    )
