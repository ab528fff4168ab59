"""Plates that break into pieces which touch: bits, restarts, variants, and long runs of debris."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.paths import ROOT

RUN = """
import sys
import numpy as np
sys.path.insert(0, "tests")
from support.blocks import DAMAGE, block_scene
from taichi_ldem.solver import backend

threads, variant, out = int(sys.argv[1]), *sys.argv[2:]
more = {
    "plain": {},
    "closing": {"material": DAMAGE | {"after_failure": "closing", "fracture": "crack"}},
    "disorder": {"disorder": {"fracture_energy_cv": 0.2, "density_cv": 0.1, "seed": 3},
                 "plate": {"perturbation": 0.15}, "solver": {"damping": 200.0}},
    "cubic": {"plate": {"lattice": "cubic-26"}},
    "f32": {"solver": {"precision": "f32"}},
    "long": {"solver": {"duration": 100_000 * 8e-8, "time_step": 8e-8},
             "output": {"history_interval": 1e-5}},
}[variant]
tables = {
    "material": DAMAGE,
    "striker": {"diameter": 2e-3, "mass": 1e-3, "velocity": 25.0},
    "clamp": {"kind": "rings", "inner_diameter": 3.2e-3, "outer_diameter": 5.6e-3},
    "contact": {"fragments": True, "friction": 0.4},
    "solver": {"duration": 1e-4, "safety": 0.5, "threads": threads},
    "output": {"history_interval": 1e-6},
}
for name, table in more.items():
    tables[name] = tables.get(name, {}) | table
scene = block_scene(12, 12, 2, **tables)
backend.start(scene.solver)
from taichi_ldem.solver.simulation import Simulation

simulation = Simulation(scene)
saved = []

def between():
    if simulation.step_number >= 500 and not saved:
        saved.append(simulation.saved_state())

def row(s):
    return (s.broken_bars, s.energy_error_of_plate, *vars(s.ledger).values())

def end():
    return simulation.displacement(), simulation.dynamics.get_velocity()

rows = [row(s) for s in simulation.samples(between)]
place, velocity = end()
dust = simulation.fragments.dust_size
steps = simulation.step_number
if variant != "long":
    # the same from the state in the middle
    start = saved[0]
    simulation.reset(scene)
    simulation.compile()
    simulation.restore_state(start)
    again = [row(s) for s in simulation.samples()]
    assert again == rows[-len(again):] and 20 < len(again) < len(rows)
    for mine, theirs in zip((place, velocity), end(), strict=True):
        np.testing.assert_array_equal(mine, theirs)
rows = np.array(rows, dtype=float)
np.savez(out, rows=rows, displacement=place, velocity=velocity, dust=dust, steps=steps)
"""

BROKEN, ERROR, KINETIC, BODIES, STRAIN, FRACTURE, DAMPED, LOST, _, TOUCHING = range(10)


def _run(folder: Path, threads: int, variant: str) -> dict[str, np.ndarray]:
    out = folder / f"{threads}-{variant}.npz"
    command = [sys.executable, "-c", RUN, str(threads), variant, str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stderr[-3000:]
    with np.load(out) as data:
        return dict(data)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["plain", "closing", "disorder", "cubic", "f32"])
def test_a_shattered_plate_keeps_bits_and_energy(tmp_path: Path, variant: str) -> None:
    """1 and 2 threads, and a run that goes on from its middle (in the child), give equal bits."""
    one, two = (_run(tmp_path, threads, variant) for threads in (1, 2))
    for name in one:
        np.testing.assert_array_equal(one[name], two[name])
    rows = one["rows"]
    assert rows[-1, BROKEN] > 300
    assert rows[:, TOUCHING].max() > 0
    assert rows[-1, LOST] > 0
    assert rows[:, ERROR].max() < 0.03


@pytest.mark.slow
def test_debris_flies_for_100_000_steps(tmp_path: Path) -> None:
    run = _run(tmp_path, 2, "long")
    assert run["steps"] >= 100_000
    rows = run["rows"]
    assert rows[:, ERROR].max() < 0.03
    # no energy comes from contact: what the pieces hold only falls once the striker is through
    late = rows[len(rows) // 2 :]
    held = late[:, KINETIC] + late[:, STRAIN] + late[:, TOUCHING]
    assert held.max() <= held[0] * (1 + 1e-3)
