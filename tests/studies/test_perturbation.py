"""The elastic constants of a perturbed lattice."""

from typing import TYPE_CHECKING

import numpy as np

from studies.perturbation import constants
from taichi_ldem.model import material as mat

if TYPE_CHECKING:
    pass


def test_elastic_constants_move_with_the_square_of_the_perturbation() -> None:
    whole = np.array(constants(4, 0.0, 0))
    expected = np.array(mat.elastic_constants(1.0, 0.25))
    np.testing.assert_allclose(whole, expected, rtol=1e-11)
    change = {
        p: np.mean([constants(4, p, s) for s in range(4)], 0) / whole - 1 for p in (0.05, 0.1)
    }
    assert np.abs(change[0.05]).max() < 0.01
    np.testing.assert_allclose(change[0.1] / change[0.05], 4.0, rtol=0.15)
