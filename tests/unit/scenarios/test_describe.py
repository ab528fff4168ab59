"""The text about a scene before it runs: remarks on numbers that are most likely slips."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from support.blocks import block_scene
from support.paths import CONFIGS

from taichi_ldem.scenarios.describe import describe, warnings
from taichi_ldem.scene import load_scene
from taichi_ldem.solver import backend

SCENE_FILES = sorted(CONFIGS.glob("*.toml"))
QUICK = CONFIGS / "impact_small.toml"


def _quick(*overrides: str) -> list[str]:
    scene = load_scene(QUICK)
    return warnings(scene.changed(*overrides))


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        # R_f sqrt(G_f / E) = 31.45 sqrt(1034 / 1e7)
        (["material.youngs_modulus=1e7", "material.limit_strain=0.5"], "eps_p is 0.32, more than"),
        (["material.failure_strain=0.25", "material.limit_strain=0.5"], "eps_p is 0.25, more than"),
        (["plate.size=[1.6, 0.0464, 0.0016]"], "plate.size[0] = 1.6 is in metres; if milli"),
        (
            ["plate.size=[0.0464, 0.0464, 0.002]"],
            # 70 modules of 2/3 mm
            "plate.size: 46.40 x 46.40 mm are asked for, 46.67 x 46.67 mm are built",
        ),
        # sqrt(C11 / rho) = sqrt(1.2 E / rho), 1838 m/s
        (["striker.velocity=300"], "striker.velocity = 300 is in m/s: 0.16 of the speed"),
        (["solver.duration=2.4", "output.field_interval=0"], "solver.duration = 2.4 is in seconds"),
        (
            ["material.youngs_modulus=3350", "material.failure_strain=0.0175"],
            "material.youngs_modulus = 3350 is in Pa and softer than rubber",
        ),
        (["material.density=1.19"], "material.density = 1.19 is in kg/m3"),
        (["material.density=1.19e6"], "material.density = 1.19e+06 is in kg/m3"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_number_that_is_most_likely_a_slip_is_remarked_on(
    overrides: list[str], words: str
) -> None:
    found = [line for line in _quick(*overrides) if words in line]
    assert len(found) == 1
    others = [line for line in _quick(*overrides) if words not in line]
    assert [line for line in others if not line.startswith("striker.velocity")] == []


@pytest.mark.parametrize("config", SCENE_FILES, ids=lambda path: path.stem)
def test_shipped_scenes_hold_no_slips(config: Path) -> None:
    rounded = [line for line in warnings(load_scene(config)) if "asked" in line]
    slips = [line for line in warnings(load_scene(config)) if ": in " in line or "eps_p is" in line]
    assert slips == []
    assert len(rounded) == config.stem.startswith(("tension_dumbbell", "tension_quick"))


def test_steps_that_are_known_are_not_estimated() -> None:
    scene = load_scene(QUICK)
    assert any("about 12.3 million steps" in line for line in warnings(scene, 12_300_000))
    many = scene.changed("solver.time_step=1e-10", "solver.duration=2.4e-3")
    assert any("about 24 million steps" in line for line in warnings(many))


@pytest.fixture
def info(taichi: None, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """The text of `ldem info`, with the Taichi that there is."""
    monkeypatch.setattr(backend, "start", lambda solver: None)

    def text(fields: bool, **tables: Any) -> str:
        console = Console(width=100)
        with console.capture() as captured:
            console.print(describe(block_scene(4, 4, 2, **tables), fields=fields))
        return captured.get()

    return text


def test_info_says_the_memory_in_a_line_and_of_every_field_if_asked(
    info: Callable[..., str],
) -> None:
    plain = info(False)
    assert "memory of all fields" in plain
    assert "time to compute" in plain
    assert "one thread, with its contact" in plain  # a plate of few modules
    assert "displacement" not in plain
    assert "EA: axial stiffness" in plain
    assert "K_r" not in plain  # no damage
    damage = {"damage": True, "fracture_energy": 1034.0, "failure_factor": 31.45}
    whole = info(True, material=damage, plate={"size": [0.00201, 0.002, 0.001]})
    assert "displacement" in whole
    assert "L_cr: critical module edge" in whole
    assert "note: plate.size: 2.01 x 2.00 mm are asked for, 2.00 x 2.00 mm are built" in whole
