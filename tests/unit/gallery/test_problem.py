"""Findings of the gallery, and the scenes of its runs."""

import math

import pytest

from taichi_ldem.gallery.problem import Run, between, near


def test_a_number_holds_within_its_interval() -> None:
    assert near("w", "um", 30.5, 30.0, 0.05).holds
    assert near("w", "um", 28.5, 30.0, 0.05).holds
    assert not near("w", "um", 31.6, 30.0, 0.05).holds
    assert near("w", "um", -30.0, -30.0, 0.05).holds
    assert not between("n", "", None, 0.0, 1.0).holds


@pytest.mark.parametrize(
    ("computed", "text"),
    [
        (33.0, "+10.0 % of the middle"),
        (40.0, "+14.3 % beyond its end"),
        (20.0, "-20.0 % beyond its end"),
        (None, "no result"),
    ],
)
def test_a_difference_counts_from_the_interval(computed: float | None, text: str) -> None:
    assert between("n", "", computed, 25.0, 35.0).difference == text


def test_references_read_like_their_source() -> None:
    assert near("f", "Hz", 1.0, 2875.25, 0.03).reference == "2875 ± 3 %"
    assert between("n", "", 1.0, 3, 5).reference == "3 to 5"
    assert between("n", "", 1.0, 2.0, math.inf).reference == "above 2"
    assert between("n", "", 1.0, -math.inf, 2.0).reference == "below 2"


def test_a_run_is_its_file_with_settings() -> None:
    run = Run("r", "strip.toml", ("grips.velocity=0.5",), ("plate.modules_through_thickness=2",))
    whole, quick = run.resolved(quick=False), run.resolved(quick=True, threads=1)
    assert whole.grips is not None
    assert whole.grips.velocity == 0.5
    assert whole.plate.modules_through_thickness == 3
    assert quick.plate.modules_through_thickness == 2
    assert quick.solver.threads == 1
