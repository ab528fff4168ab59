"""Blocks that fall, bounce, slide and rest on a floor with friction, against theory."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import block_scene

from taichi_ldem.scene import Scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation

GRAVITY = 1e4  # m/s2, a thousand times the Earth's: 0.5 ms are then as 0.5 s
FRICTION = 0.6


def scene(
    gravity: tuple[float, float, float], gap: float = 0.0, speed: float = 0.0, **tables: Any
) -> Scene:
    """A block of 6 x 4 x 2 modules above a rough floor, with a speed along x or, below 0, down."""
    velocity = [speed, 0.0, 0.0] if speed >= 0 else [0.0, 0.0, speed]
    plate = {"gravity": gravity, "velocity": velocity} | tables.pop("plate", {})
    floor = {"gap": gap, "friction": FRICTION}
    return block_scene(6, 4, 2, floor=floor, plate=plate, **tables)


def slope(degrees: float) -> tuple[float, float, float]:
    """Gravity of a slope that falls towards x."""
    angle = np.radians(degrees)
    return GRAVITY * np.sin(angle), 0.0, -GRAVITY * np.cos(angle)


class Watched:
    """A simulation that is stepped and watched: mean displacement and velocity of its mass."""

    def __init__(self, simulation: "Simulation", wanted: Scene):
        self.simulation = simulation
        simulation.reset(wanted)
        self.masses = simulation.dynamics.masses()[..., None]
        self.mass = float(self.masses.sum())
        self.samples: list[Sample] = []

    def run(self, steps: int, every: int = 100) -> "Watched":
        """Take steps, with a sample of every so many; sampled impulses add up without a gap."""
        for _ in range(steps // every):
            self.samples.append(self.simulation.sample_step())
            self.simulation.guard(self.samples[-1])
            self.simulation.advance(every - 1)
        return self

    @property
    def moved(self) -> np.ndarray:
        """(3,) m."""
        return (
            np.asarray((self.masses * self.simulation.displacement()).sum((0, 1, 2, 3))) / self.mass
        )

    @property
    def velocity(self) -> np.ndarray:
        """(3,) half a step before now, m/s."""
        velocity = self.simulation.dynamics.get_velocity()
        return np.asarray((self.masses * velocity).sum((0, 1, 2, 3))) / self.mass

    @property
    def pushed(self) -> float:
        """Impulse of the floor so far, N s."""
        from taichi_ldem.solver.contact.kernels.body import IMPULSE

        return float(self.simulation.body("floor").collected()[IMPULSE])

    def worst(self) -> float:
        """Largest energy error."""
        return max(sample.energy_error for sample in self.samples)


@pytest.fixture(scope="module")
def block(taichi: None) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(scene(slope(20)))


def test_free_fall_is_that_of_a_point_to_rounding(block: "Simulation") -> None:
    gravity = np.array([2e3, -1e3, -9e3])
    falling = Watched(block, scene(tuple(gravity), gap=1.0, speed=3.0)).run(500)
    time, exists = block.time, block.dynamics.lattice.exists()
    expected = np.array([3.0, 0.0, 0.0]) * time + 0.5 * gravity * time**2
    moved = block.displacement()
    np.testing.assert_allclose(moved[exists] - expected, 0.0, atol=1e-12 * np.abs(expected).max())
    assert np.ptp(moved[exists], axis=0).max() == 0.0  # the same to the last bit: no strain
    last = falling.samples[-1]
    assert last.ledger.strain == 0.0
    assert last.ledger.external == pytest.approx(
        falling.mass
        * gravity
        @ (3.0 * np.array([1, 0, 0]) * last.time + 0.5 * gravity * last.time**2)
    )
    assert falling.worst() < 1e-12
    assert not any(sample.observed["floor_force_n"] for sample in falling.samples)


def test_gravity_is_no_part_of_the_bars_forces(block: "Simulation") -> None:
    block.reset(scene((0.0, 0.0, -1e-3)))
    light = block.critical_time_step
    block.reset(scene((0.0, 0.0, -GRAVITY)))
    assert block.critical_time_step == light
    assert not block.dynamics.get_force(0).any()
    block.advance(1)
    assert block.displacement()[..., 2].min() < 0  # it is back after both


def test_a_block_rests_on_a_slope_of_20_degrees(block: "Simulation") -> None:
    resting = Watched(block, scene(slope(20))).run(2000)
    slides = 0.5 * GRAVITY * np.sin(np.radians(20)) * block.time**2  # without friction
    assert abs(resting.moved[0]) < 1e-3 * slides
    assert np.abs(resting.velocity).max() < 1e-3 * GRAVITY * block.time
    weight = resting.mass * GRAVITY * np.cos(np.radians(20))
    forces = [sample.observed["floor_force_n"] for sample in resting.samples[10:]]
    assert np.mean(forces) == pytest.approx(weight, rel=1e-3)
    assert resting.worst() < 1e-6


def test_a_block_slides_down_a_slope_of_40_degrees(block: "Simulation") -> None:
    """It starts fast, as a slow block hops at first, and nodes that land then stick for a step."""
    speed, angle = 3.0, np.radians(40)
    sliding = Watched(block, scene(slope(40), speed=speed)).run(3000)
    time = block.time - 0.5 * block.time_step
    # mu times what the floor pushes, less what goes into nodes that swing across the slope
    drag = speed + GRAVITY * np.sin(angle) * time - sliding.velocity[0]
    assert 0.998 < drag * sliding.mass / (FRICTION * sliding.pushed) < 1 + 1e-9
    expected = GRAVITY * (np.sin(angle) - FRICTION * np.cos(angle))
    assert (sliding.velocity[0] - speed) / time == pytest.approx(expected, rel=0.03)
    assert sliding.moved[0] == pytest.approx(speed * time + 0.5 * expected * time**2, rel=0.01)
    assert sliding.worst() < 1e-5


def test_a_sliding_block_stops_where_friction_has_taken_its_energy(block: "Simulation") -> None:
    speed = 1.0
    stopping = Watched(block, scene((0.0, 0.0, -GRAVITY), speed=speed)).run(2500)
    way = speed**2 / (2 * FRICTION * GRAVITY)
    assert stopping.moved[0] == pytest.approx(way, rel=0.01)
    assert abs(stopping.velocity[0]) < 1e-3 * speed
    lost = stopping.samples[-1].ledger.contact
    assert lost == pytest.approx(0.5 * stopping.mass * speed**2, rel=0.01)
    assert stopping.worst() < 1e-5


def test_a_dropped_block_bounces_lower_and_comes_to_rest(block: "Simulation") -> None:
    gap, speed = 1e-5, 0.3
    dropped = Watched(block, scene((0.0, 0.0, -GRAVITY), gap=gap, speed=-speed))
    fall = 0.5 * speed**2 / GRAVITY + gap  # the height that its energy reaches above the floor
    heights = [gap]
    for _ in range(42):
        dropped.run(100, 50)
        heights.append(gap + dropped.moved[2])
    energy = [s.ledger.kinetic_plate + s.ledger.strain - s.ledger.external for s in dropped.samples]
    assert np.diff(energy).max() < 1e-4 * dropped.mass * GRAVITY * fall  # never gains any
    assert min(heights) > -0.02 * fall
    down = next(n for n in range(1, len(heights)) if heights[n] > heights[n - 1])  # it has landed
    assert 0.4 * fall < max(heights[down:]) < 0.9 * fall
    assert max(heights[-10:]) < 0.02 * fall
    assert dropped.worst() < 1e-4
    weight = dropped.mass * GRAVITY
    forces = [sample.observed["floor_force_n"] for sample in dropped.samples[-20:]]
    assert np.mean(forces) == pytest.approx(weight, rel=0.01)


@pytest.mark.slow  # its kernels are of their own
def test_uneven_and_damped_nodes_fall_alike(taichi: None) -> None:
    """Random offsets, masses of their own and damping: v' = g - alpha v, and the ledger closes."""
    from taichi_ldem.solver.simulation import Simulation

    alpha = 2e3
    wanted = scene(
        (2e3, 0.0, -9e3),
        gap=1.0,
        plate={"perturbation": 0.2},
        disorder={"density_cv": 0.2, "youngs_modulus_cv": 0.1, "seed": 3},
        solver={"damping": alpha},
    )
    falling = Watched(Simulation(wanted), wanted).run(1000)
    time = falling.simulation.time - 0.5 * falling.simulation.time_step
    expected = np.array([2e3, 0.0, -9e3]) / alpha * (1 - np.exp(-alpha * time))
    np.testing.assert_allclose(falling.velocity, expected, rtol=1e-6)
    last = falling.samples[-1].ledger
    assert last.strain < 1e-12 * last.kinetic_plate
    assert last.damping > 0.05 * last.external
    assert falling.worst() < 1e-9
