"""Bars at the tip of a crack: which of them fail, and what that costs."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import DAMAGE, block_scene
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

Array = np.ndarray
NOTCH = {"normal": "x", "position": 1.6e-3, "from": [-1.0, -1.0], "to": [0.0, 1.0]}
CRACK = DAMAGE | {"failure_strain": 0.05, "fracture": "crack"}


CUBIC = pytest.param("cubic-26", marks=pytest.mark.slow)  # for the time that kernels take


@pytest.fixture(scope="module", params=["module", CUBIC])
def simulation(taichi: None, request: pytest.FixtureRequest) -> "Simulation":
    """A block whose modules are cut half through; a bar alone would bear strains of 5 %."""
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(
        block_scene(20, 6, 3, material=CRACK, notch=[NOTCH], plate={"lattice": request.param})
    )


def _of_bars(lattice: Lattice, field: Array) -> list[Array]:
    """For each bar, its elongation over L0 from (nodes, *S, 3) displacements in module edges."""
    found = []
    for bar, ends in enumerate(lattice.cell.ends):
        first, second = (
            np.roll(field[s], [-n for n in offset], axis=(0, 1, 2)) for s, offset in ends
        )
        rest = np.linalg.norm(lattice.cell.vectors[bar])
        found.append(np.linalg.norm(second - first + lattice.cell.vectors[bar], axis=-1) / rest - 1)
    return found


def _expected(simulation: "Simulation", field: Array, scene_cost: tuple[float, ...]) -> Array:
    """(bars, *S) bars that should fail: by strength, or by the rule of ``solver.tips``.

    Args:
        field: (nodes, *S, 3) displacements in module edges.
        scene_cost: G_f A^f / (EA L0) of the families.
    """
    lattice = simulation.dynamics.lattice
    removed = simulation.dynamics.lanes.gather(simulation.dynamics.removed.to_numpy())
    there = np.moveaxis(lattice.bar_exists(), -1, 0)
    cut = np.stack([(removed >> bar & 1).astype(bool) for bar in range(lattice.cell.bars)]) & there
    strain = _of_bars(lattice, field)
    rest = [np.linalg.norm(vector) for vector in lattice.cell.vectors]
    opening = np.zeros((lattice.cell.sublattices, *lattice.sites))
    count = np.zeros((lattice.cell.sublattices, *lattice.sites), dtype=int)
    for bar, *site in np.argwhere(cut):
        for s, offset in lattice.cell.ends[bar]:
            node = (s, *(np.array(site) + offset))
            opening[node] = max(opening[node], strain[bar][tuple(site)] * rest[bar])
            count[node] += 1
    fails = np.stack([s >= CRACK["failure_strain"] for s in strain]) & there & ~cut
    for bar, *site in np.argwhere(there & ~cut):
        nodes = [(s, *(np.array(site) + offset)) for s, offset in lattice.cell.ends[bar]]
        parted = max(opening[n] if count[n] <= lattice.cell.fewest_cut else 0.0 for n in nodes)
        own = strain[bar][tuple(site)]
        if parted > 0 and own > 0 and parted <= 4 * np.pi * own * rest[bar]:
            share = min(parted / rest[bar], lattice.cell.opening * own)
            fails[(bar, *site)] |= own * share / 2 >= scene_cost[lattice.cell.family[bar]]
    return fails


@pytest.mark.parametrize("seed", range(4))
def test_bars_fail_where_they_release_what_they_cost(simulation: "Simulation", seed: int) -> None:
    simulation.reset(simulation.scene)
    dynamics = simulation.dynamics
    lattice = dynamics.lattice
    bars = mat.check(simulation.scene)
    cost = tuple(family.toughness for family in bars)
    random = np.random.default_rng(seed)
    field = (
        0.015
        * random.normal(size=(lattice.cell.sublattices, *lattice.sites, 3))
        * lattice.exists()[..., None]
    )
    field[..., 0] += 0.01 * lattice.positions()[..., 0] / lattice.spacing * lattice.exists()
    dynamics.set_displacement(0, field * lattice.spacing)
    dynamics.kick(0, 0.0)
    sites, numbers = dynamics.new_broken()
    found = np.zeros((lattice.cell.bars, *lattice.sites), dtype=bool)
    found[(numbers, *sites.T)] = True
    expected = _expected(simulation, field, cost)
    np.testing.assert_array_equal(found, expected)
    strong = np.stack([s < CRACK["failure_strain"] for s in _of_bars(lattice, field)])
    assert (expected & strong).sum() > 10


def test_a_bar_at_a_tip_costs_g_f_times_its_area() -> None:
    scene = block_scene(8, 4, 3, material=CRACK)
    bars = mat.check(scene)
    for family in (bars.longitudinal, bars.diagonal):
        energy = family.toughness * family.axial_stiffness * family.length
        assert energy == pytest.approx(1034.0 * family.fracture_area, rel=1e-12)
        assert family.ductility == 1.0  # at 5 %, bars of this length cannot soften


def test_energy_closes_while_a_crack_runs(simulation: "Simulation") -> None:
    times = {"solver": {"duration": 1.5e-5}, "output": {"history_interval": 2e-7}}
    plate = {"lattice": simulation.scene.plate.lattice}
    simulation.reset(block_scene(20, 6, 3, material=CRACK, notch=[NOTCH], plate=plate, **times))
    lattice = simulation.dynamics.lattice
    stretch = np.zeros((lattice.cell.sublattices, *lattice.sites, 3))
    stretch[..., 0] = 0.012 * lattice.positions()[..., 0] * lattice.exists()
    simulation.start_from(stretch, np.zeros_like(stretch))
    samples = list(simulation.samples())
    assert samples[-1].broken_bars > 50
    assert samples[-1].ledger.fracture > 0.05 * samples[0].ledger.strain
    assert max(sample.energy_error for sample in samples) < 3e-3


@pytest.mark.slow
def test_a_body_without_cracks_does_not_change(taichi: None) -> None:
    """Elastic waves are those of the paper's law to the last bit: the pass touches nothing."""
    from taichi_ldem.solver.simulation import Simulation

    ends = []
    for fracture in ("bar", "crack"):
        material = DAMAGE | {"fracture": fracture}
        simulation = Simulation(block_scene(12, 3, 2, material=material))
        lattice = simulation.dynamics.lattice
        body = Body(lattice.mask, lattice.spacing)
        start = np.random.default_rng(2).normal(0, 1e-7, (len(body.places), 3))
        simulation.start_from(body.spread(start), body.spread(0 * start))
        simulation.advance(50)
        ends.append(simulation.displacement())
    np.testing.assert_array_equal(*ends)
