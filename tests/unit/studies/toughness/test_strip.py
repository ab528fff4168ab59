"""What a strip's record says, on records made by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from support.paths import CONFIGS

from taichi_ldem.scene import load_scene
from taichi_ldem.studies.toughness import strip
from taichi_ldem.studies.toughness.strip import Record, geometry, rayleigh_speed, read

SCENE = load_scene(CONFIGS / "tension_strip.toml")
HEIGHT = 0.0148


def test_the_speed_of_rayleigh_waves() -> None:
    """0.9194 of the shear wave at nu = 1/4, the root of Rayleigh's equation (Love, 1927)."""
    shear = math.sqrt(1.0 / 2.5)
    assert rayleigh_speed(1.0, 0.25, 1.0) == pytest.approx(0.9194 * shear, rel=5e-3)


def test_where_the_notch_ends() -> None:
    tip, plane, ligament = geometry(SCENE)
    assert (tip, plane) == (-0.01, 1e-4)
    assert ligament == pytest.approx(0.03)


def _reading(monkeypatch: pytest.MonkeyPatch, slope: float, speed: float) -> strip.Reading:
    """A crack that starts at row 100 and then runs straight, a row a microsecond."""
    monkeypatch.setattr(strip, "free_height", lambda simulation: HEIGHT)
    rows = np.arange(200)
    along = np.maximum(rows - 100, 0) * speed * 1e-6
    grown = rows > 100
    modulus = 3.35e9 / (1 - 0.25**2)
    separation = np.full(200, math.sqrt(2 * HEIGHT * 2.5 * 1034.0 / modulus))
    record = Record(
        separation=separation,
        fracture=1.5 * 1034.0 * along * SCENE.plate.size[2],
        time=1e-6 * rows,
        when=rows[grown],
        along=along[grown],
        across=slope * along[grown],
        energy_error=1e-3,
    )
    return read(SimpleNamespace(scene=SCENE), record)  # type: ignore[arg-type]


def test_a_straight_crack_is_read_as_it_was_made(monkeypatch: pytest.MonkeyPatch) -> None:
    reading = _reading(monkeypatch, slope=0.0, speed=300.0)
    assert reading.start == reading.run == pytest.approx(2.5)
    assert reading.bars == pytest.approx(1.5)
    assert reading.radiated == pytest.approx(1.0)
    assert reading.deviation == pytest.approx(0.0, abs=1e-9)
    wave = rayleigh_speed(3.35e9, 0.25, 1190.0)
    assert reading.speed == pytest.approx(300.0 / wave)


@pytest.mark.parametrize("degrees", [11.0, -16.0])
def test_a_crack_that_turns_is_seen_to_turn(
    degrees: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it ends further from the notch's plane than a quarter of the strip's height."""
    reading = _reading(monkeypatch, slope=math.tan(math.radians(degrees)), speed=300.0)
    assert reading.deviation == pytest.approx(degrees)


def test_a_crack_that_stays_where_it_is_has_no_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    reading = _reading(monkeypatch, slope=0.0, speed=0.0)
    assert (reading.start, reading.run, reading.bars, reading.radiated) == (None,) * 4
