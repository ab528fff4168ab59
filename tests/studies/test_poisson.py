"""The table over Poisson's ratio."""

import pytest

from studies.poisson import RATIOS, Row, bar_scene, line, measure, solid
from taichi_ldem.model import material as mat


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_solid_is_that_of_hooke_s_law(ratio: float) -> None:
    c11, c12, c44 = solid(ratio)
    assert c44 == pytest.approx((c11 - c12) / 2)
    assert c12 == pytest.approx(c11 * ratio / (1 - ratio))
    assert (c11, c12, c44) == pytest.approx(mat.elastic_constants(3.35e9, ratio, "volumetric"))


def test_a_line_has_all_numbers() -> None:
    row = Row((1.0, 0.0, 0.5), (1.0, 0.7), (1.5e-7, 1.4e-7), 0.98, 0.26)
    assert line(0.3, "equation-2", row) == (
        "| 0.3 | equation-2 | 1.000000 | 0.500000 | +0.0e+00 | 1.0000 | 0.7000 | 150.0 | 140.0 "
        "| 0.9800 | 0.2600 |"
    )


@pytest.mark.slow
def test_a_pulled_bar_has_the_solid_s_constants(taichi: None) -> None:
    """At eight modules a side the layer at the surface takes 1.5 % of E for nu = 1/4 and more."""
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(bar_scene(8, 24, 0.4, "volumetric"))
    row = measure(simulation, 8, 24, 0.4)
    assert row.modulus == pytest.approx(1.0, abs=0.03)
    assert row.ratio == pytest.approx(0.4, abs=0.003)
    assert row.steps[1] < row.steps[0]  # light nodes at the surface, where volumes weigh whole
