"""Bars at the tip of a crack: which of them fail, and what that costs."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import DAMAGE, block_scene
from support.reference import Body

from taichi_ldem.errors import SceneError
from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene
    from taichi_ldem.solver.simulation import Simulation

Array = np.ndarray
NOTCH = {"normal": "x", "position": 1.6e-3, "from": [-1.0, -1.0], "to": [0.0, 1.0]}
CRACK = DAMAGE | {"failure_strain": 0.05, "fracture": "crack"}


STRAIN = ({"perturbation": 0.07}, {"tip_criterion": "strain"})
"""Of the plate and the material: bars at tips that fail at a tip strain."""
CUBIC_STRAIN = ({"perturbation": 0.07, "lattice": "cubic-26"}, {"tip_criterion": "strain"})
C = {"module": (2.0, 4.0), "cubic-26": (2.5, 1.9, 1.7)}
"""[family] c of tip strains by lattice, from the strips in docs/tension.md."""
MOST_CUT = {"module": 5, "cubic-26": 9}
"""Bars that a plane (100) takes from a node: those with a component along its normal."""

MODULE = pytest.param(({}, {}), id="module")
CUBIC = pytest.param(({"lattice": "cubic-26"}, {}), id="cubic-26", marks=pytest.mark.slow)
PERTURBED = pytest.param(STRAIN, id="strain", marks=pytest.mark.slow)
CUBIC_PERTURBED = pytest.param(CUBIC_STRAIN, id="cubic-26-strain", marks=pytest.mark.slow)
# slow for the time that kernels take


def _scene(keys: "tuple[dict[str, Any], dict[str, Any]]", **tables: Any) -> "Scene":
    """A block whose modules are cut half through; a bar alone would bear strains of 5 %."""
    plate, material = keys
    return block_scene(20, 6, 3, material=CRACK | material, notch=[NOTCH], plate=plate, **tables)


@pytest.fixture(scope="module", params=[MODULE, CUBIC, PERTURBED, CUBIC_PERTURBED])
def simulation(taichi: None, request: pytest.FixtureRequest) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(_scene(request.param))


def _lengths(lattice: Lattice, field: Array | float = 0.0) -> list[Array]:
    """For each bar, its length in module edges from (nodes, *S, 3) displacements in those."""
    offsets = 0.0 if lattice.offsets is None else lattice.offsets / lattice.spacing
    moved = np.zeros((lattice.cell.sublattices, *lattice.sites, 3)) + offsets + field
    found = []
    for bar, ends in enumerate(lattice.cell.ends):
        first, second = (
            np.roll(moved[s], [-n for n in offset], axis=(0, 1, 2)) for s, offset in ends
        )
        found.append(np.linalg.norm(second - first + lattice.cell.vectors[bar], axis=-1))
    return found


def _of_bars(lattice: Lattice, field: Array) -> list[Array]:
    """For each bar, its elongation over L0 from (nodes, *S, 3) displacements in module edges."""
    both = zip(_lengths(lattice, field), _lengths(lattice), strict=True)
    return [length / rest - 1 for length, rest in both]


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
    by_strain = simulation.scene.material.tip_criterion == "strain"
    name = lattice.cell.name
    most_failed = MOST_CUT[name] if by_strain else lattice.cell.fewest_cut
    strain, rest = _of_bars(lattice, field), _lengths(lattice)
    opening = np.zeros((lattice.cell.sublattices, *lattice.sites))
    count = np.zeros((lattice.cell.sublattices, *lattice.sites), dtype=int)
    for bar, *site in np.argwhere(cut):
        for s, offset in lattice.cell.ends[bar]:
            node = (s, *(np.array(site) + offset))
            opening[node] = max(opening[node], (strain[bar] * rest[bar])[tuple(site)])
            count[node] += 1
    fails = np.stack([s >= CRACK["failure_strain"] for s in strain]) & there & ~cut
    for bar, *site in np.argwhere(there & ~cut):
        nodes = [(s, *(np.array(site) + offset)) for s, offset in lattice.cell.ends[bar]]
        parted = max(opening[n] if count[n] <= most_failed else 0.0 for n in nodes)
        own, length = strain[bar][tuple(site)], rest[bar][tuple(site)]
        family = lattice.cell.family[bar]
        if parted > 0 and own > 0 and parted <= 4 * np.pi * own * length:
            share = min(parted / length, lattice.cell.opening * own)
            if by_strain:
                share = C[name][family] * own if parted >= own * length else 0.0
            fails[(bar, *site)] |= own * share / 2 >= scene_cost[family]
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
    old = simulation.scene
    plate = {"lattice": old.plate.lattice, "perturbation": old.plate.perturbation}
    simulation.reset(_scene((plate, {"tip_criterion": old.material.tip_criterion}), **times))
    lattice = simulation.dynamics.lattice
    stretch = np.zeros((lattice.cell.sublattices, *lattice.sites, 3))
    stretch[..., 0] = 0.012 * lattice.positions()[..., 0] * lattice.exists()
    simulation.start_from(stretch, np.zeros_like(stretch))
    samples = list(simulation.samples())
    assert samples[-1].broken_bars > 50
    assert samples[-1].ledger.fracture > 0.05 * samples[0].ledger.strain
    assert max(sample.energy_error for sample in samples) < 3e-3


@pytest.mark.parametrize(
    ("plate", "fracture", "says"),
    [
        ({}, "crack", "unless plate.perturbation > 0"),
        ({"lattice": "cubic-26"}, "crack", "unless plate.perturbation > 0"),
        ({"perturbation": 0.07}, "bar", 'unless material.fracture = "crack"'),
    ],
)
def test_tip_strains_need_a_perturbed_lattice(
    plate: dict[str, Any], fracture: str, says: str
) -> None:
    with pytest.raises(SceneError, match=r'material\.tip_criterion = "strain"') as refused:
        _scene((plate, {"tip_criterion": "strain", "fracture": fracture}))
    assert says in str(refused.value)


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
