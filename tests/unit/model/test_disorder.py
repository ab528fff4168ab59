"""Weibull fields (Eqs. (14)-(17)), and what a lattice of uneven bars and nodes does."""

import math
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.stats import kstest, weibull_min
from support.blocks import DAMAGE, PMMA, SPACING, block_scene
from support.paths import ROOT
from support.reference import Body

from taichi_ldem.errors import SceneError
from taichi_ldem.model import disorder as dis
from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scene import Material

if TYPE_CHECKING:
    from taichi_ldem.solver.dynamics import Dynamics
    from taichi_ldem.solver.simulation import Simulation

PAPER = ("fracture_energy", "youngs_modulus", "density")
ALL = {f"{name}_cv": 0.3 for name in PAPER}


# --- the distribution -----------------------------------------------------------------------------


@pytest.mark.parametrize("cv", [1e-3, 0.1, 0.25, 0.5, 1.0, 1.5])
def test_the_shape_gives_the_cv_and_a_mean_of_one(cv: float) -> None:
    shape = dis.shape_from_cv(cv)
    expected = weibull_min(shape, scale=1 / math.gamma(1 + 1 / shape))
    assert expected.mean() == pytest.approx(1.0, rel=1e-12)
    assert expected.std() == pytest.approx(cv, rel=1e-9 / cv)
    assert dis.cv_from_shape(shape) == pytest.approx(cv, rel=1e-9 / cv)


def test_small_cvs_go_over_into_their_limit() -> None:
    below, above = (dis.shape_from_cv(c * dis.SMALLEST_CV) for c in (1 - 1e-9, 1 + 1e-9))
    assert below == pytest.approx(above, rel=1e-4)
    assert math.isfinite(dis.shape_from_cv(1e-20))


@pytest.mark.parametrize("shape", [0.8, 2.1, 12.0, 200.0])
def test_the_shape_of_data_is_that_of_greatest_likelihood(shape: float) -> None:
    values = 930 * weibull_min(shape).rvs(40, random_state=3)
    fitted, _, _ = weibull_min.fit(values, floc=0)
    assert dis.shape_from_data(values) == pytest.approx(fitted, rel=1e-3)  # SciPy's tolerance
    assert dis.shape_from_data(1e12 * values) == pytest.approx(
        dis.shape_from_data(values), rel=1e-9
    )


def test_data_take_the_place_of_a_cv() -> None:
    values = [810.0, 930.0, 1050.0, 900.0, 1000.0]
    scene = block_scene(4, 3, 2, material=DAMAGE, disorder={"fracture_energy_data": values})
    assert dis.shape_of(scene.disorder, "fracture_energy") == dis.shape_from_data(values)
    wild = block_scene(4, 3, 2, material=DAMAGE, disorder={"fracture_energy_data": [1e-9, 1, 2, 3]})
    with pytest.raises(SceneError, match=r"^disorder\.fracture_energy_data: .* at most 1\.5"):
        dis.draw(wild, Lattice(prism(4, 3, 2), SPACING))


# --- strength by volume ---------------------------------------------------------------------------


@pytest.mark.parametrize("modules", [3, 6])
def test_specimens_have_the_measured_strength_whatever_the_module(modules: int) -> None:
    """The weakest bar along x of a prism of 4 x 1 x 1 mm, for 8 mm3 that were tested at CV 15 %.

    Weakest link (Weibull 1939): the mean is (8 / 4)^(1 / gamma) times that of the tested volume.
    """
    count, spacing = 400, 1e-3 / modules
    shape = dis.shape_from_cv(0.15)
    weakest = []
    for seed in range(count):
        scene = block_scene(
            4 * modules,
            modules,
            modules,
            spacing=spacing,
            material=DAMAGE | {"fracture": "crack"},
            disorder={"strength_cv": 0.15, "reference_volume": 8e-9, "seed": seed},
        )
        lattice = Lattice(prism(4 * modules, modules, modules), spacing)
        strength = dis.draw(scene, lattice).peak_strain
        assert strength is not None
        exists = lattice.bar_exists()
        along = [0, 3]
        eps_p = mat.check(scene).longitudinal.peak_strain
        weakest.append(eps_p * strength[..., along][exists[..., along]].min())
    expected = 0.0175 * 2 ** (1 / shape)
    # bars between centres do not reach the last half modules: 3 % of the volume at most
    assert np.mean(weakest) == pytest.approx(expected, abs=3 * 0.15 * expected / math.sqrt(count))
    assert np.std(weakest) / np.mean(weakest) == pytest.approx(0.15, abs=3 * 0.15 / math.sqrt(800))


def test_strength_varies_with_g_f_the_same_everywhere() -> None:
    scene = block_scene(4, 3, 2, material=DAMAGE, disorder={"strength_cv": 0.1})
    drawn = dis.draw(scene, Lattice(prism(4, 3, 2), SPACING))
    assert drawn.fracture_energy is None
    assert drawn.peak_strain is drawn.strength


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"strength_cv": 0.1, "fracture_energy_cv": 0.1}, "cannot vary together"),
        ({"density_cv": 0.1, "reference_volume": 1e-8}, "needs disorder.strength_cv > 0"),
        (
            {"strength_cv": 0.1, "reference_volume": 1e-8, "correlation_length": 1e-3},
            "must be 0 with disorder.reference_volume",
        ),
    ],
)
def test_strengths_that_mean_nothing_are_refused(keys: dict[str, float], said: str) -> None:
    with pytest.raises(SceneError, match=said):
        block_scene(4, 3, 2, material=DAMAGE, disorder=keys)


# --- fields ---------------------------------------------------------------------------------------


def _fields(lattice: Lattice, **keys: float) -> dis.Drawn:
    nx, ny, nz = lattice.modules
    scene = block_scene(nx, ny, nz, spacing=lattice.spacing, material=DAMAGE, disorder=keys)
    return dis.draw(scene, lattice)


@pytest.mark.parametrize("cv", [0.1, 0.5, 1.5])
def test_drawn_factors_are_weibull(cv: float) -> None:
    lattice = Lattice(prism(12, 12, 6), SPACING)
    drawn = _fields(lattice, **{f"{name}_cv": cv for name in PAPER}, seed=7)
    shape = dis.shape_from_cv(cv)
    expected = weibull_min(shape, scale=1 / math.gamma(1 + 1 / shape))
    exists = lattice.bar_exists()
    for name in PAPER:
        values = getattr(drawn, name)
        there = values.ravel() if name == "density" else values[exists]
        assert kstest(there, expected.cdf).pvalue > 0.01
        mean, found = drawn.statistics(lattice)[name]
        assert mean == pytest.approx(1.0, abs=4 * cv / math.sqrt(len(there)))
        # the sample CV's own deviation grows with the tail's: about 2 CV / sqrt(n) at CV 1.5
        assert found == pytest.approx(cv, abs=8 * cv / math.sqrt(len(there)))


def test_each_property_has_a_stream_of_its_own() -> None:
    lattice = Lattice(prism(6, 5, 3), SPACING)
    alone = _fields(lattice, fracture_energy_cv=0.25, seed=3)
    beside = _fields(lattice, **ALL | {"fracture_energy_cv": 0.25}, seed=3)
    assert alone.youngs_modulus is None
    assert alone.density is None
    assert alone.fracture_energy is not None
    assert beside.fracture_energy is not None
    assert beside.youngs_modulus is not None
    np.testing.assert_array_equal(alone.fracture_energy, beside.fracture_energy)
    both = np.corrcoef(beside.fracture_energy.ravel(), beside.youngs_modulus.ravel())
    assert abs(both[0, 1]) < 4 / math.sqrt(alone.fracture_energy.size)
    other = _fields(lattice, fracture_energy_cv=0.25, seed=4).fracture_energy
    assert not np.any(other == alone.fracture_energy)


def test_a_seed_means_the_same_field_for_good() -> None:
    """Computed once with NumPy 2.2: a stored checkpoint's field is drawn again from its seed."""
    drawn = _fields(Lattice(prism(2, 2, 2), SPACING), fracture_energy_cv=0.5, seed=11)
    assert drawn.fracture_energy is not None
    first = drawn.fracture_energy[1, 1, 1, :3]
    assert first == pytest.approx(FIRST, rel=1e-12)


FIRST = [2.279487232109142, 0.7375572092215192, 1.45289853353897]


def test_the_correlated_field_has_its_covariance() -> None:
    length, points = 2e-3, 0.5 * 2e-3 * np.arange(72)
    field = dis.GaussianField(length, 5, 0).on_grids([(points, points, points)])[0]
    assert field.shape == (72, 72, 72)
    # 36 correlation lengths a side, 2.8 l^3 the field's integral scale: about 17 000 samples
    assert field.mean() == pytest.approx(0.0, abs=4 / math.sqrt(17_000))
    assert field.std() == pytest.approx(1.0, abs=4 / math.sqrt(17_000))
    for n in (1, 2, 3, 4):
        for axis in range(3):
            a, b = (np.moveaxis(field, axis, 0)[part] for part in (np.s_[n:], np.s_[:-n]))
            assert np.mean(a * b) == pytest.approx(math.exp(-((0.5 * n) ** 2)), abs=0.03)
    assert kstest(field[::6, ::6, ::6].ravel(), "norm").pvalue > 0.01


def test_the_noise_is_weighed_to_the_stated_covariance() -> None:
    """Exactly, from the weights: variance one everywhere, the covariance to 1e-6."""
    field = dis.GaussianField(1.0, 0, 0)
    field._low = [-400, -400, -400]
    places = np.array([0.0, 0.07, 0.2, 0.31, 0.8, 1.33, 2.0])
    unit = np.eye(800).reshape(800, 800, 1)  # each point's own share
    weights = field._smooth(unit, 0, places)[:, :, 0]
    covariance = weights @ weights.T
    np.testing.assert_allclose(np.diag(covariance), 1.0, rtol=1e-14)
    expected = np.exp(-(np.subtract.outer(places, places) ** 2))
    np.testing.assert_allclose(covariance, expected, atol=1e-6)


def test_two_module_sizes_see_the_same_realisation() -> None:
    """A bar along x between corners has its mid-point on a bar of the lattice of a third of L."""
    keys = ALL | {"correlation_length": 2e-3, "seed": 9}
    coarse = _fields(Lattice(prism(5, 4, 2), 9e-4), **keys)
    fine = _fields(Lattice(prism(15, 12, 6), 3e-4), **keys)
    for name in ("fracture_energy", "youngs_modulus"):
        a, b = getattr(coarse, name), getattr(fine, name)
        np.testing.assert_allclose(a[1:4, 1:6, 1:6, 0], b[1:8:3, 1:14:3, 2:17:3, 0], rtol=1e-10)
    assert coarse.density is not None
    assert fine.density is not None
    np.testing.assert_allclose(coarse.density, fine.density[1::3, 1::3, 1::3], rtol=1e-10)
    assert np.std(coarse.density) > 0.1


# --- bars and nodes -------------------------------------------------------------------------------

CVS = {"fracture_energy_cv": 0.5, "youngs_modulus_cv": 0.3, "density_cv": 0.25, "seed": 2}
EDGE = 0.2e-3  # K_r of 3.5 and 4.1
EPS_P = DAMAGE["failure_strain"]


class Uneven:
    """A block with all three kinds of disorder whose nodes are placed by hand."""

    def __init__(self) -> None:
        from taichi_ldem.solver.build import build_dynamics
        from taichi_ldem.solver.energy import EnergySums

        scene = block_scene(4, 3, 3, spacing=EDGE, material=DAMAGE, disorder=CVS)
        self.dynamics: Dynamics = build_dynamics(scene)[0]
        self.body = Body(self.dynamics.lattice.mask, EDGE)
        self.drawn = dis.draw(scene, self.dynamics.lattice)
        self.families = mat.bar_families(Material(**PMMA | DAMAGE), EDGE)
        self.stiffness = tuple(
            f.axial_stiffness for f in (self.families.longitudinal, self.families.diagonal)
        )
        self.ductility = self.body.per_bar(
            self.families.longitudinal.ductility, self.families.diagonal.ductility
        )
        self.energy = self._bars(self.drawn.fracture_energy)
        self.modulus = self._bars(self.drawn.youngs_modulus)
        self.own = EPS_P * np.sqrt(self.energy / self.modulus)
        self.sums = EnergySums(self.dynamics)

    def _bars(self, values: np.ndarray | None) -> np.ndarray:
        assert values is not None
        return self.body.bar_values(values, self.dynamics.lattice.bar_midpoints)

    def renew(self) -> "Uneven":
        """All bars whole and as drawn."""
        for name in ("peak", "touched", "recorded", "displacement", "velocity"):
            for field in self.dynamics.fields()[name]:
                field.fill(0)
        assert self.drawn.peak_strain is not None
        assert self.drawn.youngs_modulus is not None
        self.dynamics.set_strength(self.drawn.peak_strain)
        self.dynamics.set_modulus(self.drawn.youngs_modulus)
        return self

    def put(self, displacement: np.ndarray) -> None:
        self.dynamics.set_displacement(0, self.body.spread(displacement))
        self.dynamics.get_acceleration(0)

    def energies(self) -> tuple[float, float, int]:
        self.sums.potential(0)
        strain, fracture, broken, *_ = self.sums.total()
        return float(strain), float(fracture), int(broken)

    def kept(self, strain: np.ndarray, peak: np.ndarray) -> np.ndarray:
        """Share of the stiffness by Fig. 2, peak strains over each bar's own eps_p."""
        branch = np.clip((self.ductility - peak) / (self.ductility - 1), 0, 1)
        secant = np.where(peak > 1, branch / np.maximum(peak, 1), 1.0)
        return np.where((strain > 0) | (secant == 0), secant, 1.0)


@pytest.fixture(scope="module")
def _uneven(taichi: None) -> Uneven:
    return Uneven()


@pytest.fixture
def uneven(_uneven: Uneven) -> Uneven:
    return _uneven.renew()


def test_any_history_of_uneven_bars(uneven: Uneven) -> None:
    rng, body = np.random.default_rng(11), uneven.body
    peak = np.zeros(len(body.ends))
    for size in (0.2, 0.5, 0.3, 1.0, 0.2, 2.0):
        displacement = rng.normal(0.0, size * EPS_P * EDGE, (len(body.places), 3))
        uneven.put(displacement)
        strain = body.strains(displacement)
        peak = np.maximum(peak, strain / uneven.own)
        kept = uneven.modulus * uneven.kept(strain, peak)
        expected = body.forces(displacement, uneven.stiffness, kept)
        force = uneven.dynamics.get_force(0)[body.index]
        np.testing.assert_allclose(force, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        energy, _, broken = uneven.energies()
        whole = body.strain_energy(displacement, uneven.stiffness, kept)
        assert energy == pytest.approx(whole, rel=1e-12)
        assert broken == np.count_nonzero(peak >= uneven.ductility)
    assert 0 < broken < len(body.ends)
    assert len(uneven.dynamics.new_broken()[1]) == broken


def _set(uneven: Uneven, strength: np.ndarray, modulus: np.ndarray) -> None:
    uneven.dynamics.set_strength(strength)
    uneven.dynamics.set_modulus(modulus)


def test_a_bar_softens_at_its_own_strain_and_takes_its_own_energy(uneven: Uneven) -> None:
    """One bar of G_f x = 0.36 and E y = 0.64 among bars that hold: eps_p sqrt(x/y) = 0.75 eps_p."""
    body, lattice = uneven.body, uneven.dynamics.lattice
    shape = (*lattice.sites, 14)
    numbers = np.arange(np.prod(shape)).reshape(shape)
    for diagonal in (False, True):
        chosen = int(np.argmax(body.diagonal == diagonal))
        home = numbers == body.bar_values(numbers, lattice.bar_midpoints)[chosen]
        _set(uneven, np.where(home, 0.75, 100.0), np.where(home, 0.64, 1.0))
        for name in ("peak", "touched"):
            for field in uneven.dynamics.fields()[name]:
                field.fill(0)
        ductility = uneven.ductility[chosen]
        area = body.weights[chosen] * mat.fracture_areas(0.25)[diagonal] * EDGE**2
        given = 0.36 * DAMAGE["fracture_energy"] * area
        for ratio, expected in ((0.749, 0.0), (0.76, None), (0.7499 * ductility, given)):
            uneven.put(ratio * EPS_P * body.positions)
            _, fracture, broken = uneven.energies()
            assert broken == 0
            # just above its own eps_p: a few per cent of it
            assert (
                0 < fracture < 0.05 * given
                if expected is None
                else (fracture == pytest.approx(expected, rel=1e-3))
            )
        uneven.put(0.7501 * ductility * EPS_P * body.positions)
        _, fracture, broken = uneven.energies()
        assert broken == 1
        assert fracture == pytest.approx(given, rel=1e-12)


def test_columns_whose_bars_are_whole_stay_untouched(uneven: Uneven) -> None:
    """Past the cheap test, but no bar past its own eps_p: nothing is kept of it."""
    strength = np.ones((*uneven.dynamics.lattice.sites, 14))
    strength[..., [2, 5]] = 0.3  # along z, which the stretch leaves alone
    _set(uneven, strength, np.ones_like(strength))
    pulled = EPS_P * uneven.body.positions * [1, 0, 0]
    uneven.put(0.99 * pulled)
    assert not uneven.dynamics.touched.to_numpy().any()
    uneven.put(1.01 * pulled)
    assert uneven.dynamics.touched.to_numpy().any()


def test_a_node_has_the_mass_of_the_modules_around_it(uneven: Uneven) -> None:
    body, factor = uneven.body, uneven.drawn.density
    assert factor is not None
    module = PMMA["density"] * EDGE**3
    expected = np.zeros(len(body.places))
    number = {tuple(p): n for n, p in enumerate(body.places.tolist())}
    for (k, j, i), x in np.ndenumerate(factor):
        low = 2 * np.array([i, j, k])
        expected[number[tuple((low + 1).tolist())]] += x * module / 2
        for corner in np.ndindex(2, 2, 2):
            expected[number[tuple((low + 2 * np.array(corner)).tolist())]] += x * module / 16
    mass = uneven.dynamics.masses()
    np.testing.assert_allclose(mass[body.index], expected, rtol=1e-14)
    assert mass.sum() == pytest.approx(factor.sum() * module, rel=1e-14)
    placed = np.random.default_rng(1).normal(0.0, 1e-5 * EDGE, (len(body.places), 3))
    uneven.put(placed)
    accelerations = uneven.dynamics.get_acceleration(0)[body.index]
    pulls = body.forces(placed, uneven.stiffness, uneven.modulus)
    np.testing.assert_allclose(
        accelerations * expected[:, None], pulls, rtol=0, atol=1e-13 * uneven.stiffness[0]
    )


def test_the_critical_step_is_that_of_the_uneven_body(uneven: Uneven) -> None:
    from scipy.linalg import eigvalsh

    from taichi_ldem.solver.stability import critical_time_step

    body = uneven.body
    mass = np.repeat(uneven.dynamics.masses()[body.index], 3)
    matrix = body.stiffness_matrix(uneven.stiffness, uneven.modulus).toarray()
    highest = np.sqrt(eigvalsh(matrix / np.sqrt(np.outer(mass, mass)))[-1])
    # stated tolerance of the Lanczos value: 1e-3 in its square
    assert critical_time_step(uneven.dynamics) == pytest.approx(2 / highest, rel=1e-3)


# --- whole runs -----------------------------------------------------------------------------------

RUN = """
import sys
import numpy as np
sys.path.insert(0, "tests")
from support.blocks import DAMAGE, block_scene
from taichi_ldem.solver import backend

scene = block_scene(
    9, 16, 2,
    material=DAMAGE,
    disorder={"fracture_energy_cv": 0.25, "youngs_modulus_cv": 0.1, "density_cv": 0.1,
              "correlation_length": 1.2e-3, "seed": 3},
    solver={"threads": int(sys.argv[1])},
)
backend.start(scene.solver)
from taichi_ldem.solver.simulation import Simulation

simulation = Simulation(scene)
# both ends fly apart at 60 m/s, with waves of +- c eps_p = 32 m/s between them
lattice = simulation.dynamics.lattice
place = lattice.positions()
velocity = np.zeros_like(place)
velocity[..., 1] = 60 * place[..., 1] / place[..., 1].max()
velocity *= lattice.exists()[..., None]
simulation.start_from(np.zeros_like(place), velocity)
samples = [simulation.sample_step() for _ in range(150)]
rows = [(s.broken_bars, s.energy_error, *vars(s.ledger).values()) for s in samples]
np.savez(sys.argv[2], rows=rows, displacement=simulation.displacement(),
         velocity=simulation.dynamics.get_velocity(), drawn=list(simulation.drawn.values()))
"""


@pytest.mark.slow
def test_threads_change_no_bit_and_the_ledger_closes(tmp_path: Path) -> None:
    results = []
    for threads in ("1", "2"):
        out = tmp_path / f"{threads}.npz"
        subprocess.run([sys.executable, "-c", RUN, threads, out], cwd=ROOT, check=True, timeout=300)
        with np.load(out) as data:
            results.append(dict(data))
    one, two = results
    for name in one:
        np.testing.assert_array_equal(one[name], two[name])
    rows = one["rows"]
    broken, error = rows[:, :2].T
    assert rows[0, 2] > 0
    assert 50 < broken[-1] < 1e4
    assert rows[-1, 5] > 0.02 * rows[0, 2]  # fracture over the kinetic energy at the start
    assert np.count_nonzero(rows[:, 5] == 0) > 5
    assert error[rows[:, 5] == 0].max() < 1e-5
    # bars soften within a few steps, which the ledger sees: as in the homogeneous body
    assert error.max() < 0.02


def test_a_checkpoint_of_other_fields_is_refused(taichi: None, elastic: "Simulation") -> None:
    saved = elastic.saved_state()
    assert saved["clock/drawn"].shape == (0, 2)
    with pytest.raises(ValueError, match="drawn"):
        elastic.restore_state(saved | {"clock/drawn": np.ones((1, 2))})
