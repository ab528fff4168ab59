"""The tangent operator and its lowest modes against matrices assembled bar by bar."""

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.solver.eigen import (
    TangentOperator,
    TwoGrid,
    each,
    low_frequency,
    lowest,
    stiffness,
)

STIFFNESS = mat.axial_stiffness(PMMA["youngs_modulus"], 0.25, SPACING)
MODULE_MASS = PMMA["density"] * SPACING**3


class Case:
    """A body with a hole, a step and a few fixed nodes, both ways."""

    def __init__(self) -> None:
        from taichi_ldem.solver.dynamics import Dynamics, Features

        mask = prism(9, 5, 4)
        mask[2:, :, 7:] = False
        mask[1, 2, 3] = False
        bars = mat.bar_families(block_scene(1, 1, 1).material, SPACING)
        self.dynamics = Dynamics(Lattice(mask, SPACING), bars, PMMA["density"], Features())
        self.body = Body(mask, SPACING)
        self.number = np.ravel_multi_index(self.body.index, (2, *self.dynamics.sites))
        held = self.body.places[:, 0] == 0
        self.operator = TangentOperator(self.dynamics, self.number[held])
        # of the body's nodes, those that are free, in the operator's order
        self.free = np.flatnonzero(~held)[np.argsort(self.number[~held])]
        self.freedoms = (3 * self.free[:, None] + np.arange(3)).ravel()

    def scaled(self) -> np.ndarray:
        """M^(-1/2) K M^(-1/2) over the free nodes, dense."""
        matrix = self.body.stiffness_matrix(STIFFNESS)[self.freedoms][:, self.freedoms].toarray()
        root = np.sqrt(np.repeat(MODULE_MASS * self.body.mass_shares[self.free], 3))
        return matrix / root[:, None] / root


@pytest.fixture(scope="module")
def case(taichi: None) -> Case:
    return Case()


def test_the_kernels_apply_the_assembled_stiffness(case: Case) -> None:
    vector = np.random.default_rng(1).standard_normal(case.operator.size)
    wanted = case.scaled() @ vector
    # linear to rounding although the kernels are not: 1e-12 is their amplitude
    assert np.abs(case.operator(vector) - wanted).max() < 1e-11 * np.abs(wanted).max()


def test_the_coarse_grid_s_stiffness_is_the_assembled_one(case: Case) -> None:
    assembled = stiffness(case.dynamics)
    wanted = case.body.stiffness_matrix(STIFFNESS)
    freedoms = (3 * case.number[:, None] + np.arange(3)).ravel()
    difference = assembled[freedoms][:, freedoms] - wanted
    assert abs(difference).max() < 1e-12 * abs(wanted).max()
    assert assembled.nnz == pytest.approx(wanted.nnz, rel=0.6)  # nothing outside the body


def test_the_preconditioner_is_symmetric_and_positive(case: Case) -> None:
    inverse = TwoGrid(case.operator, low_frequency(case.operator))
    vectors = np.random.default_rng(2).standard_normal((case.operator.size, 5))
    image = inverse(vectors)
    gram = vectors.T @ image
    assert np.abs(gram - gram.T).max() < 1e-9 * np.abs(gram).max()
    assert np.linalg.eigvalsh(gram).min() > 0
    # and near the inverse: what is left of a smooth vector after one application
    smooth = inverse.start(3)
    left = smooth - inverse(each(inverse.shifted, smooth))
    assert np.linalg.norm(left) < 0.5 * np.linalg.norm(smooth)


def test_lowest_modes_are_those_of_the_dense_matrix(case: Case) -> None:
    values, vectors = np.linalg.eigh(case.scaled())
    modes = lowest(case.operator, 4)
    exact = np.sqrt(values[:4]) / (2 * np.pi)
    assert modes.frequencies == pytest.approx(exact, rel=1e-6)
    assert modes.residuals.max() < 1e-4  # eigen.TOLERANCE
    shape = modes.shapes[0].reshape(-1, 3)[case.operator.nodes]
    scaled = (shape * case.operator.root_mass[:, None]).ravel()
    overlap = scaled @ vectors[:, 0] / np.linalg.norm(scaled)
    assert abs(overlap) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(modes.shapes).max(axis=(1, 2, 3, 4, 5)) == pytest.approx(np.ones(4))


def test_more_modes_than_the_lattice_has_are_refused(case: Case) -> None:
    with pytest.raises(ValueError, match="at most"):
        lowest(case.operator, case.operator.size)
