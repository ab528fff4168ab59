"""A crack by the rule of crack tips, in a static solver that shares no code with the step."""

import pytest

from studies.quasi_static_strip import Rule, family_areas, grow

SLOW = [pytest.param(angle, marks=pytest.mark.slow) for angle in (0.0, 22.5)]


@pytest.mark.parametrize("angle", [45.0, *SLOW])
def test_a_crack_costs_g_f_within_a_sixth(angle: float) -> None:
    """Virtual crack closure (Rybicki and Kanninen 1977) finds G on a mesh of any size."""
    assert grow(angle, Rule()).cost == pytest.approx(1.0, abs=1 / 6)


@pytest.mark.slow
def test_a_crack_at_22_degrees_turns_onto_the_diagonal() -> None:
    """The plane (110) lies 22.5 degrees off (docs/tension.md)."""
    assert grow(22.5, Rule()).turned == pytest.approx(-22.5, abs=2)


def test_any_areas_of_the_families_cost_g_f_on_a_plane_100() -> None:
    """Such a plane cuts two longitudinal bars and four diagonals per L^2 (Eqs. (4) to (8))."""
    for longitudinal in (None, 0.11, 0.2071):
        along, across = family_areas(longitudinal)
        assert 2 * along + 4 * across == pytest.approx(1)
