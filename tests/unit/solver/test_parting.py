"""Faces of a crack that part: what resists them, and where its work goes."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import DAMAGE, block_scene

from taichi_ldem.errors import SceneError
from taichi_ldem.model import material as mat

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene
    from taichi_ldem.solver.simulation import Simulation

NOTCH = {"normal": "x", "position": 1.6e-3, "from": [-1.0, -1.0], "to": [0.0, 1.0]}
VISCOUS = DAMAGE | {"failure_strain": 0.05, "fracture": "crack", "crack_opening": "viscous"}

# sqrt(rho E (1 - nu) / ((1 + nu) (1 - 2 nu))) of PMMA: 1190 kg/m3, 3.35 GPa, 1/4
IMPEDANCE = np.sqrt(1190.0 * 3.35e9 * 0.75 / (1.25 * 0.5))


def _scene(**solver: float) -> "Scene":
    times = {"solver": {"duration": 1.5e-5} | solver, "output": {"history_interval": 2e-7}}
    return block_scene(20, 6, 3, material=VISCOUS, notch=[NOTCH], **times)


@pytest.fixture(scope="module")
def simulation(taichi: None) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(_scene())


def test_a_failed_bar_pulls_with_the_impedance_times_its_area_times_its_speed(
    simulation: "Simulation",
) -> None:
    """Speeds change no other force, so what they change in a step is the resistance."""
    simulation.reset(simulation.scene)
    dynamics, random = simulation.dynamics, np.random.default_rng(3)
    lattice, cell = dynamics.lattice, dynamics.cell
    exists = lattice.exists()[..., None]
    removed = dynamics.lanes.gather(dynamics.removed.to_numpy())[..., None]
    there = lattice.bar_exists() & (removed >> np.arange(cell.bars) & 1 == 0)
    failed = there & (random.random(there.shape) < 0.1)
    places = lattice.positions()
    stretched = 1e-4 * places * exists
    velocity = random.normal(0, 1, places.shape) * exists
    step = 1e-9
    after = []
    for speed in (velocity, 0 * velocity):
        dynamics.set_peak(np.where(failed, -0.2, 0.0))
        dynamics.set_displacement(0, stretched)
        dynamics.set_velocity(speed)
        dynamics.step(0, step, step, 0.0, False)
        after.append(dynamics.get_velocity() - speed)
    found = (after[0] - after[1]) / step * dynamics.masses()[..., None]

    families = mat.check(simulation.scene)
    weights = cell.weights(lattice.surface_weights)[lattice.code]
    expected = np.zeros_like(found)
    for bar, *site in np.argwhere(np.moveaxis(failed, -1, 0)):
        (s, a), (t, b) = cell.ends[bar]
        near, far = (s, *(np.array(site) + a)), (t, *(np.array(site) + b))
        along = cell.vectors[bar] / np.linalg.norm(cell.vectors[bar])
        area = families[cell.family[bar]].fracture_area * weights[(*site, bar)]
        pull = IMPEDANCE * area * along @ (velocity[far] - velocity[near])
        expected[near] += pull * along
        expected[far] -= pull * along
    scale = np.abs(expected).max()
    assert scale > 0
    # from velocities of 1 m/s and changes of 1e-6 m/s: ten digits are left, and six of strain
    np.testing.assert_allclose(found, expected, atol=1e-4 * scale)


def test_its_work_is_dissipated_and_energy_closes(simulation: "Simulation") -> None:
    """A broken bar has taken about G_f A^f: a bar on an edge of the block is a quarter of one."""
    simulation.reset(_scene())
    lattice = simulation.dynamics.lattice
    stretch = np.zeros((lattice.cell.sublattices, *lattice.sites, 3))
    stretch[..., 0] = 0.012 * lattice.positions()[..., 0] * lattice.exists()
    simulation.start_from(stretch, np.zeros_like(stretch))
    samples = list(simulation.samples())
    assert samples[-1].broken_bars > 20
    assert max(sample.energy_error for sample in samples) < 3e-4
    costs = [1034.0 * family.fracture_area for family in mat.check(simulation.scene)]
    taken = samples[-1].ledger.fracture / samples[-1].broken_bars
    assert min(costs) / 4 < taken < 1.2 * max(costs)


def test_only_cracks_that_cost_g_f_open_so() -> None:
    with pytest.raises(SceneError, match=r'material.crack_opening.*must be "free"'):
        block_scene(8, 4, 3, material=DAMAGE | {"crack_opening": "viscous"})
