"""The frequency of a free bar, against a slender beam's."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from taichi_ldem.gallery.problems.free_beam import PROBLEM, frequency


@pytest.mark.parametrize(("height", "tolerance"), [(0.0012, 1e-3), (0.006, 0.02)])
def test_the_frequency_tends_to_that_of_a_slender_beam(height: float, tolerance: float) -> None:
    scene = PROBLEM.runs[0].resolved(quick=False)
    plate = SimpleNamespace(actual_size=(0.120, 0.006, height))
    run: Any = SimpleNamespace(scene=SimpleNamespace(plate=plate, material=scene.material))
    # (4.73004)^2 / (2 pi L^2) sqrt(E I / (rho A)): Blevins, Formulas for natural frequency (1979)
    slender = 4.73004**2 / (2 * math.pi * 0.120**2) * math.sqrt(3.35e9 / 1190.0 / 12) * height
    assert frequency(run) == pytest.approx(slender, rel=tolerance)
    assert frequency(run) < slender
