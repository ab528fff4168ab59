"""Where a bar spalls, against the closed form of a pulse that falls linearly."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from taichi_ldem.gallery.problems.spall import PROBLEM, theory


def test_a_pulse_that_falls_linearly_spalls_at_c_t_sigma_over_2_p() -> None:
    scene = PROBLEM.runs[0].resolved(quick=False)
    run: Any = SimpleNamespace(scene=scene)
    place, time = theory(run)
    speed = math.sqrt(3.35e9 / 1190.0)
    # p = 2 sigma and the pulse falls within 55 us: tension behind its peak is 2 p x / (c T)
    assert place == pytest.approx(speed * 55e-6 / 4, rel=2e-3)
    length = 0.150 - (0.075 - 0.0729)
    assert time == pytest.approx(length / speed + 5e-6 + place / speed, rel=2e-3)
