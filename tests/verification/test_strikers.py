"""Strikers that fly obliquely, several of them, indenters and supports, against mechanics.

One scene has nearly everything at once, as every kind of striker takes seconds to compile.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene
from support.reference import Body

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation

MODULE_MASS = PMMA["density"] * SPACING**3
SPEED = 20.0
OBLIQUE = {
    "diameter": 2e-3,
    "mass": 20e-6,
    "velocity": [4.0, -1.5, -10.0],
    "guided": False,
    "position": [0.3e-3, -0.2e-3],
    "gap": 1e-6,
    "friction": 0.3,
}
INDENTER = {
    "shape": "cone",
    "nose_angle": 50.0,
    "diameter": 1.5e-3,
    "velocity": SPEED,
    "motion": "prescribed",
    "position": [-1e-3, 1e-3],  # over a node, which is pushed by the tip itself
    "gap": 0.2e-3,  # it comes when the other striker has hit
}


class Watched:
    """A plate and its strikers, watched at every step.

    Attributes (n steps):
        momentum: (n, 3) of plate and strikers with a mass, kg m/s.
        samples: of every step. speeds: (n, strikers) along -z, m/s.
        deepest: (n,) largest overlap of a node with an unguided round striker, m.
    """

    def __init__(self, scene: Any, steps: int):
        from taichi_ldem.solver.simulation import Simulation

        self.simulation = s = Simulation(scene)
        s.compile()  # as a run does; it must leave nothing behind
        self.body = body = Body(s.dynamics.lattice.mask, SPACING)
        self.masses = MODULE_MASS * body.mass_shares[:, None]
        self.samples: list[Sample] = []
        momentum, speeds = [], []
        for _ in range(steps):
            self.samples.append(s.sample_step())
            total = (self.masses * s.dynamics.get_velocity()[body.index]).sum(axis=0)
            row = []
            for part in s.bodies:
                if not part.name.startswith("striker"):
                    continue
                total = total + (part.table.mass or 0.0) * self.velocity_of(part)
                row.append(part.motion()[2])
            momentum.append(total)
            speeds.append(row)
        self.momentum, self.speeds = np.array(momentum), np.array(speeds)

    @staticmethod
    def velocity_of(striker: Any) -> np.ndarray:
        """(3,) of a striker, m/s."""
        if striker.table.guided:
            return np.array([0.0, 0.0, -striker.motion()[2]])
        from taichi_ldem.solver.contact.kernels.unguided import VELOCITY

        velocity: np.ndarray = striker.vector(VELOCITY)
        return velocity

    def column(self, name: str) -> np.ndarray:
        return np.array([sample.observed[name] for sample in self.samples])

    @property
    def error(self) -> float:
        """Largest imbalance of the ledger over all energy that was there or came from outside."""
        ledgers = [sample.ledger for sample in self.samples]
        start, last = ledgers[0], ledgers[-1]
        scale = start.kinetic_plate + start.kinetic_bodies + last.external
        held = [
            x.kinetic_plate + x.kinetic_bodies + x.strain + x.contact + x.damping - x.external
            for x in ledgers
        ]
        return float(np.ptp(held) / scale)


@pytest.fixture(scope="module")
def struck(taichi: None) -> Watched:
    """A free plate that a striker with friction hits obliquely, and later an indenter."""
    return Watched(block_scene(8, 8, 3, striker=[OBLIQUE, INDENTER]), 170)


def test_an_oblique_strike_keeps_momentum_along_x_y_and_z(struck: Watched) -> None:
    alone = int(np.argmax(struck.column("striker2_force_n") != 0))
    assert 60 < alone < 120
    assert np.abs(struck.column("striker_force_x_n")[: alone // 2]).max() > 1
    kept = struck.momentum[:alone]
    expected = np.broadcast_to(20e-6 * np.array([4.0, -1.5, -10.0]), kept.shape)
    np.testing.assert_allclose(kept, expected, rtol=1e-12)
    # afterwards the plate has the indenter's impulse, too
    impulse = np.cumsum(struck.column("striker2_force_n")) * struck.simulation.time_step
    np.testing.assert_allclose(struck.momentum[:, 2] + impulse, -200e-6, rtol=1e-11)
    # the striker has been slowed in all directions
    after = struck.velocity_of(struck.simulation.body("striker"))
    assert np.abs(after[0]) < 3.0
    assert np.abs(after[2]) < 3.0


def test_the_energy_of_an_oblique_strike_is_accounted_for(struck: Watched) -> None:
    assert struck.error < 5e-4
    assert struck.samples[-1].ledger.contact > 0


def test_forces_sideways_are_impulses_over_time(struck: Watched) -> None:
    times = np.array([sample.time for sample in struck.samples])
    step = struck.simulation.time_step
    for axis, first in (("x", 4.0), ("y", -1.5)):
        force = struck.column(f"striker_force_{axis}_n")
        velocity = struck.column(f"striker_velocity_{axis}_m_s")
        assert velocity[0] == pytest.approx(first)
        # of a step each: the impulses up to a sample have changed the velocity half a step later
        taken = np.cumsum(force * step)[:-1]
        mean = 0.5 * (taken[1:] + taken[:-1])
        np.testing.assert_allclose(20e-6 * (velocity[1:-1] - first), mean, atol=1e-12)
        place = struck.column(f"striker_displacement_{axis}_m")
        path = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1])) * step])
        np.testing.assert_allclose(place, path, atol=2e-3 * np.abs(place).max())
    assert times[1] == pytest.approx(step)


def test_no_node_is_inside_a_striker_that_flies_obliquely(struck: Watched) -> None:
    from taichi_ldem.solver.contact.kernels.unguided import DISPLACEMENT

    place = struck.body.positions + struck.simulation.displacement()[struck.body.index]
    centre = np.array([*OBLIQUE["position"], 3 * SPACING + 1e-6 + 1e-3])
    away = place - centre - struck.simulation.body("striker").vector(DISPLACEMENT)
    away[:, 2] = np.minimum(away[:, 2], 0.0)
    assert np.linalg.norm(away, axis=1).min() > 1e-3 - 1e-6 * SPACING


def test_an_indenter_keeps_its_speed_and_its_work_is_in_the_ledger(struck: Watched) -> None:
    assert (struck.speeds[:, 1] == SPEED).all()
    assert struck.column("kinetic_striker2_j").max() == 0.0
    force = struck.column("striker2_force_n")
    assert force.max() > 1
    # sampled at every step, force times speed is the work up to half of the last impulse
    impulse = np.cumsum(force) * struck.simulation.time_step
    work = SPEED * np.concatenate([[impulse[0] / 2], 0.5 * (impulse[1:] + impulse[:-1])])
    external = np.array([sample.ledger.external for sample in struck.samples])
    np.testing.assert_allclose(external, work, rtol=1e-9, atol=1e-15)
    way = struck.column("striker2_displacement_m")[-1]
    assert struck.samples[-1].time * SPEED == pytest.approx(way, rel=1e-9)


@pytest.mark.slow  # copying the state from and to the device compiles a dozen kernels
def test_a_run_with_such_strikers_goes_on_from_a_checkpoint_to_the_bit(struck: Watched) -> None:
    s = struck.simulation
    saved = s.saved_state()
    last = [s.sample_step() for _ in range(10)]
    s.restore_state(saved)
    again = [s.sample_step() for _ in range(10)]
    assert [sample.observed for sample in again] == [sample.observed for sample in last]
    assert again[-1].ledger == last[-1].ledger


# -- symmetry and supports -------------------------------------------------------------------------


@pytest.fixture
def pair(taichi: None) -> "Simulation":
    """A free block that two strikers hit at places that mirror each other."""
    from taichi_ldem.solver.simulation import Simulation

    striker = {"shape": "flat", "diameter": 1.2e-3, "mass": 30e-6, "velocity": 6.0}
    places = ([-1e-3, 0.0], [1e-3, 0.0])
    return Simulation(block_scene(8, 8, 3, striker=[striker | {"position": p} for p in places]))


@pytest.mark.slow
def test_a_block_that_two_strikers_hit_symmetrically_does_not_turn(pair: "Simulation") -> None:
    body = Body(pair.dynamics.lattice.mask, SPACING)
    mass, errors = MODULE_MASS * body.mass_shares[:, None], []
    for _ in range(150):
        sample = pair.sample_step()
        errors.append(sample.energy_error)
    first, second = (pair.body(name).motion()[2] for name in ("striker", "striker2"))
    assert first == pytest.approx(second, rel=1e-9)
    assert first < 4.0
    velocity = pair.dynamics.get_velocity()[body.index]
    # the free block carries what the strikers have lost, and does not turn around y
    lost = 30e-6 * (6.0 - first) * 2
    assert -(mass * velocity).sum(axis=0)[2] == pytest.approx(lost, rel=1e-10)
    turning = (mass * np.cross(body.positions, velocity)).sum(axis=0)
    assert np.abs(turning).max() < 1e-9 * lost * 1e-3
    assert max(errors) < 5e-4


SUPPORTS = {
    "ring": {"kind": "ring", "ring_diameter": 2.6e-3},
    "balls": {"kind": "balls", "count": 3, "circle_diameter": 3e-3},
}
NOSES = {
    "ring": {"shape": "ring", "diameter": 0.6e-3, "ring_diameter": 1.4e-3},
    "balls": {"shape": "ogive", "diameter": 1.2e-3, "nose_radius": 1.5e-3},
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SUPPORTS)
def test_supports_hold_a_plate_that_is_pressed_on_them(taichi: None, kind: str) -> None:
    """A ring on a ring, and an ogive on three balls."""
    supports = SUPPORTS[kind] | {"diameter": 1e-3}
    striker = NOSES[kind] | {"motion": "prescribed", "velocity": 3.0}
    pressed = Watched(block_scene(8, 8, 3, striker=striker, supports=supports), 200)
    assert pressed.error < 1e-3
    assert pressed.column("striker_force_n").max() > 1
    assert pressed.column("support_force_n").max() > 1
    # what the ring has given and the supports have not taken, the plate has
    step = pressed.simulation.time_step
    given = np.cumsum(pressed.column("support_force_n") - pressed.column("striker_force_n")) * step
    np.testing.assert_allclose(pressed.momentum[:, 2], given, rtol=1e-9, atol=1e-18)
    place = pressed.body.positions + pressed.simulation.displacement()[pressed.body.index]
    x, y, z = place.T
    up = np.maximum(z + 0.5e-3, 0.0)
    away = np.hypot(np.hypot(x, y) - 1.3e-3, up)
    if kind == "balls":
        angle = 2 * np.pi * np.arange(3)[:, None] / 3
        across = np.hypot(x - 1.5e-3 * np.cos(angle), y - 1.5e-3 * np.sin(angle))
        away = np.hypot(across, up)
    assert away.min() > 0.5e-3 * (1 - 1e-6)
