"""Cracks that advance, from lists of broken bars."""

import numpy as np
import pytest

from taichi_ldem.gallery.readings import Advance, deviation


def crack(slope: float = 0.0) -> Advance:
    """A crack that runs with 500 m/s from 0 to 20 mm, a bar each 0.1 mm."""
    along = np.arange(0.0, 20e-3, 1e-4)
    return Advance(along / 500.0, along, slope * along)


def test_the_speed_is_that_of_the_front() -> None:
    found = crack()
    assert found.speed(5e-3, 15e-3) == pytest.approx(500.0, rel=0.02)
    assert found.speed(5e-3, 30e-3) is None
    assert found.arrival(10e-3) == pytest.approx(20e-6, rel=0.02)
    late = Advance(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 2.0]), np.zeros(3))
    assert late.front.tolist() == [1.0, 3.0, 3.0]


def test_the_path_and_its_angle() -> None:
    found = crack(slope=np.tan(np.radians(10.0))).between(2e-3, 18e-3)
    assert deviation(found) == pytest.approx(10.0, abs=1e-6)
    along, across = found.path(1e-3)
    assert np.allclose(across, np.tan(np.radians(10.0)) * along, atol=1e-4)
    assert deviation(Advance(*np.zeros((3, 2)))) is None
