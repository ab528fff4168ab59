"""Nodes that land elastically on rigid bodies: no energy is lost, and momentum is kept.

Without friction, whatever the plate has after a strike is what the striker has given it.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene
    from taichi_ldem.solver.simulation import Sample, Simulation

ELASTIC = {"landing": "elastic"}
RINGS = {"kind": "rings", "inner_diameter": 4.2e-3, "outer_diameter": 5.8e-3}
STRIKER = {"diameter": 2e-3, "mass": 5e-6, "velocity": 5.0, "gap": 1e-6}
OBLIQUE = STRIKER | {"velocity": [2.0, -1.0, -5.0], "guided": False, "position": [3e-4, -2e-4]}


def built(scene: "Scene") -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(scene)


def samples(simulation: "Simulation", count: int, every: int = 10) -> "list[Sample]":
    """Samples every so many steps."""
    found = []
    for _ in range(count):
        found.append(simulation.sample_step())
        simulation.guard(found[-1])
        simulation.advance(every - 1)
    return found


def momentum(simulation: "Simulation") -> np.ndarray:
    """(3,) of the plate, half a step before now, kg m/s."""
    masses, velocity = simulation.dynamics.masses(), simulation.dynamics.get_velocity()
    return np.asarray((masses[..., None] * velocity).sum((0, 1, 2, 3)))


def falling(modules: int, landing: str) -> "Scene":
    """A block that falls flat on a floor at 1 m/s, in steps so short that bars do not push yet."""
    return block_scene(
        4,
        4,
        modules,
        floor={"gap": 1e-6},
        plate={"velocity": [0.0, 0.0, -1.0]},
        contact={"landing": landing},
        solver={"duration": 1e-4, "safety": 0.1},
    )


@pytest.mark.parametrize("modules", [3, 6])
def test_a_block_that_falls_flat_loses_the_energy_of_its_lowest_layer_or_none(
    taichi: None, modules: int
) -> None:
    """Half of the mass lies in n + 1 layers of corners, the outer ones of half weight: 1/(4 n)."""
    lost = {}
    for landing in ("inelastic", "elastic"):
        simulation = built(falling(modules, landing))
        mass = simulation.dynamics.masses().sum()
        rows = samples(simulation, 100, 70)
        start = 0.5 * mass
        assert not rows[-1].observed["floor_force_n"]  # it has left the floor
        assert momentum(simulation)[2] > 0.7 * mass  # upwards, and the rest of the energy vibrates
        lost[landing] = rows[-1].ledger.contact / start
        assert max(row.energy_error for row in rows) < 5e-5
    assert lost["inelastic"] == pytest.approx(1 / (4 * modules), rel=0.05)
    assert abs(lost["elastic"]) < 1e-12


@pytest.mark.parametrize("striker", [STRIKER, OBLIQUE], ids=["guided", "not guided"])
def test_a_strike_keeps_energy_and_momentum_for_a_striker_as_light_as_the_plate(
    taichi: None, striker: dict[str, Any]
) -> None:
    simulation = built(block_scene(8, 8, 3, striker=striker, contact=ELASTIC))
    part = simulation.body("striker")
    given = striker["velocity"] if striker is OBLIQUE else [0.0, 0.0, -5.0]
    start = 5e-6 * np.array(given)
    rows = samples(simulation, 60)
    ledgers = [row.ledger for row in rows]
    assert simulation.contact_loss("striker") == pytest.approx(0, abs=1e-13 * ledgers[0].stored)
    assert all(row.energy_error < 1e-3 for row in rows)  # large displacements: step's own error
    held = [row.observed["contact_elastic_j"] for row in rows]
    assert held == [ledger.touching for ledger in ledgers]
    assert max(np.abs(held)) < 0.1 * ledgers[0].stored
    assert held[-1] == pytest.approx(0, abs=1e-13 * ledgers[0].stored)  # they have parted
    own = part.vector(3) if striker is OBLIQUE else np.array([0.0, 0.0, -part.motion()[2]])
    after = momentum(simulation) + 5e-6 * own
    axes = [0, 1, 2] if striker is OBLIQUE else [2]  # a guide takes momentum along x and y
    np.testing.assert_allclose(after[axes], start[axes], atol=1e-12 * np.abs(start).max())
    assert own[2] > 0.5 * start[2] / 5e-6  # it has been thrown back, or nearly stopped


def test_rings_and_supports_lose_nothing(taichi: None) -> None:
    for tables in ({"clamp": RINGS}, {"supports": {"kind": "ring", "diameter": 1e-3}}):
        if "supports" in tables:
            tables["supports"]["ring_diameter"] = 4e-3
        simulation = built(
            block_scene(12, 12, 2, striker=STRIKER | {"mass": 1e-3}, contact=ELASTIC, **tables)
        )
        rows = samples(simulation, 60)
        name = "ring" if "clamp" in tables else "support"
        assert max(abs(row.observed[f"{name}_force_n"]) for row in rows) > 1
        for body in simulation.bodies:
            assert abs(simulation.contact_loss(body.name)) < 1e-12 * rows[0].ledger.stored
        given = rows[0].ledger.kinetic_bodies - rows[-1].ledger.kinetic_bodies
        assert rows[-1].ledger.kinetic_plate + rows[-1].ledger.strain == pytest.approx(
            given - rows[-1].ledger.touching, rel=1e-3
        )


def test_no_node_gets_into_a_floor_and_a_resting_block_weighs_what_it_should(
    taichi: None,
) -> None:
    gravity = 1e4  # m/s2
    scene = block_scene(6, 4, 2, floor={}, plate={"gravity": [0.0, 0.0, -gravity]}, contact=ELASTIC)
    simulation = built(scene)
    rows = samples(simulation, 40, 50)
    lattice = simulation.dynamics.lattice
    height = (lattice.positions()[..., 2] + simulation.displacement()[..., 2])[lattice.exists()]
    assert height.min() > -1e-12 * SPACING
    weight = PMMA["density"] * 48 * SPACING**3 * gravity
    forces = [row.observed["floor_force_n"] for row in rows[10:]]
    assert np.mean(forces) == pytest.approx(weight, rel=2e-3)
    assert abs(rows[-1].ledger.contact) < 1e-12 * rows[-1].ledger.stored


def test_friction_still_takes_energy_and_obeys_coulomb(taichi: None) -> None:
    """A block slides on a floor. When it is slow, nodes that bounce stick in some of the steps."""
    speed, gravity, friction = 1.0, 1e4, 0.6
    scene = block_scene(
        6,
        4,
        2,
        floor={"friction": friction},
        plate={"gravity": [0.0, 0.0, -gravity], "velocity": [speed, 0.0, 0.0]},
        contact=ELASTIC,
    )
    from taichi_ldem.solver.contact.kernels.body import IMPULSE

    simulation = built(scene)
    mass = simulation.dynamics.masses().sum()
    samples(simulation, 5, 100)
    drag = mass * speed - momentum(simulation)[0]
    pushed = simulation.body("floor").collected()[IMPULSE]
    assert 0.99 < drag / (friction * pushed) <= 1 + 1e-12
    rows = samples(simulation, 20, 100)
    assert 0.97 < rows[-1].ledger.contact / (0.5 * mass * speed**2) < 1
    assert abs(momentum(simulation)[0]) < 0.02 * mass * speed


def test_it_continues_from_its_state_to_the_last_bit(taichi: None) -> None:
    scene = block_scene(12, 12, 2, striker=STRIKER, clamp=RINGS, contact=ELASTIC)
    whole, resumed = built(scene), built(scene)
    samples(whole, 5, 21)
    resumed.restore_state(whole.saved_state())
    for mine, other in zip(samples(whole, 5, 21), samples(resumed, 5, 21), strict=True):
        assert mine == other
    np.testing.assert_array_equal(whole.displacement(), resumed.displacement())
