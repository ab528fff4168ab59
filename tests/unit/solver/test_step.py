"""The drivers of the step: strips of rows and whole passes give the same result."""

import numpy as np
import pytest
from support.blocks import DAMAGE, PMMA, SPACING, random_displacement
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scene import Material


@pytest.mark.parametrize(
    ("law", "crack", "volumetric"),
    [
        pytest.param(None, False, False, marks=pytest.mark.slow),
        ("bilinear", False, False),
        pytest.param("bilinear", True, False, marks=pytest.mark.slow),
        pytest.param("bilinear", True, True, marks=pytest.mark.slow),
    ],
)
def test_all_drivers_take_the_same_step(
    taichi: None, law: str | None, crack: bool, volumetric: bool
) -> None:
    """Strips of all threads, one thread alone, and whole passes, a site to a lane, as on a GPU."""
    from taichi_ldem.solver.dynamics import Dynamics, Features

    mask = prism(9, 10, 2)
    mask[0, 3:5, 2:6] = False
    body = Body(mask, SPACING)
    bars = mat.bar_families(Material(**PMMA | DAMAGE), SPACING)
    start = random_displacement(body, 0.01 * SPACING)
    ends = []
    for in_strips, alone in ((True, False), (True, True), (False, False)):
        features = Features(law=law, crack=crack, volumetric=volumetric)
        dynamics = Dynamics(Lattice(mask, SPACING), bars, 1190.0, features, in_strips, alone)
        assert (dynamics.lanes.width > 1) == in_strips
        dynamics.volumetric, dynamics.poisson_ratio = 1.5e9 * volumetric, 0.36  # Pa, order of E
        dynamics.set_displacement(0, body.spread(start))
        for step in range(30):
            dynamics.step(step % 2, 9e-8, 9e-8, 0.0, step == 29)
        moved = np.zeros((2, *dynamics.sites, 3))
        dynamics.get_displacement(0, moved)
        ends.append((moved, dynamics.get_velocity(), dynamics.node_sums.to_numpy().sum(axis=0)[0]))
        if law is not None:
            sites, broken = dynamics.new_broken()
            ends[-1] += (sites, broken)
            assert len(broken) > 0
    for other in ends[1:]:
        for number in (0, 1, 3, 4)[: len(other) - 1]:
            np.testing.assert_array_equal(ends[0][number], other[number])
    assert ends[0][2] == ends[1][2]
    assert ends[0][2] == pytest.approx(ends[2][2], rel=1e-13)  # summed in another order
