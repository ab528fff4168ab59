"""What the scenario of modes looks at, without solving anything."""

from types import SimpleNamespace

import numpy as np
import pytest

from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scenarios.modes import mid_plane


@pytest.mark.parametrize("modules", [2, 3])
@pytest.mark.parametrize("name", CELLS)
def test_the_plane_nearest_to_half_height_has_nodes(name: str, modules: int) -> None:
    lattice = Lattice(prism(4, 5, modules), 1.0, cell=CELLS[name])
    dynamics = SimpleNamespace(lattice=lattice, cell=lattice.cell)
    shape = lattice.positions()  # each node's motion is its place
    x, y, motion = mid_plane(dynamics, shape)  # type: ignore[arg-type]
    height = motion[..., 2]
    assert np.ptp(height) == 0
    assert abs(height[0, 0] - modules / 2) <= (0.5 if name == "cubic-26" and modules == 3 else 0)
    np.testing.assert_array_equal(motion[..., 0], np.broadcast_to(x, motion.shape[:2]))
    np.testing.assert_array_equal(motion[..., 1].T, np.broadcast_to(y, motion.shape[1::-1]))
