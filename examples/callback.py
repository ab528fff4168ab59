"""Watch a run with a callback, and stop it when the cracks have grown to a given radius."""

from pathlib import Path

import numpy as np

from taichi_ldem import Simulation

simulation = Simulation(Path(__file__).parent / "plate.toml")
reach: list[tuple[float, float]] = []  # time, s, and radius of the outermost broken bar, m


@simulation.on_sample
def watch(simulation: Simulation, sample) -> None:
    """Record how far from the axis bars are broken, and stop the run at 2 mm."""
    if sample.broken_bars:
        x, y, _ = simulation.broken_bars.position.T
        reach.append((sample.time, np.hypot(x, y).max()))
        if reach[-1][1] > 2e-3:
            simulation.stop()


simulation.run()
for time, radius in reach:
    print(f"{1e6 * time:5.0f} us: cracked out to {1e3 * radius:.2f} mm")
print(f"stopped: finished = {simulation.finished}")
simulation.close()
