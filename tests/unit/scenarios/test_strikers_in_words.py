"""What `ldem info` says about strikers."""

from support.paths import CONFIGS

from taichi_ldem.scenarios import strikers_in_words
from taichi_ldem.scenarios.describe import warnings
from taichi_ldem.scene import load_scene


def test_each_striker_has_its_nose_place_mass_speed_and_energy() -> None:
    rows = strikers_in_words.rows(load_scene(CONFIGS / "impact_two_strikers.toml"))
    assert rows["striker 1"] == "flat of 6 mm at (-6, 0) mm, 200 g, 4 m/s, 1.6 J"
    assert rows["striker 2"] == (
        "hemisphere of 6 mm at (8, 0) mm, 3 g, 16.97 m/s at 45.0 degrees to the vertical, 0.432 J"
    )
    assert rows["forces averaged over"].endswith("% of the duration")
    indenter = strikers_in_words.rows(load_scene(CONFIGS / "impact_indent.toml"))
    assert indenter["striker"].endswith("mm at (0, 0) mm, kept at 0.05 m/s")


def test_a_scene_without_a_striker_has_no_such_rows() -> None:
    assert strikers_in_words.rows(load_scene(CONFIGS / "impact_drop.toml")) == {}


def test_a_striker_over_a_hole_is_named() -> None:
    scene = load_scene(CONFIGS / "impact_hole.toml")
    assert not any("is in hole" in line for line in warnings(scene))
    over = scene.changed("striker.position=[-0.010, 0.001]")  # 3 mm from the middle of hole[0]
    expected = "striker.position is in hole[0]: the tip meets no part of the plate"
    assert expected in warnings(over)
    assert strikers_in_words.remarks(scene.changed("striker.position=[-0.010, 0.0004]")) == []
