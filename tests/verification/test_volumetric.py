"""Modules with an energy of their volume: the isotropic solid of any Poisson's ratio."""

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import DAMAGE, PMMA, block_scene
from support.reference import Body

from taichi_ldem.errors import SceneError
from taichi_ldem.model import material as mat
from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scene import Material, Scene
from taichi_ldem.solver.module_fields import ModuleFields

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

Array = np.ndarray
MODULUS = PMMA["youngs_modulus"]
RATIOS = (0.0, 0.1, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.49)
CORNERS = list(itertools.product((-1, 1), repeat=3))


def _material(ratio: float) -> Material:
    return Material(**PMMA | {"poisson_ratio": ratio})


def _lame(ratio: float) -> tuple[float, float]:
    """Lame's constants of the solid over E (Hooke's law)."""
    return ratio / ((1 + ratio) * (1 - 2 * ratio)), 1 / (2 * (1 + ratio))


# -- the infinite lattice, without the program's kernels -------------------------------------------


def _energy(strain: Array, ratio: float, lattice: str) -> float:
    """Energy per volume over E in a uniform small strain.

    That of the bars is a third difference over blocks of n^3 modules (bulk, faces, edges, corners).
    """
    bars = mat.bar_families(_material(ratio), 1.0, "volumetric", lattice=lattice)
    unit = [family.axial_stiffness / MODULUS for family in bars]
    energies = []
    for n in (1, 2, 3, 4):
        body = Body(prism(n, n, n), lattice=lattice)
        along = body.rest / body.lengths[:, None]
        bar = np.einsum("bi,ij,bj->b", along, strain, along)
        energies.append(np.sum(0.5 * body.weights * body.per_bar(*unit) * body.lengths * bar**2))
    of_volume = 0.5 * mat.volumetric_modulus(1.0, ratio) * np.trace(strain) ** 2
    return float(np.diff(energies, 3)[0]) / 6 + of_volume


@pytest.mark.parametrize("lattice", CELLS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_elastic_constants_are_those_of_the_solid(ratio: float, lattice: str) -> None:
    c11 = 2 * _energy(np.diag([1.0, 0.0, 0.0]), ratio, lattice)
    c12 = _energy(np.diag([1.0, 1.0, 0.0]), ratio, lattice) - c11
    c44 = 2 * _energy(np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]]), ratio, lattice)
    lame, shear = _lame(ratio)
    expected = (lame + 2 * shear, lame, shear)
    np.testing.assert_allclose((c11, c12, c44), expected, rtol=0, atol=1e-10)
    said = mat.elastic_constants(1.0, ratio, "volumetric")
    np.testing.assert_allclose(said, expected, rtol=1e-12)


def _lowest(k: Array, ratio: float, lattice: str) -> float:
    """Lowest eigenvalue of the stiffness of a wave (1/L) over that of E L."""
    cell = CELLS[lattice]
    bars = mat.bar_families(_material(ratio), 1.0, "volumetric", lattice=lattice)
    stiffness = np.zeros((cell.sublattices, 3, cell.sublattices, 3), dtype=complex)
    for ((first, _), (second, _)), vector, number in zip(
        cell.ends, cell.vectors, cell.family, strict=True
    ):
        unit = vector / np.linalg.norm(vector)
        pull = bars[number].axial_stiffness / MODULUS / bars[number].length * np.outer(unit, unit)
        phase = np.exp(1j * k @ vector)
        stiffness[first, :, first] += pull
        stiffness[second, :, second] += pull
        stiffness[first, :, second] -= pull * phase
        stiffness[second, :, first] -= pull * phase.conj()
    gradient = sum(np.array(s) / 4 * np.exp(0.5j * k @ s) for s in CORNERS)
    grown = np.outer(gradient.conj(), gradient)
    stiffness[0, :, 0] += mat.volumetric_modulus(1.0, ratio) * grown
    size = 3 * cell.sublattices
    return float(np.linalg.eigvalsh(stiffness.reshape(size, size))[0])


@pytest.mark.parametrize("lattice", CELLS)
@pytest.mark.parametrize("ratio", RATIOS)
def test_no_wave_of_the_brillouin_zone_is_unstable(ratio: float, lattice: str) -> None:
    """Below 1/4 the volumetric modulus is negative; bars outweigh it for every wave."""
    steps = np.linspace(0, 2 * np.pi, 13)[:7]
    for k in itertools.product(steps, repeat=3):
        if any(k):
            assert _lowest(np.array(k), ratio, lattice) > 1e-3


# -- the kernels -----------------------------------------------------------------------------------


FINE = 0.3e-3  # edge at which bars soften before they fail
BREAKS = PMMA | DAMAGE | {"poisson_ratio": 0.36, "fracture": "crack", "failure_strain": 0.9}
BRITTLE = {"material": {"failure_strain": 0.0175}}
CUBIC = pytest.param("cubic-26", marks=pytest.mark.slow)  # for the time that kernels take


PERTURBED = pytest.param("perturbed", marks=pytest.mark.slow)


@pytest.fixture(scope="module", params=["module", CUBIC, PERTURBED])
def simulation(taichi: None, request: pytest.FixtureRequest) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(_block(request.param))


def _block(lattice: str, **tables: Any) -> Scene:
    """A block whose bars break at 90 % unless the tables say more: it is elastic."""
    material = BREAKS | tables.pop("material", {})
    plate: dict[str, Any] = {"lattice": lattice}
    if lattice == "perturbed":
        plate = {"perturbation": 0.1, "perturbation_seed": 3}
    return block_scene(7, 5, 4, spacing=FINE, plate=plate, material=material, **tables)


def _renewed(simulation: "Simulation", **tables: Any) -> Scene:
    """The simulation's block, at rest and whole, with other numbers."""
    plate = simulation.scene.plate
    scene = _block("perturbed" if plate.perturbation else plate.lattice, **tables)
    simulation.reset(scene)
    return scene


def _total(simulation: "Simulation", field: Array) -> float:
    simulation.start_from(field, np.zeros_like(field))
    simulation.energies.potential(simulation.now)
    return float(simulation.energies.total()[0])


def _noise(simulation: "Simulation", seed: int) -> Array:
    """Displacements of a twentieth of a module: J from 0.8 to 1.2."""
    lattice = simulation.dynamics.lattice
    exists = lattice.exists()
    size = (*exists.shape, 3)
    noise = np.random.default_rng(seed).normal(0, 0.05 * lattice.spacing, size)
    return np.asarray(noise * exists[..., None])


def _of_volumes(simulation: "Simulation", field: Array) -> float:
    """Energy of the volumes alone: what is missing without them, J."""
    dynamics = simulation.dynamics
    whole, kept = _total(simulation, field), dynamics.volumetric
    dynamics.volumetric = 0.0
    bars = _total(simulation, field)
    dynamics.volumetric = kept
    return whole - bars


def _volumes_at_rest(lattice: Lattice) -> Array:
    """(modules,) determinants of the mean gradient of the eight corners' places, m3."""
    place, volumes = lattice.positions()[0], []
    for k, j, i in np.argwhere(lattice.mask) + 1:
        gradient = sum(
            np.outer(place[k + (z > 0), j + (y > 0), i + (x > 0)], (x, y, z)) for x, y, z in CORNERS
        )
        volumes.append(np.linalg.det(gradient / (4 * lattice.spacing)) * lattice.spacing**3)
    return np.array(volumes)


def test_an_affine_motion_has_one_determinant(simulation: "Simulation") -> None:
    """det(A)^2 is that of A^T A; in a perturbed lattice J is over the module at rest."""
    lattice = simulation.dynamics.lattice
    motion = np.eye(3) + np.random.default_rng(8).normal(0, 0.05, (3, 3))
    field = lattice.positions() @ (motion - np.eye(3)).T * lattice.exists()[..., None]
    grown = np.sqrt(np.linalg.det(motion.T @ motion)) - 1
    modulus = mat.volumetric_modulus(MODULUS, 0.36)
    expected = 0.5 * modulus * grown**2 * _volumes_at_rest(lattice).sum()
    assert _of_volumes(simulation, field) == pytest.approx(expected, rel=1e-9)


def test_energy_is_that_of_bars_and_of_every_module_s_determinant(simulation: "Simulation") -> None:
    """Against NumPy's determinant of the mean gradient of the eight corners' places."""
    field, lattice = _noise(simulation, 1), simulation.dynamics.lattice
    if lattice.offsets is not None:
        pytest.skip("the reference's bars are those of a regular lattice")
    body = Body(lattice.mask, lattice.spacing, lattice=lattice.cell.name)
    bars = mat.bars_of(simulation.scene)
    of_bars = body.strain_energy(field[body.index], tuple(f.axial_stiffness for f in bars))
    place = (lattice.positions() + field)[0]
    modulus = mat.volumetric_modulus(MODULUS, 0.36)
    of_volumes = 0.0
    for k, j, i in np.argwhere(lattice.mask) + 1:
        gradient = sum(
            np.outer(place[k + (z > 0), j + (y > 0), i + (x > 0)], (x, y, z)) for x, y, z in CORNERS
        ) / (4 * lattice.spacing)
        of_volumes += 0.5 * modulus * (np.linalg.det(gradient) - 1) ** 2 * lattice.spacing**3
    assert of_volumes > 0.05 * of_bars
    assert _total(simulation, field) == pytest.approx(of_bars + of_volumes, rel=1e-12)


def test_forces_are_the_slope_of_the_energy_and_add_up_to_zero(simulation: "Simulation") -> None:
    field, direction = _noise(simulation, 2), _noise(simulation, 3)
    _total(simulation, field)
    force = simulation.dynamics.get_force(simulation.now)
    step = 1e-4
    ends = [_total(simulation, field + sign * step * direction) for sign in (1, -1)]
    slope = (ends[0] - ends[1]) / (2 * step)
    assert -slope == pytest.approx(float((force * direction).sum()), rel=1e-6)
    whole = np.abs(force.sum(axis=(0, 1, 2, 3)))
    assert whole.max() < 1e-12 * np.abs(force).max() * force.size


def test_a_rotation_costs_nothing(simulation: "Simulation") -> None:
    from scipy.spatial.transform import Rotation

    lattice = simulation.dynamics.lattice
    place = lattice.positions() * lattice.exists()[..., None]
    turn = Rotation.from_rotvec([0.3, -1.0, 0.7]).as_matrix()
    assert _total(simulation, place @ turn.T - place) < 1e-24 * MODULUS * lattice.volume


def test_energy_of_a_vibration_is_kept(simulation: "Simulation") -> None:
    _renewed(simulation)
    simulation.start_from(0.02 * _noise(simulation, 4), 0.0 * _noise(simulation, 4))
    first = simulation.sample_step().ledger.stored
    simulation.advance(400)
    assert simulation.sample_step().ledger.stored == pytest.approx(first, rel=1e-3)


# -- modules whose bars break ----------------------------------------------------------------------


def _of_modules(field: Array, offset: tuple[int, int, int], shape: tuple[int, ...]) -> Array:
    """Values of (*S) sites at an offset from each module's."""
    (z, y, x), (nz, ny, nx) = offset, shape
    return field[1 + z : 1 + z + nz, 1 + y : 1 + y + ny, 1 + x : 1 + x + nx]


def _stored(simulation: "Simulation", name: str) -> Array:
    """(nz, ny, nx) a field of modules."""
    dynamics = simulation.dynamics
    field = dynamics.lanes.gather(getattr(dynamics, name).to_numpy())
    return _of_modules(field, (0, 0, 0), dynamics.lattice.mask.shape)


def _determinants(simulation: "Simulation", field: Array) -> Array:
    """(nz, ny, nx) J of modules, by NumPy."""
    lattice = simulation.dynamics.lattice
    place = (lattice.positions() + field)[0]
    gradient = np.zeros((*lattice.mask.shape, 3, 3))
    for x, y, z in CORNERS:
        corner = np.stack(
            [
                _of_modules(
                    place[..., axis], (int(z > 0), int(y > 0), int(x > 0)), lattice.mask.shape
                )
                for axis in range(3)
            ],
            axis=-1,
        )
        gradient += corner[..., :, None] * np.array((x, y, z)) / (4 * lattice.spacing)
    return np.asarray(np.linalg.det(gradient))


def _damage(simulation: "Simulation") -> Array:
    """(nz, ny, nx) 1 less the least share of stiffness of a module's bars, bar by bar."""
    dynamics = simulation.dynamics
    lattice, families = dynamics.lattice, mat.bars_of(simulation.scene)
    peaks = dynamics.lanes.gather(dynamics.peak.to_numpy())
    least = np.ones(lattice.mask.shape)
    for bar, offset in lattice.cell.of_module:
        peak = _of_modules(peaks[bar], offset, lattice.mask.shape)
        last = families[lattice.cell.family[bar]].ductility
        falling = (last - peak) / (last - 1) / np.maximum(peak, 1)  # Fig. 2 of the paper
        share = np.where(peak > 1, np.maximum(falling, 0), 1.0)
        share[peak < 0] = 0  # failed at the tip of a crack
        least = np.minimum(least, share)
    return 1 - least


def test_a_module_loses_its_volume_with_its_weakest_bar(simulation: "Simulation") -> None:
    _renewed(simulation, **BRITTLE)
    dynamics = simulation.dynamics
    lattice = dynamics.lattice
    if lattice.offsets is not None:
        pytest.skip("the reference's modules are those of a regular lattice")
    modulus = mat.volumetric_modulus(MODULUS, 0.36) * lattice.spacing**3
    stretch = 0.018 * lattice.positions()[..., 0] * lattice.exists()
    loss, before = np.zeros(lattice.mask.shape), np.zeros(lattice.mask.shape)
    for seed in (5, 6, 7):  # the damage of a step is that of the bars after the step before it
        field = 0.25 * _noise(simulation, seed)
        field[..., 0] += stretch
        damage = _damage(simulation)
        dynamics.set_displacement(0, field)
        dynamics.kick(0, 0.0)
        np.testing.assert_allclose(_stored(simulation, "volume_damage"), damage, atol=1e-12)
        grown = _determinants(simulation, field) - 1

        def share(damage: Array, grown: Array = grown) -> Array:
            return np.where((grown < 0) & (damage < 1), 1.0, 1 - damage)

        loss += 0.5 * modulus * (share(before) - share(damage)) * grown**2
        before = damage
    assert np.count_nonzero((damage > 0) & (damage < 1)) > 10
    assert np.count_nonzero(damage == 1) > 10
    np.testing.assert_allclose(_stored(simulation, "volume_loss"), loss, atol=1e-9 * loss.max())
    simulation.energies.potential(0)
    with_volumes = simulation.energies.total()
    kept = dynamics.volumetric
    dynamics.volumetric = 0.0
    simulation.energies.potential(0)
    bars = simulation.energies.total()
    dynamics.volumetric = kept
    of_volumes = 0.5 * modulus * (share(damage) * grown**2).sum()
    assert with_volumes[0] - bars[0] == pytest.approx(of_volumes, rel=1e-9)
    assert with_volumes[1] == pytest.approx(bars[1], rel=1e-12)
    assert loss.sum() < with_volumes[1]
    # the stress that a run stores is that of the same shares, of either sign of lambda - mu
    stored = ModuleFields(dynamics, ["strain"], np.zeros((0, 3)), np.zeros((0, 8), dtype=int))
    rows = [values[lattice.mask] for values in (grown, damage)]
    left = stored.moduli_left(rows[0]) * lattice.spacing**3
    np.testing.assert_allclose(left, modulus * share(rows[1], rows[0]), rtol=1e-12)
    dynamics.volumetric = -kept
    simulation.energies.potential(0)
    negative = simulation.energies.total()[0] - bars[0]
    left = stored.moduli_left(rows[0]) * lattice.spacing**3
    dynamics.volumetric = kept
    assert negative == pytest.approx(0.5 * (left * rows[0] ** 2).sum(), rel=1e-9)
    assert abs(negative + of_volumes) > 1e-3 * of_volumes


def test_a_flying_body_cracks_and_keeps_momentum_and_energy(simulation: "Simulation") -> None:
    """It turns at 500 rad/s, is pulled apart, and breaks; no force from outside."""
    times = {"solver": {"duration": 3e-5, "safety": 0.5}, "output": {"history_interval": 1e-6}}
    _renewed(simulation, **BRITTLE, **times)
    lattice = simulation.dynamics.lattice
    exists = lattice.exists()[..., None]
    place = lattice.positions() * exists
    drift = np.array([20.0, -10.0, 30.0])
    velocity = (drift + np.cross([300.0, -200.0, 500.0], place)) * exists
    velocity[..., 0] += 6e4 * place[..., 0]
    simulation.start_from(np.zeros_like(velocity), velocity)
    mass = simulation.dynamics.masses()[..., None]

    def momenta() -> tuple[Array, Array]:
        momentum = mass * simulation.dynamics.get_velocity()
        moment = np.cross((place + simulation.displacement()) * exists, momentum)
        return momentum.sum(axis=(0, 1, 2, 3)), moment.sum(axis=(0, 1, 2, 3))

    start = momenta()
    samples = list(simulation.samples())
    assert samples[-1].broken_bars > 50
    assert samples[-1].ledger.fracture > 0.05 * samples[-1].ledger.kinetic_plate
    assert max(sample.energy_error for sample in samples) < 4e-3
    np.testing.assert_allclose(momenta()[0], start[0], atol=1e-12 * np.abs(start[0]).max())
    np.testing.assert_allclose(momenta()[1], start[1], atol=1e-12 * np.abs(start[1]).max())


# -- scenes ----------------------------------------------------------------------------------------


def test_it_is_the_default_where_bars_alone_are_not_isotropic() -> None:
    scene = block_scene(4, 4, 2, material=PMMA | {"poisson_ratio": 0.36})
    assert scene.plate.stiffness == "volumetric"
    assert block_scene(4, 4, 2).plate.stiffness == "equation-2"
    assert scene.changed("material.poisson_ratio=0.25").plate.stiffness == "equation-2"
    assert scene.changed("plate.stiffness=equation-2").plate.stiffness == "equation-2"


def test_bars_that_break_are_refused_where_they_would_give_energy() -> None:
    with pytest.raises(SceneError, match=r"poisson_ratio = 0.1: must be at least 0.16 where bars"):
        block_scene(4, 4, 2, material=BREAKS | {"poisson_ratio": 0.1})
    with pytest.raises(SceneError, match=r"poisson_ratio = 0.0: .*is a mechanism"):
        block_scene(
            4, 4, 2, material=PMMA | {"poisson_ratio": 0.0}, plate={"stiffness": "equation-2"}
        )
