"""Run several simulations in one process, as in a notebook, each with another striker speed."""

from pathlib import Path

from taichi_ldem import Scene, Simulation

scene = Scene.load(Path(__file__).parent / "plate.toml", "solver.duration=1e-4")

print("speed [m/s]  largest force [N]  broken bars")
for speed in (3.5, 5.0):
    simulation = Simulation(scene.changed(f"striker.velocity={speed}"))
    history = simulation.run()
    print(
        f"{speed:11.1f}  {history['striker_force_n'].max():17.0f}  {history['broken_bars'][-1]:.0f}"
    )
# Each new simulation closes the one before and gives its memory back; arrays that were read stay.
