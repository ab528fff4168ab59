"""The lattice with 26 neighbours: what solid it is, what a cut costs, and that a run agrees."""

import itertools
import math

import numpy as np
import pytest
from support.blocks import DAMAGE, PMMA, block_scene, random_displacement
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.cell import CUBIC_26
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.model.waves import bulk
from taichi_ldem.scene import Material

SPACING = 0.8e-3
BARS = mat.bar_families(Material(**PMMA | DAMAGE), SPACING, lattice="cubic-26")
STIFFNESS = tuple(family.axial_stiffness for family in BARS)


def _bulk_energy(strain: np.ndarray) -> float:
    """Energy per volume over E: the third difference of the energies of blocks of n^3 modules.

    The energy of a block is a cubic in n (bulk, faces, edges, corners).
    """
    energies = []
    for n in (1, 2, 3, 4):
        body = Body(prism(n, n, n), lattice="cubic-26")
        along = body.rest / body.lengths[:, None]
        bar = np.einsum("bi,ij,bj->b", along, strain, along)
        unit = tuple(ea / (PMMA["youngs_modulus"] * SPACING**2) for ea in STIFFNESS)
        energies.append(np.sum(0.5 * body.weights * body.per_bar(*unit) * body.lengths * bar**2))
    return float(np.diff(energies, 3)[0]) / 6


def test_it_is_the_isotropic_solid_of_one_quarter() -> None:
    """Hooke's law with nu = 1/4 and E = 1: C11 = 6/5, C12 = C44 = 2/5."""
    c11 = 2 * _bulk_energy(np.diag([1.0, 0.0, 0.0]))
    c12 = _bulk_energy(np.diag([1.0, 1.0, 0.0])) - c11
    c44 = 2 * _bulk_energy(np.array([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert (c11, c12, c44) == pytest.approx((1.2, 0.4, 0.4), abs=1e-13)


@pytest.mark.parametrize("normal", [(1, 0, 0), (1, 1, 0), (1, 1, 1)], ids=str)
def test_a_flat_cut_costs_g_f(normal: tuple[int, int, int]) -> None:
    """Bars of a vector X cross a plane of normal n |n.X| times per area L^2."""
    unit = np.array(normal) / np.linalg.norm(normal)
    vectors = np.array(list(itertools.product((-1, 0, 1), repeat=3)))
    kinds = np.abs(vectors).sum(axis=1)
    energy = 0.0
    for vector, kind in zip(vectors, kinds, strict=True):
        if kind and vector @ unit > 0:
            energy += (vector @ unit) * BARS[kind - 1].fracture_area / SPACING**2
    assert energy == pytest.approx(1.0, rel=1e-14)


def test_bars_of_all_families_dissipate_g_f_on_their_areas() -> None:
    for family in BARS:
        expected = DAMAGE["fracture_energy"] * family.fracture_area
        assert family.energy_to_break == pytest.approx(expected, rel=1e-12)
    # the free condition on the stiffnesses: both diagonals soften alike (scene.equations)
    assert BARS[1].ductility == pytest.approx(BARS[2].ductility, rel=1e-12)


def test_waves_of_all_directions_start_with_the_speeds_of_the_solid() -> None:
    material = Material(**PMMA)
    lattice = bulk(material, SPACING, lattice="cubic-26")
    modulus, density = PMMA["youngs_modulus"], PMMA["density"]
    slow, fast = math.sqrt(0.4 * modulus / density), math.sqrt(1.2 * modulus / density)
    for direction in ([1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 2, 5]):
        k = 1e-3 / SPACING * np.array(direction) / np.linalg.norm(direction)
        np.testing.assert_allclose(lattice.phase_velocities(k), (slow, slow, fast), rtol=1e-6)


@pytest.mark.parametrize("weighted", [True, False], ids=["weighted", "full"])
def test_bars_and_masses_of_a_ragged_body_are_those_of_its_modules(weighted: bool) -> None:
    mask = np.random.default_rng(3).random((3, 4, 5)) < 0.6
    lattice = Lattice(mask, SPACING, weighted, cell=CUBIC_26)
    body = Body(mask, SPACING, weighted, lattice="cubic-26")
    assert (lattice.bars, lattice.nodes) == (len(body.ends), len(body.places))
    assert lattice.bar_shares().sum() == body.weights.sum()
    shares = np.moveaxis(CUBIC_26.node_shares[lattice.code], -1, 0)
    np.testing.assert_array_equal(shares[body.index], body.mass_shares)


def test_forces_and_energy_are_those_of_a_list_of_bars(taichi: None) -> None:
    from taichi_ldem.solver.simulation import Simulation

    scene = block_scene(9, 5, 3, spacing=SPACING, plate={"lattice": "cubic-26"})
    simulation = Simulation(scene)
    body = Body(prism(9, 5, 3), SPACING, lattice="cubic-26")
    displacement = random_displacement(body, 0.05 * SPACING)
    field = body.spread(displacement)
    simulation.start_from(field, np.zeros_like(field))
    force = simulation.dynamics.get_force(simulation.now)[body.index]
    expected = body.forces(displacement, STIFFNESS)
    np.testing.assert_allclose(force, expected, atol=1e-12 * np.abs(expected).max())
    simulation.energies.potential(simulation.now)
    energy = simulation.energies.total()[0]
    assert energy == pytest.approx(body.strain_energy(displacement, STIFFNESS), rel=1e-12)
    # the longest stable step, from the spectrum of the list of bars
    from scipy.sparse.linalg import eigsh

    root = np.repeat(np.sqrt(body.mass_shares * PMMA["density"] * SPACING**3), 3)
    matrix = body.stiffness_matrix(STIFFNESS).multiply(1 / np.outer(root, root))
    largest = float(eigsh(matrix.tocsr(), 1, which="LA", return_eigenvectors=False)[0])
    assert simulation.critical_time_step == pytest.approx(2 / math.sqrt(largest), rel=1e-3)


@pytest.mark.parametrize(
    ("table", "key", "message"),
    [
        (
            {"material": {"poisson_ratio": 0.3}, "plate": {"stiffness": "equation-2"}},
            "material.poisson_ratio",
            "must be 0.25",
        ),
        ({"plate": {"stiffness": "as-printed"}}, "plate.stiffness", "is for"),
    ],
)
def test_other_materials_are_refused(table: dict, key: str, message: str) -> None:
    plate = {"lattice": "cubic-26"} | table.get("plate", {})
    material = PMMA | table.get("material", {})
    with pytest.raises(ValueError, match=f"{key} .*{message}"):
        block_scene(4, 4, 2, plate=plate, material=material)


def test_memory_is_counted_with_the_lattice_s_own_bars() -> None:
    """Half the nodes, 13 bars a site instead of 14: less memory at equal modules."""
    from taichi_ldem.solver.memory import field_bytes

    module, cubic = (
        field_bytes(block_scene(20, 20, 4, plate={"lattice": name}, material=PMMA | DAMAGE))
        for name in ("module", "cubic-26")
    )
    # of a site: 14 peak strains, 18 displacements and velocities, or 13 and 9, of eight bytes; a
    # byte, two flags of damage
    assert cubic / module == pytest.approx((8 * (13 + 9) + 4) / (8 * (14 + 18) + 4), rel=0.01)
