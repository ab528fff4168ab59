"""Forces of bars at large and tiny displacements, compared with those of the block bar by bar."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene, random_displacement
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice
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


def test_forces_at_large_displacement_are_those_of_the_bars(
    elastic: "Simulation", body: Body
) -> None:
    displacement = random_displacement(body, 0.3 * SPACING)
    force = _kernel_force(elastic, body, displacement)
    expected = body.forces(displacement, STIFFNESS)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_forces_are_minus_the_slope_of_the_strain_energy(elastic: "Simulation", body: Body) -> None:
    displacement, direction = (
        random_displacement(body, 0.2 * SPACING),
        random_displacement(body, 1.0, seed=2),
    )
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
    displacement, turn = random_displacement(body, 0.1 * SPACING), _rotation((1, 2, -1), 1.3)
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
    displacement = random_displacement(body, 0.2 * SPACING)
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
    displacement = random_displacement(body, 0.2 * SPACING)
    dynamics.set_displacement(1, body.spread(displacement))
    force = dynamics.get_force(1)
    expected = body.forces(displacement, mat.axial_stiffness(3.35e9, 0.25, SPACING, "as-printed"))
    np.testing.assert_allclose(force[body.index], expected, rtol=0, atol=1e-13 * STIFFNESS[0])
    assert np.count_nonzero(force) == np.count_nonzero(force[body.index])


@pytest.mark.parametrize(
    "plate",
    [{}, {"perturbation": 0.1}, {"lattice": "cubic-26"}],
    ids=["regular", "perturbed", "26 neighbours"],
)
def test_one_lane_has_the_bits_of_every_lane(taichi: None, plate: dict[str, Any]) -> None:
    """Code for damaged bars takes one lane; a force and its share must fit to the last bit."""
    from support.bars import BothWays

    from taichi_ldem.solver.simulation import Simulation

    disorder = {"youngs_modulus_cv": 0.1, "seed": 1}
    dynamics = Simulation(block_scene(12, 3, 2, plate=plate, disorder=disorder)).dynamics
    lattice = dynamics.lattice
    shape = (dynamics.cell.sublattices, *lattice.sites, 3)
    moved = np.random.default_rng(5).normal(0.0, 0.1 * SPACING, shape)
    dynamics.set_displacement(0, moved * lattice.exists()[..., None])
    lanes, one = BothWays(dynamics).read()
    np.testing.assert_array_equal(one, lanes)
    assert np.count_nonzero(lanes[..., 0]) == lattice.bars
