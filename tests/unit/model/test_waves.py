"""Exact waves of the lattice: compared with the solid and with the lattice bar by bar."""

import itertools

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv
from support.blocks import PMMA, SPACING
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model import waves
from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.lattice import Lattice, disc, prism
from taichi_ldem.scene import Material

RHO = PMMA["density"]
MODULE_MASS = RHO * SPACING**3


def _material(nu: float = 0.25) -> Material:
    return Material(**PMMA | {"poisson_ratio": nu})


def _stiffness(nu: float = 0.25, variant: str = "equation-2") -> tuple[float, float]:
    return mat.axial_stiffness(PMMA["youngs_modulus"], nu, SPACING, variant)


# -- the infinite lattice --------------------------------------------------------------------------


@pytest.mark.parametrize("variant", ["equation-2", "as-printed"])
@pytest.mark.parametrize("nu", [0.2, 0.25, 0.3, 0.4])
def test_long_waves_travel_as_in_the_cubic_solid(nu: float, variant: str) -> None:
    """Christoffel's equation of a cubic crystal along its three axes of symmetry."""
    c11, c12, c44 = mat.elastic_constants(PMMA["youngs_modulus"], nu, variant)
    medium = waves.bulk(_material(nu), SPACING, variant)
    moduli = {
        (1, 0, 0): [c11, c44, c44],
        (1, 1, 0): [(c11 + c12 + 2 * c44) / 2, (c11 - c12) / 2, c44],
        (1, 1, 1): [(c11 + 2 * c12 + 4 * c44) / 3] + 2 * [(c11 - c12 + c44) / 3],
    }
    for direction, expected in moduli.items():
        k = 1e-3 / SPACING * np.array(direction) / np.linalg.norm(direction)
        # dispersion takes (k L)^2 / 24 or so: 1e-7
        speeds = np.sort(np.sqrt(np.array(expected) / RHO))
        np.testing.assert_allclose(medium.phase_velocities(k), speeds, rtol=1e-6)
        group = medium.group_velocities(k) @ (k / np.linalg.norm(k))
        np.testing.assert_allclose(group, speeds, rtol=1e-6)


def test_a_wave_is_an_eigenvector_of_the_lattice_bar_by_bar() -> None:
    """K u = omega^2 M u at the inner nodes of a block put together from Section 2 alone."""
    body = Body(prism(5, 5, 5), SPACING)
    stiffness = body.stiffness_matrix(_stiffness(0.3))
    medium = waves.bulk(_material(0.3), SPACING)
    inner = np.abs(body.places - 5).max(axis=1) <= 2
    assert set(body.places[inner, 0] % 2) == {0, 1}  # corner and centre nodes
    rng = np.random.default_rng(3)
    for k in rng.uniform(-2 * np.pi, 2 * np.pi, (5, 3)) / SPACING:
        omega, shapes = medium.waves(k)
        for n in range(3):
            field = np.exp(1j * body.positions @ k)[:, None] * shapes[:, n]
            force = (stiffness @ field.ravel()).reshape(-1, 3)[inner]
            inertia = omega[n] ** 2 * 0.5 * MODULE_MASS * field[inner]
            scale = medium.highest_frequency**2 * 0.5 * MODULE_MASS
            np.testing.assert_allclose(force, inertia, atol=1e-12 * scale)


def test_group_velocity_is_the_slope_of_the_frequency() -> None:
    medium = waves.bulk(_material(0.3), SPACING)
    k = np.array([1.1, 0.7, 0.2]) / SPACING
    step = 1e-5 / SPACING
    slope = [
        (medium.frequencies(k + step * e) - medium.frequencies(k - step * e)) / (2 * step)
        for e in np.eye(3)
    ]
    np.testing.assert_allclose(medium.group_velocities(k), np.transpose(slope), rtol=1e-6)


def test_a_branch_is_named_by_its_polarisation() -> None:
    medium = waves.bulk(_material(), SPACING)
    k = 2 * np.pi / (8 * SPACING) * np.eye(3)[0]
    omega, shape = medium.branch(k, [0.0, 0.6, 0.8])  # a degenerate pair
    assert omega == pytest.approx(medium.frequencies(k)[0], rel=1e-12)
    np.testing.assert_allclose(shape, [0.0, 0.6, 0.8], atol=1e-12)
    assert medium.branch(k, [1.0, 0.0, 0.0])[0] == pytest.approx(medium.frequencies(k)[2])


# -- modules with an energy of their volume --------------------------------------------------------

RATIOS = (0.0, 0.1, 0.36, 0.45)


def _with_volumes(body: Body, nu: float) -> np.ndarray:
    """Stiffness matrix of a body: bar by bar, then volume by volume."""
    bars = mat.bar_families(_material(nu), SPACING, "volumetric", lattice=body.lattice)
    stiffness = body.stiffness_matrix(tuple(bar.axial_stiffness for bar in bars))
    modulus = mat.volumetric_modulus(PMMA["youngs_modulus"], nu) * SPACING
    number = {tuple(place): n for n, place in enumerate(body.places.tolist())}
    for k, j, i in np.argwhere(body.mask):
        swelling = np.zeros((len(body.places), 3))
        for sign in itertools.product((-1, 1), repeat=3):
            place = 2 * np.array([i, j, k]) + 1 + sign
            swelling[number[tuple(place.tolist())]] = np.array(sign) / 4
        stiffness += modulus * np.outer(swelling, swelling)
    return stiffness


@pytest.mark.parametrize("lattice", CELLS)
@pytest.mark.parametrize("nu", RATIOS)
def test_long_waves_of_volumes_have_the_speeds_of_the_solid(nu: float, lattice: str) -> None:
    """c_P^2 = 2 mu (1 - nu) / ((1 - 2 nu) rho) and c_S^2 = mu / rho in every direction."""
    shear = PMMA["youngs_modulus"] / (2 * (1 + nu))
    c_p, c_s = np.sqrt(np.array([2 * (1 - nu) / (1 - 2 * nu), 1.0]) * shear / RHO)
    medium = waves.bulk(_material(nu), SPACING, "volumetric", lattice)
    assert medium.fastest == pytest.approx(c_p, rel=1e-6)
    for direction in ((1, 0, 0), (1, 1, 0), (1, 1, 1), (2.0, 1.0, 0.3)):
        unit = np.array(direction) / np.linalg.norm(direction)
        k = 1e-3 / SPACING * unit
        np.testing.assert_allclose(medium.phase_velocities(k), (c_s, c_s, c_p), rtol=2e-6)
        np.testing.assert_allclose(medium.group_velocities(k) @ unit, (c_s, c_s, c_p), rtol=2e-6)


@pytest.mark.parametrize("lattice", CELLS)
@pytest.mark.parametrize("nu", RATIOS)
def test_no_wave_of_volumes_is_softer_than_bars_allow(nu: float, lattice: str) -> None:
    """Over the whole Brillouin zone; below 1/4 the volumes' modulus is negative."""
    medium = waves.bulk(_material(nu), SPACING, "volumetric", lattice)
    steps = np.linspace(0, 2 * np.pi / SPACING, 17)
    k = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    phase = k * SPACING
    # the squared sines vanish at the lattice's own wave vectors alone, where nodes do not move
    swing = 4 * (np.sin(0.5 * phase) ** 2).sum(axis=1) / SPACING**2
    moving = swing > 1e-6 / SPACING**2
    shear = PMMA["youngs_modulus"] / (2 * (1 + nu)) / RHO
    assert (medium.every_branch(k)[moving, 0] / (shear * swing[moving])).min() > 0.2


@pytest.mark.parametrize("lattice", CELLS)
@pytest.mark.parametrize("nu", [0.1, 0.45])
def test_waves_of_volumes_are_those_of_the_lattice_put_together(nu: float, lattice: str) -> None:
    """K u = omega^2 M u at the inner nodes; also for waves along and across an axis."""
    body = Body(prism(5, 5, 5), SPACING, lattice=lattice)
    stiffness = _with_volumes(body, nu)
    medium = waves.bulk(_material(nu), SPACING, "volumetric", lattice)
    inner = np.abs(body.places - 5).max(axis=1) <= 2
    sublattice = body.places[:, 0] % 2
    scale = np.abs(stiffness).max()

    def check(k: np.ndarray, square: float, shape: np.ndarray) -> None:
        field = np.exp(1j * body.positions @ k)[:, None] * shape[sublattice]
        force = (stiffness @ field.ravel()).reshape(-1, 3)[inner]
        np.testing.assert_allclose(force, square * medium.mass * field[inner], atol=1e-12 * scale)

    for k in np.random.default_rng(3).uniform(-np.pi, np.pi, (3, 3)) / SPACING:
        omega, shapes = medium.waves_of_site(k)
        for n in range(3):
            check(k, omega[n] ** 2, shapes[..., n])
    k = np.array([1.3, 0.0, 0.0]) / SPACING
    for along in np.eye(3)[:2]:
        omega, shares = medium.straight(k, along)
        check(k, float(omega) ** 2, shares[:, None] * along)
        assert np.mean(shares**2) == pytest.approx(1.0)


@pytest.mark.parametrize("lattice", CELLS)
@pytest.mark.parametrize("axis", [0, 2])
def test_a_bar_s_waves_with_volumes_are_those_of_the_bar_put_together(
    axis: int, lattice: str
) -> None:
    nu, sides = 0.4, [2, 3]
    sides.insert(axis, 7)
    body = Body(prism(*sides), SPACING, lattice=lattice)
    piece = Lattice(prism(*sides), SPACING, cell=CELLS[lattice])
    guide = waves.waveguide(_material(nu), piece, axis, "volumetric")
    _check_bar(body, guide, _with_volumes(body, nu))


# -- time steps ------------------------------------------------------------------------------------


def test_central_differences_of_an_oscillator_have_the_discrete_frequency() -> None:
    omega, step = 3.0, 0.4
    before, now = np.cos(-waves.discrete_frequency(omega, step) * step), 1.0
    turned = np.arccos(now)
    for _ in range(7):  # u(n+1) - 2 u(n) + u(n-1) = -(omega dt)^2 u(n)
        before, now = now, (2 - (omega * step) ** 2) * now - before
        turned += waves.discrete_frequency(omega, step) * step
        assert now == pytest.approx(np.cos(turned), abs=1e-12)


def test_beyond_the_stable_step_there_is_no_frequency() -> None:
    with pytest.raises(ValueError, match="unstable"):
        waves.discrete_frequency([1.0, 2.1], 1.0)


def test_the_critical_step_of_a_large_block_is_that_of_the_infinite_lattice(
    taichi: None,
) -> None:
    """Of a block in a rigid box: free corners ring faster than the infinite lattice."""
    from taichi_ldem.solver.dynamics import Dynamics, Features
    from taichi_ldem.solver.stability import critical_time_step

    bound = 2 / waves.bulk(_material(), SPACING).highest_frequency
    bars = mat.bar_families(_material(), SPACING)
    dynamics = Dynamics(Lattice(prism(16, 16, 16), SPACING), bars, RHO, Features())
    free = critical_time_step(dynamics)
    inverse = dynamics.inverse_mass.to_numpy()
    inverse[:255] = 0.0  # all sites but the inner ones
    dynamics.inverse_mass.from_numpy(inverse)
    boxed = critical_time_step(dynamics)
    # waves that vanish on the box differ from the highest by (pi / 16)^2 / 2 or so: 2 %
    assert 1.0 < boxed / bound < 1.02
    assert 0.85 < free / bound < 1.0


# -- bars with free sides --------------------------------------------------------------------------


def _guide(mask: np.ndarray, axis: int, nu: float = 0.25) -> waves.Waveguide:
    return waves.waveguide(_material(nu), Lattice(mask, SPACING), axis)


def _check_bar(body: Body, guide: waves.Waveguide, stiffness: np.ndarray) -> None:
    """K u = omega^2 M u in the middle of a piece of a bar, for every fifth mode."""
    axis, k = guide.axis, 1.3 / SPACING
    squares, vectors = np.linalg.eigh(guide.matrix(k))
    along = body.places[:, axis]
    middle = (along == 6) | (along == 7)
    # the period's nodes as places: index (s, a, b) with a, b in the order z, y, x
    s, a, b = np.nonzero(guide.nodes)
    across = [n for n in (2, 1, 0) if n != axis]
    number = {
        (int(i), *(int(2 * (n - 1) + i) for n in place)): row
        for row, (i, *place) in enumerate(zip(s, a, b, strict=True))
    }
    rows = np.array([number[(p[0] % 2, p[across[0]], p[across[1]])] for p in body.places.tolist()])
    mass = MODULE_MASS * body.mass_shares[middle][:, None]
    for n in range(0, len(squares), 5):
        shape = vectors[:, n].reshape(-1, 3) / np.sqrt(guide.mass)[:, None]
        field = np.exp(1j * k * body.positions[:, axis])[:, None] * shape[rows]
        force = (stiffness @ field.ravel()).reshape(-1, 3)[middle]
        scale = squares[-1] * np.abs(mass * field[middle]).max()
        np.testing.assert_allclose(force, squares[n] * mass * field[middle], atol=1e-12 * scale)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_bar_s_waves_are_those_of_the_bar_put_together_bar_by_bar(axis: int) -> None:
    """Of 2 x 3 modules, from Section 2 alone."""
    sides = [2, 3]
    sides.insert(axis, 7)
    body = Body(prism(*sides), SPACING)
    guide = _guide(prism(*sides), axis)
    _check_bar(body, guide, body.stiffness_matrix(_stiffness()))


def test_long_waves_of_a_bar_follow_rayleigh_and_love() -> None:
    """c = c0 (1 - nu^2 k^2 r^2 / 2) with r^2 = a^2 / 6 for a square of side a."""
    guide = _guide(prism(6, 6, 6), 2)
    side = 6 * SPACING
    k = 2 * np.pi / (side * np.array([400.0, 40.0]))
    omega, _ = guide.longitudinal(k)
    still, slow = omega / k
    assert 1 - slow / still == pytest.approx(0.25**2 * k[1] ** 2 * side**2 / 12, rel=0.1)
    # six modules across with free sides: E is 1.5 % low, so the speed is 0.7 % low
    assert 0.99 < still / np.sqrt(PMMA["youngs_modulus"] / RHO) < 1.0


def _pochhammer(k: float, radius: float) -> float:
    """Phase speed of the first longitudinal mode of a round bar, Pochhammer (1876), nu = 0.25."""
    c_p, c_s = np.sqrt(np.array([1.2, 0.4]) * PMMA["youngs_modulus"] / RHO)

    def equation(speed: float) -> float:
        w = k * speed
        p = np.emath.sqrt(w**2 / c_p**2 - k**2)
        q = np.emath.sqrt(w**2 / c_s**2 - k**2)
        first = 2 * p / radius * (q**2 + k**2) * jv(1, p * radius) * jv(1, q * radius)
        second = (q**2 - k**2) ** 2 * jv(0, p * radius) * jv(1, q * radius)
        third = 4 * k**2 * p * q * jv(1, p * radius) * jv(0, q * radius)
        return float(((first - second - third) / q).real)

    bar = np.sqrt(PMMA["youngs_modulus"] / RHO)
    return float(brentq(equation, 1.02 * c_s, 1.01 * bar))


def test_a_round_bar_disperses_as_pochhammer_and_chree_say() -> None:
    guide = _guide(disc(10, 10, 6, 10), 2)
    radius = np.sqrt(np.count_nonzero(disc(10, 10, 1, 10)) / np.pi) * SPACING
    diameters = np.array([200.0, 8.0, 4.0, 3.0])
    k = 2 * np.pi / (2 * radius * diameters)
    speeds = guide.longitudinal(k)[0] / k
    exact = [_pochhammer(one, radius) for one in k]
    # the long-wave speed lacks what the free sides take from E; the fall from it is the theory's
    assert 0.98 < speeds[0] / exact[0] < 1.0
    np.testing.assert_allclose(speeds[1:] / speeds[0], np.array(exact[1:]) / exact[0], rtol=5e-3)
