"""All noses at once on a free plate: momentum, energy, and a state that goes on to the bit."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene

from taichi_ldem.scenarios import strikers_in_words
from taichi_ldem.scene.names import NOSE_NAMES

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

KEYS: dict[str, dict[str, Any]] = {
    "cone": {"nose_angle": 50.0},
    "ogive": {"nose_radius": 1.5e-3},
    "ring": {"diameter": 0.6e-3, "ring_diameter": 1.4e-3},
}
PLACES = [(x * 1e-3, y * 1e-3) for x in (-1.95, 0.03, 1.97) for y in (-1.02, 1.45)]
"""Nearly over nodes, as a cone that comes down between them meets them late."""
MASS, SPEED = 20e-6, 8.0


def strikers() -> list[dict[str, Any]]:
    """One of each nose, beside each other."""
    common = {"diameter": 1.4e-3, "mass": MASS, "velocity": SPEED, "friction": 0.2}
    return [
        common | {"shape": name, "position": place, "gap": 1e-6} | KEYS.get(name, {})
        for name, place in zip(NOSE_NAMES, PLACES, strict=True)
    ]


def test_info_names_every_nose() -> None:
    rows = strikers_in_words.rows(block_scene(12, 12, 2, striker=strikers()))
    for number, name in enumerate(NOSE_NAMES, 1):
        assert rows[f"striker {number}"].startswith(f"{name} of ")


@pytest.fixture(scope="module")
def struck(taichi: None) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(block_scene(12, 12, 2, striker=strikers()))


@pytest.mark.slow  # six strikers' kernels
def test_every_nose_keeps_momentum_and_energy_and_goes_on_bitwise(struck: "Simulation") -> None:
    saved, samples = None, []
    names = [part.name for part in struck.bodies]
    masses = struck.dynamics.masses()
    whole = 12 * 12 * 2 * SPACING**3 * PMMA["density"]
    assert masses.sum() == pytest.approx(whole, rel=1e-12)
    for step in range(120):
        if step == 60:
            saved = struck.saved_state()
        samples.append(struck.sample_step())
        velocity = struck.dynamics.get_velocity()[..., 2]
        speeds = [struck.body(name).motion()[2] for name in names]
        momentum = MASS * np.sum(speeds) - (masses * velocity).sum()
        assert momentum == pytest.approx(len(names) * MASS * SPEED, rel=1e-11)
    for name in names:
        assert max(sample.observed[f"{name}_force_n"] for sample in samples) > 1, name
    assert max(sample.energy_error for sample in samples) < 1e-3
    end = struck.displacement()
    assert saved is not None
    struck.reset(struck.scene)
    struck.restore_state(saved)
    for sample in samples[60:]:
        assert vars(struck.sample_step()) == vars(sample)
    np.testing.assert_array_equal(struck.displacement(), end)
