"""Stress of modules from the forces of bars, against Hooke's law and equilibrium."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from support.blocks import PMMA
from support.reference import Body

from taichi_ldem.analysis.strain import green_strain, mean_gradient, module_volumes, swelling
from taichi_ldem.analysis.stress import (
    ModuleSums,
    as_components,
    as_matrices,
    largest_principal,
    volumetric_stress,
)
from taichi_ldem.model import material as mat
from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scene import Material
from taichi_ldem.storage.fields import hexahedral_mesh

EDGE, MODULUS = 0.5e-3, PMMA["youngs_modulus"]
SHEAR = MODULUS / 2.5
TINY = 1e-13
"""So small that squares of strains do not show."""


class Strained:
    """A body whose nodes are displaced, with its bars evaluated one number at a time."""

    def __init__(self, lattice: Lattice, displacement: np.ndarray, kept: np.ndarray | float = 1.0):
        self.lattice, self.displacement = lattice, displacement
        cell = lattice.cell
        stiffness = "eq2" if cell.name == "module" else "volumetric"
        self.bars = mat.bar_families(Material(**PMMA), EDGE, stiffness, lattice=cell.name)
        self.kept = np.broadcast_to(kept, (*lattice.sites, cell.bars))
        _, cells, sites = hexahedral_mesh(lattice.mask, EDGE, lattice.origin)
        at = tuple((sites + 1).T)
        self.points, self.cells = lattice.positions()[0][at], cells
        self.gradient = mean_gradient(self.points, cells, displacement[0][at])
        self.sums = ModuleSums(lattice, displacement, self._layers())
        self.volume = module_volumes(self.points, cells)
        self.stress = self.sums.stress(self.volume, swelling(self.gradient))

    def _layers(self) -> Iterator[tuple[int, np.ndarray]]:
        cell, place = self.lattice.cell, self.lattice.positions()
        nz, ny, nx = self.lattice.sites
        shares = self.lattice.bar_shares()
        for k in range(1, nz - 1):
            values = np.zeros((3, cell.bars, ny, nx))
            for bar, ((first, a), (second, b)) in enumerate(cell.ends):
                family = self.bars[cell.family[bar]]
                for j, i in np.argwhere(shares[k, ..., bar] > 0):
                    one, two = (k + a[0], j + a[1], i + a[2]), (k + b[0], j + b[1], i + b[2])
                    rest = place[second][two] - place[first][one]
                    moved = self.displacement[second][two] - self.displacement[first][one]
                    square = (2 * rest + moved) @ moved / (rest @ rest)
                    strain = square / (1 + np.sqrt(1 + square))
                    length = np.linalg.norm(rest)
                    whole = shares[k, j, i, bar] * family.axial_stiffness / length
                    kept = self.kept[k, j, i, bar]
                    pull = kept * whole * strain / (1 + strain)
                    values[:, bar, j, i] = pull, whole, kept * whole
            yield k, values


def _uniform(lattice: Lattice, gradient: np.ndarray) -> np.ndarray:
    return np.asarray((lattice.positions() @ gradient.T) * lattice.exists()[..., None])


def _hooke(gradient: np.ndarray) -> np.ndarray:
    """Six components of the stress of an isotropic solid with nu = 1/4: lambda = mu."""
    strain = (gradient + gradient.T) / 2
    stress = SHEAR * (np.trace(strain) * np.eye(3) + 2 * strain)
    return as_components(stress[None])[0]


GRADIENTS = {
    "stretch": np.diag([TINY, 0.0, 0.0]),
    "shear": np.array([[0.0, TINY, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    "general": TINY * np.random.default_rng(6).normal(size=(3, 3)),
}


@pytest.mark.parametrize("kind", GRADIENTS)
@pytest.mark.parametrize("lattice", CELLS)
def test_a_uniform_strain_gives_hookes_stress(lattice: str, kind: str) -> None:
    """In the lattice of the paper, bars between centres end at the modules of the surface."""
    body = Lattice(prism(3, 3, 3), EDGE, cell=CELLS[lattice])
    stress = Strained(body, _uniform(body, GRADIENTS[kind])).stress
    if lattice == "module":
        stress = stress[[13]]  # the only one that is not at the surface
    wanted = np.tile(_hooke(GRADIENTS[kind]), (len(stress), 1))
    np.testing.assert_allclose(stress, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


def _rotation() -> np.ndarray:
    turned, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    return np.asarray(turned * np.sign(np.linalg.det(turned)))


@pytest.mark.parametrize("perturbation", [0.0, 0.1])
@pytest.mark.parametrize("lattice", CELLS)
def test_a_rigid_rotation_has_neither_stress_nor_strain(lattice: str, perturbation: float) -> None:
    body = Lattice(prism(3, 2, 2), EDGE, perturbation=perturbation, cell=CELLS[lattice])
    turned = Strained(body, _uniform(body, _rotation() - np.eye(3)))
    assert np.abs(turned.stress).max() < 1e-12 * MODULUS
    assert np.abs(green_strain(turned.gradient)).max() < 1e-12
    assert np.abs(volumetric_stress(MODULUS, swelling(turned.gradient))).max() < 1e-12 * MODULUS


@pytest.mark.parametrize("lattice", CELLS)
def test_stress_turns_with_a_body_that_is_stretched_and_rotated(lattice: str) -> None:
    """Cauchy's stress refers to the axes of space, Green's strain to those at rest."""
    body = Lattice(prism(3, 3, 3), EDGE, cell=CELLS[lattice])
    stretch, turn = np.diag([1e-3, -4e-4, 2e-4]), _rotation()
    middle = slice(13, 14) if lattice == "module" else slice(None)
    before = Strained(body, _uniform(body, stretch))
    after = Strained(body, _uniform(body, turn @ (np.eye(3) + stretch) - np.eye(3)))
    wanted = turn @ as_matrices(before.stress[middle]) @ turn.T
    found = as_matrices(after.stress[middle])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())
    np.testing.assert_allclose(
        largest_principal(after.stress[middle]), largest_principal(before.stress[middle]), rtol=1e-9
    )
    green = green_strain(after.gradient)
    np.testing.assert_allclose(green, green_strain(before.gradient), rtol=0, atol=1e-14)


@pytest.mark.parametrize("lattice", CELLS)
def test_the_modules_stress_power_is_the_power_of_all_bars(lattice: str) -> None:
    """J V sigma : D, added up over the modules, is how fast the bars' energy grows."""
    body = Lattice(prism(3, 2, 2), EDGE, cell=CELLS[lattice])
    reference = Body(body.mask, EDGE, lattice=lattice)
    rate = np.random.default_rng(8).normal(size=(3, 3))
    gradient = 1e-3 * np.random.default_rng(9).normal(size=(3, 3))
    now = Strained(body, _uniform(body, gradient))
    stiffness = tuple(family.axial_stiffness for family in now.bars)
    step = 1e-6
    more, less = (
        reference.strain_energy(reference.positions @ (gradient + s * step * rate).T, stiffness)
        for s in (1, -1)
    )
    flow = rate @ np.linalg.inv(np.eye(3) + gradient)
    grown = now.volume * (1 + swelling(now.gradient))
    power = np.einsum("c,cij,ij->", grown, as_matrices(now.stress), flow)
    assert power == pytest.approx((more - less) / (2 * step), rel=1e-6)


@pytest.mark.parametrize("lattice", CELLS)
def test_mean_stress_of_a_pulled_bar_is_force_over_area(lattice: str) -> None:
    """A block of 6 x 3 x 2 modules in equilibrium, pulled at the nodes of its end faces."""
    body = Lattice(prism(6, 3, 2), EDGE, cell=CELLS[lattice])
    reference = Body(body.mask, EDGE, lattice=lattice)
    stiffness = tuple(
        family.axial_stiffness for family in Strained(body, 0 * body.positions()).bars
    )
    x = reference.positions[:, 0]
    load = np.zeros((len(x), 3))
    for side in (-1, 1):
        end = np.isclose(x, side * 3 * EDGE)
        load[end, 0] = side * reference.mass_shares[end]
    load *= 1e-6 / load[x > 0].sum()
    matrix = reference.stiffness_matrix(stiffness)
    low, far = 0, int(np.argmax(x))  # six rigid motions are held, which takes no force
    held = [3 * low, 3 * low + 1, 3 * low + 2, 3 * far + 1, 3 * far + 2]
    held.append(3 * int(np.argmax(reference.positions @ [0, 1, 1e-3])) + 2)
    free = np.setdiff1d(np.arange(load.size), held)
    moved = np.zeros(load.size)
    moved[free] = spsolve(matrix.tocsc()[free][:, free], load.ravel()[free])
    found = Strained(body, reference.spread(moved.reshape(-1, 3)))
    mean = np.average(found.stress, axis=0, weights=found.volume)
    wanted = np.array([1e-6 / (6 * EDGE**2), 0, 0, 0, 0, 0])
    np.testing.assert_allclose(mean, wanted, rtol=0, atol=1e-6 * wanted[0])


@pytest.mark.parametrize("lattice", CELLS)
def test_softened_bars_carry_less_and_failed_ones_nothing(lattice: str) -> None:
    body = Lattice(prism(3, 3, 3), EDGE, cell=CELLS[lattice])
    moved = _uniform(body, GRADIENTS["general"])
    whole, half, gone = (Strained(body, moved, kept) for kept in (1.0, 0.5, 0.0))
    np.testing.assert_allclose(half.stress, whole.stress / 2, rtol=1e-12)
    assert (gone.stress == 0).all()
    for strained, damage in ((whole, 0.0), (half, 0.5), (gone, 1.0)):
        np.testing.assert_allclose(strained.sums.damage, damage, atol=1e-15)
    assert (whole.sums.failed == 0).all()
    assert (gone.sums.failed > 0).all()


def test_the_volumetric_part_is_a_pressure() -> None:
    """dW/dJ of 1/2 (lambda - mu) (J - 1)^2."""
    np.testing.assert_allclose(volumetric_stress(4.0, np.array([0.25])), [[1, 1, 1, 0, 0, 0]])
