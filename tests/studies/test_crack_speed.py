"""What the study reads from a crack: one that is made up, of known speed, surface and width."""

import math

import numpy as np
import pytest
from support.paths import CONFIGS

from studies import crack_speed
from taichi_ldem.model.material import bars_of
from taichi_ldem.studies.toughness.strip import geometry, rayleigh_speed

SPEED, HEIGHT, OFFERED = 400.0, 0.0148, 2.0
"""Of the crack, m/s; between the grips, m; G over G_f."""
STEP = 5e-7
ROWS, QUIET = 300, 40
"""Samples, and those before the crack starts."""


@pytest.fixture
def strip(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(crack_speed, "SCENE", CONFIGS / "tension_strip.toml")
    return crack_speed.scene(3.0, "module", "crack")


def _crack(strip, a_row: int):
    """A straight crack in which ``a_row`` bars along an edge fail in each row, 3 modules wide."""
    tip, plane, _ = geometry(strip)
    rows = np.repeat(np.arange(QUIET, ROWS), a_row)
    along = tip + SPEED * STEP * (rows - QUIET + 0.5)
    side = np.where(np.arange(len(rows)) % 2, 1.5, -1.5) * strip.plate.spacing
    place = np.stack([plane + side, along, np.zeros(len(rows))], axis=1)
    modulus = strip.material.youngs_modulus / (1 - strip.material.poisson_ratio**2)
    separation = math.sqrt(2 * HEIGHT * OFFERED * strip.material.fracture_energy / modulus)
    time = STEP * np.arange(ROWS)
    kind = np.zeros(len(rows), dtype=int)
    return crack_speed._pieces(strip, place, kind, rows, time, np.full(ROWS, separation), HEIGHT)


def test_a_made_up_crack_is_read_as_it_was_made(strip) -> None:
    found = _crack(strip, a_row=6)
    assert len(found) > 5
    wave = rayleigh_speed(3.35e9, 0.25, 1190.0)
    area = bars_of(strip)[0].fracture_area
    for number, point in enumerate(found):
        assert point.pull == 3.0
        assert point.place == pytest.approx((number + 1.5) * crack_speed.PIECE)
        assert point.released == pytest.approx(OFFERED)
        assert point.speed == pytest.approx(SPEED / wave)
        # six bars in each of the rows in which the crack passes through 4 mm
        passed = 6 * area * crack_speed.PIECE / (SPEED * STEP)
        flat = crack_speed.PIECE * strip.plate.size[2]
        assert point.surface == pytest.approx(passed / flat)
        assert point.width == pytest.approx(3.0)
        assert point.cracks == pytest.approx(2.0)  # nothing has failed between the two sides


def test_twice_the_bars_are_twice_the_surface(strip) -> None:
    one, two = _crack(strip, 4), _crack(strip, 8)
    ratio = [b.surface / a.surface for a, b in zip(one, two, strict=True)]
    assert ratio == pytest.approx([2.0] * len(one))
    assert [p.speed for p in one] == [p.speed for p in two]


def test_the_strip_is_long_and_its_notch_as_deep_as_the_study_says(strip) -> None:
    tip, _, ligament = geometry(strip)
    assert strip.plate.size[1] == crack_speed.LENGTH
    assert (tip, ligament) == (pytest.approx(-0.025), pytest.approx(0.065))
    assert strip.solver.damping == 0.0


def test_the_table_names_freunds_speed() -> None:
    point = crack_speed.Point(3.0, 0.006, 4.0, 0.72, 5.8, 10.5, 2.5)
    slow = crack_speed.Point(0.3, 0.002, 0.8, 0.0, 0.0, 1.0, 1.0)
    lines = crack_speed.table([point, slow]).splitlines()
    assert lines[2] == "| 3 | 6 | 4.00 | 0.72 | 0.75 | 5.80 | 10.5 | 2.5 |"
    assert lines[3] == "| 0.3 | 2 | 0.80 | 0.00 | 0.00 | 0.00 | 1.0 | 1.0 |"
