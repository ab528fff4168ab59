"""A crack by the rule of crack tips, in a static solver that shares no code with the step."""

import pytest

from studies.quasi_static_strip import Rule, cost

SLOW = [pytest.param(angle, marks=pytest.mark.slow) for angle in (0.0, 22.5)]


@pytest.mark.parametrize("angle", [45.0, *SLOW])
def test_a_crack_costs_g_f_within_a_sixth(angle: float) -> None:
    """Virtual crack closure (Rybicki and Kanninen 1977) finds G on a mesh of any size."""
    assert cost(angle, Rule()) == pytest.approx(1.0, abs=1 / 6)
