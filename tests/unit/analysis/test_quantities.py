"""Names, units and digits of the numbers that pages and tables show."""

import pytest

from taichi_ldem.analysis.cracks import NO_CRACKS
from taichi_ldem.analysis.quantities import NUMBERS, at_end, named, three_digits, unit_of
from taichi_ldem.scenarios.registry import SCENARIOS

IMPACT = SCENARIOS["impact"].numbers


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (365.2908, "365"),
        (0.009996, "0.0100"),
        (9.996, "10.0"),
        (1234.5, "1,230"),
        (-0.13377, "-0.134"),
        (9.9e-8, "9.90e-08"),
        (float("nan"), "none"),
    ],
)
def test_three_digits(value, shown):
    assert three_digits(value) == shown


def test_numbers_have_their_units():
    assert named("failure_time_s").with_unit(1.79e-3) == "1.79 ms"
    assert named("failure_time_s").with_unit(None) == "none"
    assert named("loading_rate_pa_s").with_unit(1.52e11) == "152 GPa/s"
    assert named("strain_rate_1_s").title == "strain rate [1/s]"
    assert named("radial_cracks").shown(4) == named("radial_cracks").shown(4.0) == "4"
    assert named("radial_cracks").shown(4.5) == "4.50"
    assert named("broken_bars").shown(1234567) == "1,234,567"
    assert named("radial_centre_m").with_unit([0.0, -1.8e-4]) == "0, -0.180 mm"
    assert named("radial_centre_m").with_unit([7.8e-10, 2.5e-4]) == "0, 0.250 mm"
    assert named("striker.velocity").title == "striker.velocity [m/s]"
    assert named("something_else_m").with_unit(0.00123) == "0.00123 m"
    assert named("striker2_displacement_x_m").with_unit(1.1e-3) == "1.10 mm"
    assert named("tip_displacement_z_m").title == "tip displacement z [mm]"
    assert named("wave_speed_m_s").title == "wave speed [m/s]"


def test_all_numbers_of_an_impact_have_names():
    assert set(IMPACT) | set(NO_CRACKS) <= set(NUMBERS)
    labels = [NUMBERS[key].label for key in IMPACT]
    assert len(set(labels)) == len(labels)


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("striker.mass", "kg"),
        ("striker.position", "m"),
        ("plate.size", "m"),
        ("plate.angle", "degrees"),
        ("material.youngs_modulus", "Pa"),
        ("material.failure_factor", "m^-1/2"),
        ("output.checkpoint_interval", "s"),
        ("solver.time_step", "s"),
        ("clamp.kind", ""),
        ("material.poisson_ratio", ""),
        ("scenario", ""),
    ],
)
def test_units_of_a_scenes_keys(key, unit):
    assert unit_of(key) == unit


def test_radial_cracks_without_failure_were_measured_at_the_end():
    assert at_end({"radial_cracks": 3, "failure_time_energy_s": None})
    assert not at_end({"radial_cracks": 3, "failure_time_energy_s": 1e-3})
    assert not at_end({"radial_cracks": 0, "radial_diameter_m": None})
