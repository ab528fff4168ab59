from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import DAMAGE, PMMA, SPACING
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scene import Material

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

STIFFNESS = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], SPACING)


def _kernel_force(simulation: "Simulation", body: Body, displacement: np.ndarray) -> np.ndarray:
    dynamics = simulation.dynamics
    dynamics.set_displacement(0, body.spread(displacement))
    force = dynamics.get_force(0)
    assert np.count_nonzero(force) == np.count_nonzero(force[body.index])  # none on what is not
    return force[body.index]


def _random(body: Body, size: float, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, size, (len(body.places), 3))


def test_forces_at_large_displacement_are_those_of_the_bars(
    elastic: "Simulation", body: Body
) -> None:
    displacement = _random(body, 0.3 * SPACING)
    force = _kernel_force(elastic, body, displacement)
    expected = body.forces(displacement, STIFFNESS)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_forces_are_minus_the_slope_of_the_strain_energy(elastic: "Simulation", body: Body) -> None:
    displacement, direction = _random(body, 0.2 * SPACING), _random(body, 1.0, seed=2)
    force = _kernel_force(elastic, body, displacement)
    step, energy = 1e-5 * SPACING, {}
    for side in (-2, -1, 1, 2):
        elastic.dynamics.set_displacement(0, body.spread(displacement + side * step * direction))
        elastic.energies.potential(0)
        energy[side] = elastic.energies.total()[0]
    # fourth-order difference: the error is rounding, about 1e-16 / 1e-5
    slope = (8 * (energy[1] - energy[-1]) - (energy[2] - energy[-2])) / (12 * step)
    assert -np.sum(force * direction) == pytest.approx(slope, rel=1e-9)


def _rotation(axis: tuple[float, float, float], angle: float) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    unit = np.array(axis) / np.linalg.norm(axis)
    return Rotation.from_rotvec(angle * unit).as_matrix()


@pytest.mark.parametrize(
    ("axis", "angle"),
    [((1, 0, 0), np.pi / 2), ((0, 1, 0), np.pi / 2), ((0, 0, 1), np.pi), ((1, -2, 3), 2.1)],
    ids=["x 90", "y 90", "z 180", "oblique 120"],
)
def test_a_rigid_rotation_strains_nothing(
    elastic: "Simulation", body: Body, axis: tuple[float, float, float], angle: float
) -> None:
    turned = body.positions @ _rotation(axis, angle).T + [1e-3, 2e-3, -3e-3]
    force = _kernel_force(elastic, body, turned - body.positions)
    assert np.abs(force).max() < 1e-13 * STIFFNESS[0]


def test_a_rotation_turns_the_forces(elastic: "Simulation", body: Body) -> None:
    displacement, turn = _random(body, 0.1 * SPACING), _rotation((1, 2, -1), 1.3)
    force = _kernel_force(elastic, body, displacement)
    turned = (body.positions + displacement) @ turn.T - body.positions
    np.testing.assert_allclose(
        _kernel_force(elastic, body, turned), force @ turn.T, rtol=0, atol=1e-13 * STIFFNESS[0]
    )


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_mirrored_body_answers_mirrored(elastic: "Simulation", body: Body, axis: int) -> None:
    """Every bar then begins where its image ends (for diagonals: lies at another site)."""
    mirror = 1 - 2 * np.eye(3)[axis]
    image = body.places * mirror.astype(int)
    image[:, axis] += body.places[:, axis].max()
    number = {tuple(p): n for n, p in enumerate(body.places.tolist())}
    partner = np.array([number[tuple(p)] for p in image.tolist()])
    displacement = _random(body, 0.2 * SPACING)
    force = _kernel_force(elastic, body, displacement)
    mirrored = _kernel_force(elastic, body, (displacement * mirror)[partner])
    scale = np.abs(force).max()
    np.testing.assert_allclose(mirrored, (force * mirror)[partner], rtol=0, atol=1e-13 * scale)


def test_tiny_strains_keep_their_digits(elastic: "Simulation", body: Body) -> None:
    # length minus length at rest would leave nothing of a strain of 1e-14
    strain = 1e-14
    force = _kernel_force(elastic, body, body.positions * [strain, 0, 0])
    linear = -body.stiffness_matrix(STIFFNESS) @ (body.positions * [strain, 0, 0]).ravel()
    assert np.abs(force - linear.reshape(-1, 3)).max() < 1e-12 * np.abs(linear).max()


@pytest.mark.parametrize("weighted", [True, False], ids=["weighted", "full"])
def test_any_mask_and_stiffness_variant(taichi: None, weighted: bool) -> None:
    from taichi_ldem.solver.dynamics import Dynamics, Features

    mask = np.random.default_rng(8).random((3, 4, 4)) < 0.55
    material = Material(**PMMA)
    bars = mat.bar_families(material, SPACING, "as-printed")
    dynamics = Dynamics(Lattice(mask, SPACING, weighted), bars, 1190.0, Features())
    body = Body(mask, SPACING, weighted)
    displacement = _random(body, 0.2 * SPACING)
    dynamics.set_displacement(1, body.spread(displacement))
    force = dynamics.get_force(1)
    expected = body.forces(displacement, mat.axial_stiffness(3.35e9, 0.25, SPACING, "as-printed"))
    np.testing.assert_allclose(force[body.index], expected, rtol=0, atol=1e-13 * STIFFNESS[0])
    assert np.count_nonzero(force) == np.count_nonzero(force[body.index])


def test_masses_add_up_and_reach_the_nodes(elastic: "Simulation", body: Body) -> None:
    dynamics = elastic.dynamics
    mass = np.moveaxis(dynamics.mass.to_numpy()[dynamics.lattice.code], -1, 0)
    module = PMMA["density"] * SPACING**3
    np.testing.assert_allclose(mass[body.index], module * body.mass_shares, rtol=1e-15)
    assert mass.sum() == pytest.approx(dynamics.lattice.mask.sum() * module, rel=1e-14)
    inverse = np.moveaxis(dynamics.inverse_mass.to_numpy()[dynamics.lattice.code], -1, 0)
    np.testing.assert_allclose((mass * inverse)[body.index], 1.0, rtol=1e-15)


def test_a_body_without_forces_flies_straight(elastic: "Simulation", body: Body) -> None:
    velocity = np.array([0.3, -0.2, 1.0])
    elastic.start_from(
        np.zeros((2, *elastic.dynamics.sites, 3)),
        body.spread(np.tile(velocity, (len(body.places), 1))),
    )
    elastic.advance(200)
    displaced = elastic.displacement()[body.index]
    np.testing.assert_allclose(
        displaced, np.tile(200 * elastic.time_step * velocity, (len(displaced), 1)), rtol=1e-12
    )
    np.testing.assert_allclose(
        elastic.dynamics.get_velocity()[body.index],
        np.tile(velocity, (len(displaced), 1)),
        rtol=1e-10,
    )
    assert not elastic.displacement()[~elastic.dynamics.lattice.exists()].any()


def test_two_steps_are_central_differences(elastic: "Simulation", body: Body) -> None:
    """Eq. (3) by hand: x(n+1) = 2 x(n) - x(n-1) + dt^2 F(x(n)) / m."""
    dt = elastic.time_step
    mass = PMMA["density"] * SPACING**3 * body.mass_shares[:, None]
    start, velocity = _random(body, 0.05 * SPACING), _random(body, 5.0, seed=4)
    elastic.start_from(body.spread(start), body.spread(velocity))
    first = start + dt * velocity + 0.5 * dt**2 * body.forces(start, STIFFNESS) / mass
    second = 2 * first - start + dt**2 * body.forces(first, STIFFNESS) / mass
    for expected in (first, second):
        elastic.advance(1)
        np.testing.assert_allclose(
            elastic.displacement()[body.index], expected, rtol=0, atol=1e-14 * SPACING
        )


def test_damping_slows_a_free_flight_by_its_own_factor(taichi: None) -> None:
    """With C = alpha M and no forces, (v+ - v-)/dt = -alpha (v+ + v-)/2: a geometric decay."""
    from taichi_ldem.solver.dynamics import Dynamics, Features

    bars = mat.bar_families(Material(**PMMA), SPACING)
    dynamics = Dynamics(Lattice(prism(2, 1, 1), SPACING), bars, 1190.0, Features(damping=True))
    body = Body(prism(2, 1, 1), SPACING)
    dynamics.set_velocity(body.spread(np.ones((len(body.places), 3))))
    dt, alpha = 1e-7, 2e4
    half = 0.5 * alpha * dt
    for _ in range(500):
        dynamics.kick(0, dt, alpha)
    speed = dynamics.get_velocity()[body.index]
    np.testing.assert_allclose(speed, ((1 - half) / (1 + half)) ** 500, rtol=1e-12)
    assert speed[0, 0] == pytest.approx(np.exp(-alpha * 500 * dt), rel=1e-6)


UNEVEN = ("strength", "weakest", "modulus", "own_mass", "own_inverse_mass", "offset")


def test_what_a_scene_leaves_out_is_not_there(elastic: "Simulation") -> None:
    fields = elastic.field_bytes()
    for name in ("peak", "touched", "recorded", "removed", "damped", "softening", *UNEVEN):
        assert name not in fields
    assert elastic.body("striker") is None
    assert elastic.body("rings") is None


@pytest.mark.parametrize("law", [None, "bilinear"])
def test_whole_passes_and_strips_are_the_same_step(taichi: None, law: str | None) -> None:
    """A GPU takes the passes one after the other, a site to a lane: the same to the last bit."""
    from taichi_ldem.solver.dynamics import Dynamics, Features

    mask = prism(9, 10, 2)
    mask[0, 3:5, 2:6] = False
    body = Body(mask, SPACING)
    bars = mat.bar_families(Material(**PMMA | DAMAGE), SPACING)
    start = _random(body, 0.01 * SPACING)
    ends = []
    for in_strips in (True, False):
        dynamics = Dynamics(Lattice(mask, SPACING), bars, 1190.0, Features(law=law), in_strips)
        assert (dynamics.lanes.width > 1) == in_strips
        dynamics.set_displacement(0, body.spread(start))
        for step in range(30):
            dynamics.step(step % 2, 9e-8, 9e-8, 0.0, step == 29)
        displaced = np.zeros((2, *dynamics.sites, 3))
        dynamics.get_displacement(0, displaced)
        kinetic = dynamics.node_sums.to_numpy().sum(axis=0)[0]
        ends.append((displaced, dynamics.get_velocity(), kinetic))
        if law is not None:
            sites, broken = dynamics.new_broken()
            ends[-1] += (sites, broken)
            assert len(broken) > 0
    for number in (0, 1, 3, 4)[: len(ends[0]) - 1]:
        np.testing.assert_array_equal(ends[0][number], ends[1][number])
    assert ends[0][2] == pytest.approx(ends[1][2], rel=1e-13)  # summed in another order
