"""Table 3 of the paper for the members of an ensemble."""

from taichi_ldem.ensemble.results import Row
from taichi_ldem.ensemble.table3 import markdown


def test_table_3_says_what_was_measured_without_a_failure(plan):
    numbers = {"radial_cracks": 5, "radial_diameter_m": 0.05, "failure_time_energy_s": None}
    times = [None, 7e-3, 7.1e-3]
    rows = [
        Row(member, numbers | {"failure_time_energy_s": at}, (), "finished")
        for member, at in zip([plan.members[0]] * 3, times, strict=True)
    ]
    first, mean = markdown(rows, papers=False).splitlines()[2:4]
    assert "| 5* 5 5 | 50.0* 50.0 50.0 |" in first
    assert mean.startswith("| mean | 5.0 ± 0.0 | 50.0 ± 0.0 |")
    assert mean.endswith("| 7.05 (two) | - | - |")
