"""Strikers and supports as they are drawn."""

from typing import Any

import numpy as np
import pytest
from support.blocks import block_scene

from taichi_ldem.analysis.quantities import named
from taichi_ldem.output.render.bodies import Bodies
from taichi_ldem.output.render.views import rotation_of
from taichi_ldem.scenarios.describe import left_out
from taichi_ldem.scenarios.runner import columns
from taichi_ldem.solver.contact import bodies_of

HIT = {"diameter": 1e-3, "mass": 1e-3, "velocity": 2.0}
SHAPES: dict[str, dict[str, Any]] = {
    "flat": {"shape": "flat"},
    "cone": {"shape": "cone", "nose_angle": 30.0},
    "ogive": {"shape": "ogive", "nose_radius": 2e-3},
    "ring": {"shape": "ring", "ring_diameter": 2e-3},
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_striker_is_drawn_where_it_is_and_its_faces_look_outward(shape: str) -> None:
    table = HIT | SHAPES[shape] | {"guided": False, "velocity": [1.0, 0.0, -2.0], "gap": 1e-4}
    scene = block_scene(12, 12, 3, striker=table)
    history = {
        name: np.array([0.0, value])
        for name, value in {
            "time_s": 1e-4,
            "striker_displacement_m": 2e-4,
            "striker_displacement_x_m": 1e-4,
            "striker_displacement_y_m": 0.0,
            "striker_force_n": 0.0,
        }.items()
    }
    (body,) = bodies_of(scene)
    drawn = body.drawing(scene, history, 5e-5)
    assert drawn is not None
    corners = drawn.faces.reshape(-1, 3)
    assert corners[:, 2].min() == pytest.approx(1.5e-3 + 1e-4 - 1e-4)  # halfway
    assert corners[:, 0].mean() == pytest.approx(5e-5, abs=1e-6)
    wide = 3e-3 if shape == "ring" else 1e-3
    assert np.ptp(corners[:, 0]) == pytest.approx(wide)
    assert volume(drawn.faces) > 0


def volume(faces: np.ndarray) -> float:
    """Volume within closed faces (F, 4, 3) by Gauss; above 0 where they look outward."""
    normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1]) / 2
    return float((faces.mean(axis=1) * normal).sum() / 3)


@pytest.mark.parametrize(
    ("keys", "size"),
    [
        ({"kind": "ring", "ring_diameter": 4e-3}, 2 * np.pi**2 * 2e-3 * 0.25e-6),
        ({"kind": "balls", "count": 5, "circle_diameter": 4e-3}, 5 * np.pi / 6 * 1e-9),
    ],
)
def test_round_supports_are_drawn_under_the_plate(keys: dict[str, Any], size: float) -> None:
    scene = block_scene(12, 12, 3, supports={"diameter": 1e-3} | keys)
    (body,) = bodies_of(scene)
    drawn = body.drawing(scene, {}, 0.0)
    assert drawn is not None
    assert drawn.faces[..., 2].max() == pytest.approx(0.0, abs=1e-9)
    seen = Bodies((drawn,))
    assert [len(seen.outlines(rotation_of(0.0, angle), np.zeros(3))) for angle in (90, -90)] == [
        0,
        1,
    ]
    assert np.abs(drawn.faces[..., 0]).max() == pytest.approx(2.5e-3)
    assert volume(drawn.faces) == pytest.approx(size, rel=0.05)


def test_columns_of_strikers_are_those_that_the_scene_needs() -> None:
    one = columns(block_scene(12, 12, 3, striker=HIT))
    assert one[:4] == [
        "time_s",
        "striker_displacement_m",
        "striker_velocity_m_s",
        "striker_force_n",
    ]
    assert not [name for name in one if "striker2" in name or "_x_" in name]
    free = HIT | {"guided": False, "position": [1e-3, 0.0]}
    alone = columns(block_scene(12, 12, 3, striker=free))
    assert {"striker_displacement_x_m", "striker_velocity_x_m_s", "striker_force_x_n"} < set(alone)
    two = columns(block_scene(12, 12, 3, striker=[HIT, free]))
    assert set(one) < set(two)
    assert "striker2_force_x_n" in two
    assert "striker_force_x_n" not in two
    assert "kinetic_striker2_j" in two
    assert named("kinetic_striker2_j").label == "kinetic energy of the striker 2"
    driven = {key: value for key, value in HIT.items() if key != "mass"} | {"motion": "prescribed"}
    assert "external_j" in columns(block_scene(12, 12, 3, striker=driven))


def test_info_names_what_is_left_out_once() -> None:
    lines = left_out(block_scene(12, 12, 3))
    assert [line for line in lines if "striker" in line] == ["striker contact (no [striker])"]
    lines = left_out(block_scene(12, 12, 3, striker=[HIT, HIT | {"position": [1e-3, 0]}]))
    assert [line for line in lines if "striker" in line] == [
        "friction of the striker (friction = 0)",
        "friction of the striker 2 (friction = 0)",
    ]
