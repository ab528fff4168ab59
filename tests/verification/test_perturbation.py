"""Nodes off the regular lattice: where they may lie, and bars of their own length and direction."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest
from support.blocks import DAMAGE, PMMA, block_scene
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

EDGE = 0.25e-3
SHARE = 0.1
STIFFNESS = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], EDGE)


# --- places ---------------------------------------------------------------------------------------


def test_nodes_lie_in_a_ball_and_faces_stay_flat() -> None:
    lattice = Lattice(prism(14, 12, 10), EDGE, perturbation=SHARE, seed=3)
    offsets = lattice.offsets
    assert offsets is not None
    size = np.linalg.norm(offsets, axis=-1) / (SHARE * EDGE)
    assert size.max() <= 1
    assert not offsets[~lattice.exists()].any()
    centres, inner = offsets[1][lattice.exists()[1]], offsets[0, 2:-2, 2:-2, 2:-2].reshape(-1, 3)
    for free in (centres, inner):  # uniform in a ball: the cube of the radius is, and so is z/r
        radius = np.linalg.norm(free, axis=1)
        assert kstest((radius / (SHARE * EDGE)) ** 3, "uniform").pvalue > 0.01
        for axis in range(3):
            assert kstest(free[:, axis] / radius, "uniform", args=(-1, 2)).pvalue > 0.01
    z, y, x = (offsets[0, 1:-1, 1:-1, 1:-1, a] for a in (2, 1, 0))
    for along, axis in ((z, 0), (y, 1), (x, 2)):
        ends = np.take(along, [0, -1], axis=axis)
        assert not ends.any()
        assert np.count_nonzero(along) == np.prod(
            [n - 2 * (a == axis) for a, n in enumerate(along.shape)]
        )
    again = Lattice(prism(14, 12, 10), EDGE, perturbation=SHARE, seed=3)
    np.testing.assert_array_equal(again.positions(), lattice.positions())
    other = Lattice(prism(14, 12, 10), EDGE, perturbation=SHARE, seed=4)
    assert np.abs(other.positions() - lattice.positions()).max() > 0.05 * EDGE


def test_a_corner_node_moves_along_an_axis_between_like_modules_only() -> None:
    mask = np.random.default_rng(1).random((4, 5, 5)) < 0.6
    lattice = Lattice(mask, EDGE, perturbation=SHARE)
    offsets = lattice.offsets
    assert offsets is not None
    padded = np.pad(mask, 1)
    for k, j, i in np.ndindex(5, 6, 6):
        around = padded[k : k + 2, j : j + 2, i : i + 2]
        free = [(around == np.flip(around, axis)).all() and around.any() for axis in (2, 1, 0)]
        np.testing.assert_array_equal(offsets[0, k + 1, j + 1, i + 1] != 0, free)


def test_a_notch_cuts_the_same_bars() -> None:
    plane = (0, 0.25 * EDGE, (-1.0, 0.0), (1.0, 1.0))
    mask = prism(6, 5, 4)
    np.testing.assert_array_equal(
        Lattice(mask, EDGE).bars_crossing(*plane),
        Lattice(mask, EDGE, perturbation=SHARE).bars_crossing(*plane),
    )


# --- bars -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def _perturbed(taichi: None) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    plate = {"perturbation": SHARE, "perturbation_seed": 5}
    return Simulation(block_scene(8, 4, 3, spacing=EDGE, material=DAMAGE, plate=plate))


@pytest.fixture
def perturbed(_perturbed: "Simulation") -> "Simulation":
    _perturbed.reset(_perturbed.scene)
    return _perturbed


@pytest.fixture
def uneven(perturbed: "Simulation") -> Body:
    lattice = perturbed.dynamics.lattice
    regular = Body(lattice.mask, EDGE)
    assert lattice.offsets is not None
    return Body(lattice.mask, EDGE, offsets=lattice.offsets[regular.index])


def _force(simulation: "Simulation", body: Body, displacement: np.ndarray) -> np.ndarray:
    simulation.dynamics.set_displacement(0, body.spread(displacement))
    return simulation.dynamics.get_force(0)[body.index]


def test_forces_and_energy_are_those_of_the_bars(perturbed: "Simulation", uneven: Body) -> None:
    rng = np.random.default_rng(2)
    displacement = rng.normal(0.0, 0.002 * EDGE, (len(uneven.places), 3))  # below eps_p
    assert uneven.strains(displacement).max() < DAMAGE["failure_strain"]
    force = _force(perturbed, uneven, displacement)
    expected = uneven.forces(displacement, STIFFNESS)
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-13 * STIFFNESS[0])
    perturbed.energies.potential(0)
    strain, fracture, *_ = perturbed.energies.total()
    assert strain == pytest.approx(uneven.strain_energy(displacement, STIFFNESS), rel=1e-11)
    assert fracture == 0
    module = PMMA["density"] * EDGE**3
    assert perturbed.dynamics.masses().sum() == pytest.approx(8 * 4 * 3 * module, rel=1e-14)


def test_a_rigid_rotation_strains_nothing(perturbed: "Simulation", uneven: Body) -> None:
    for axis in np.eye(3):
        turn = Rotation.from_rotvec(np.pi / 2 * axis).as_matrix()
        displaced = uneven.positions @ turn.T + [1e-3, 0, -2e-3] - uneven.positions
        assert np.abs(_force(perturbed, uneven, displaced)).max() < 1e-13 * STIFFNESS[0]


def test_all_bars_broken_take_their_energy_in_the_measure_of_their_length(
    perturbed: "Simulation", uneven: Body
) -> None:
    _force(perturbed, uneven, 10 * DAMAGE["failure_strain"] * uneven.positions)
    perturbed.energies.potential(0)
    strain, fracture, broken, *_ = perturbed.energies.total()
    assert (strain, broken) == (0.0, len(uneven.ends))
    families = mat.check(perturbed.scene)
    per_length = [f.energy_to_break / f.length for f in (families.longitudinal, families.diagonal)]
    costs = uneven.weights * uneven.per_bar(*per_length) * uneven.lengths
    assert fracture == pytest.approx(costs.sum(), rel=1e-12)


def test_rigid_bodies_meet_the_nodes_where_they_are(perturbed: "Simulation", uneven: Body) -> None:
    from support.bars import Places

    found = Places(perturbed.dynamics).read()[uneven.index]
    np.testing.assert_allclose(found, uneven.positions, rtol=0, atol=1e-13 * EDGE)
    np.testing.assert_array_equal(
        perturbed.dynamics.lattice.positions()[uneven.index][:, 2] == 0, uneven.places[:, 2] == 0
    )


def test_the_critical_step_is_that_of_the_perturbed_body(
    perturbed: "Simulation", uneven: Body
) -> None:
    from scipy.linalg import eigvalsh

    mass = np.repeat(PMMA["density"] * EDGE**3 * uneven.mass_shares, 3)
    matrix = uneven.stiffness_matrix(STIFFNESS).toarray() / np.sqrt(np.outer(mass, mass))
    highest = np.sqrt(eigvalsh(matrix, subset_by_index=(len(mass) - 1, len(mass) - 1))[0])
    assert perturbed.critical_time_step == pytest.approx(2 / highest, rel=1e-3)


def test_momenta_and_energy_of_a_cracking_body(perturbed: "Simulation", uneven: Body) -> None:
    """Free flight, spinning and stretched: whole at first, then cracking."""
    arm = uneven.positions - uneven.positions.mean(axis=0)
    expansion = 60.0 * arm[:, :1] / arm[:, 0].max() * [1, 0, 0]
    velocity = np.cross([2e3, -1e3, 3e3], arm) + expansion + [3.0, -2.0, 1.0]
    mass = PMMA["density"] * EDGE**3 * uneven.mass_shares[:, None]
    perturbed.start_from(np.zeros((2, *perturbed.dynamics.sites, 3)), uneven.spread(velocity))

    def momenta() -> tuple[np.ndarray, np.ndarray]:
        moving = mass * perturbed.dynamics.get_velocity()[uneven.index]
        place = uneven.positions + perturbed.displacement()[uneven.index]
        return moving.sum(axis=0), np.cross(place, moving).sum(axis=0)

    linear, angular = momenta()
    start, whole = perturbed.sample_step(), 0
    for _ in range(60):
        sample = perturbed.sample_step()
        if sample.ledger.fracture == 0:
            whole += 1
            assert sample.energy_error < 1e-4
    assert whole >= 3
    for _ in range(4):
        perturbed.advance(49)
        sample = perturbed.sample_step()
    assert 20 < sample.broken_bars < len(uneven.ends)
    assert sample.ledger.fracture > 0.02 * start.ledger.stored
    assert sample.energy_error < 0.02  # as in the regular lattice: bars fail within a step
    scale = np.abs(mass * velocity).sum()
    after = momenta()
    np.testing.assert_allclose(after[0], linear, rtol=0, atol=1e-13 * scale)
    far = np.abs(uneven.positions + perturbed.displacement()[uneven.index]).max()
    np.testing.assert_allclose(after[1], angular, rtol=0, atol=1e-13 * scale * far)
