from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, Breakable, block_scene, smooth_velocity
from support.reference import Body

from taichi_ldem.errors import SceneError
from taichi_ldem.model import material as mat

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

MODULE_MASS = PMMA["density"] * SPACING**3


def _stiffness(nu: float = 0.25) -> tuple[float, float]:
    return mat.axial_stiffness(PMMA["youngs_modulus"], nu, SPACING)


def _highest_bulk_frequency(nu: float) -> float:
    """Largest omega of the infinite lattice: Bloch waves of its two nodes, over the first zone."""
    longitudinal, diagonal = _stiffness(nu)
    edge, slant = longitudinal / SPACING, diagonal / (SPACING * np.sqrt(3) / 2)
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), -1).reshape(-1, 3)
    unit = corners / np.sqrt(0.75)
    highest = 0.0
    for phase in np.stack(np.meshgrid(*[np.linspace(0, np.pi, 13)] * 3), -1).reshape(-1, 3):
        matrix = np.zeros((6, 6), dtype=complex)
        own = np.diag(2 * edge * (1 - np.cos(phase))) + slant * unit.T @ unit
        cross = -slant * (np.exp(1j * corners @ phase)[:, None] * unit).T @ unit
        matrix[:3, :3] = matrix[3:, 3:] = own
        matrix[:3, 3:], matrix[3:, :3] = cross, cross.conj().T
        highest = max(highest, np.linalg.eigvalsh(matrix)[-1])
    return float(np.sqrt(highest / (0.5 * MODULE_MASS)))  # both nodes carry half a module


def _highest_frequency(body: Body) -> float:
    """Largest omega of a finite body, from its matrices."""
    from scipy import sparse
    from scipy.sparse.linalg import eigsh

    root = sparse.diags(1 / np.sqrt(np.repeat(MODULE_MASS * body.mass_shares, 3)))
    matrix = root @ body.stiffness_matrix(_stiffness()) @ root
    return float(np.sqrt(eigsh(matrix, k=1, which="LA", return_eigenvectors=False)[0]))


def test_the_critical_time_step_is_that_of_the_assembled_body(
    elastic: "Simulation", body: Body
) -> None:
    exact = 2 / _highest_frequency(body)
    assert elastic.critical_time_step == pytest.approx(exact, rel=1e-3)
    # the light corners of a body ring faster than its bulk, by a seventh for nu = 0.25
    assert 0.85 < elastic.critical_time_step * _highest_bulk_frequency(0.25) / 2 < 1


@pytest.mark.parametrize(("share", "stable"), [(0.99, True), (1.05, False)])
def test_stable_below_the_critical_step_and_not_above(
    elastic: "Simulation", body: Body, share: float, stable: bool
) -> None:
    elastic.time_step = share * elastic.critical_time_step
    noise = np.random.default_rng(5).normal(0.0, 1e-3, (len(body.places), 3))
    velocity = smooth_velocity(body.places, 1.0) + noise
    elastic.start_from(np.zeros((2, *elastic.dynamics.sites, 3)), body.spread(velocity))
    start = elastic.sample_step().ledger
    elastic.advance(1000)
    ledger = elastic.sample_step().ledger
    if stable:
        assert ledger.error(start) < 0.01
    else:
        assert not ledger.error(start) < 1.0  # or not a number


def test_too_large_a_time_step_is_refused_with_the_critical_one(
    elastic: "Simulation", taichi: None
) -> None:
    from taichi_ldem.solver.simulation import Simulation

    chosen = 1.05 * elastic.critical_time_step
    with pytest.raises(SceneError, match=r"solver\.time_step = .*critical") as refusal:
        Simulation(block_scene(4, 3, 2, solver={"time_step": chosen}))
    assert "\n" not in str(refusal.value)


def _tangent_frequency(body: Body, displacement: np.ndarray) -> float:
    """Largest omega of the body about a deformed state: axial and geometric stiffness."""
    from scipy import sparse
    from scipy.sparse.linalg import eigsh

    now = body.rest + displacement[body.ends[:, 1]] - displacement[body.ends[:, 0]]
    length = np.linalg.norm(now, axis=1)
    unit, k = now / length[:, None], body.weights * body.per_bar(*_stiffness()) / body.lengths
    along = unit[:, :, None] * unit[:, None, :]
    across = (1 - body.lengths / length)[:, None, None] * (np.eye(3) - along)
    block = k[:, None, None] * (along + across)
    matrix = sparse.lil_matrix((3 * len(body.places),) * 2)
    for (a, b), part in zip(body.ends.tolist(), block, strict=True):
        one, two = slice(3 * a, 3 * a + 3), slice(3 * b, 3 * b + 3)
        matrix[one, one] += part
        matrix[two, two] += part
        matrix[one, two] -= part
        matrix[two, one] -= part
    root = sparse.diags(1 / np.sqrt(np.repeat(MODULE_MASS * body.mass_shares, 3)))
    whole = (root @ matrix.tocsr() @ root).tocsr()
    return float(np.sqrt(eigsh(whole, k=1, which="LA", return_eigenvectors=False)[0]))


@pytest.mark.parametrize("kind", ["swollen", "random"])
def test_no_deformation_needs_less_than_the_stretched_share(kind: str) -> None:
    from taichi_ldem.model.lattice import prism
    from taichi_ldem.solver.stability import STRETCHED

    block = Body(prism(4, 3, 2), SPACING)
    rest = _tangent_frequency(block, np.zeros(block.places.shape))
    if kind == "swollen":
        # far out every bar resists in all directions alike, which is as bad as it gets
        worst = _tangent_frequency(block, 50 * block.positions)
        assert worst > rest
    else:
        noise = np.random.default_rng(3).normal(0.0, SPACING, block.places.shape)
        worst = _tangent_frequency(block, noise)
    assert worst / rest < 1 / STRETCHED


@pytest.mark.parametrize("breakable", ["bilinear"], indirect=True)
def test_weak_bars_are_not_damaged_by_the_estimate(breakable: Breakable) -> None:
    from taichi_ldem.solver.stability import critical_time_step

    whole = critical_time_step(breakable.renew().dynamics)
    weak = breakable.renew(failure_strain=1e-8, limit_strain=1e-7).dynamics
    assert critical_time_step(weak) == pytest.approx(whole, rel=2e-3)
    assert not weak.touched.to_numpy().any()


def test_the_largest_strains_are_those_of_the_bars(elastic: "Simulation", body: Body) -> None:
    from taichi_ldem.solver.stability import largest_strains

    displaced = np.random.default_rng(4).normal(0.0, 0.3 * SPACING, (len(body.places), 3))
    strains = body.strains(displaced)
    found = largest_strains(elastic.dynamics, body.spread(displaced))
    assert found == pytest.approx((strains.max(), strains.min()), rel=1e-12)
    displaced[0] = np.nan
    assert np.isnan(largest_strains(elastic.dynamics, body.spread(displaced))).any()


def test_broken_bars_have_no_strain(breakable: Breakable) -> None:
    from taichi_ldem.solver.stability import largest_strains

    block = breakable.renew()
    displaced = 0.01 * block.body.positions  # below eps_p
    displaced[-1] += 3 * block.spacing  # all bars of the last node break
    block.put(displaced)
    longest, _ = largest_strains(block.dynamics, block.body.spread(displaced))
    assert longest == pytest.approx(0.01, rel=1e-9)
