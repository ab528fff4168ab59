"""The strips of a toughness study are the scene's, turned, refined and shifted."""

import pytest
from support.paths import CONFIGS

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import load_scene, parse_scene
from taichi_ldem.studies.toughness.plan import ANGLES, Strip, strips

ELASTIC = {"youngs_modulus": 3.35e9, "poisson_ratio": 0.25, "density": 1190.0}
BASE = load_scene(CONFIGS / "tension_strip.toml")


def test_the_first_strip_is_the_scene_itself() -> None:
    strip = Strip(0.0, 1.0, 0)
    scene = strip.scene(BASE)
    assert scene.plate.modules == BASE.plate.modules
    assert scene.notch[0].position == BASE.notch[0].position
    assert scene.notch[0].bounds == BASE.notch[0].bounds


def test_notches_lie_within_a_module_of_each_other() -> None:
    edge = BASE.plate.spacing
    seen = [Strip(0.0, 1.0, seed).scene(BASE).notch[0] for seed in range(6)]
    for places in ([n.position for n in seen], [n.bounds[0][1] for n in seen]):
        assert len(set(places)) == 6
        assert max(places) - min(places) <= edge


@pytest.mark.parametrize("angle", ANGLES)
def test_a_finer_strip_has_the_size_of_the_scene_s(angle: float) -> None:
    scene = Strip(angle, 2.0, 1).scene(BASE)
    assert scene.plate.size[:2] == pytest.approx(BASE.plate.size[:2], rel=0.02)
    assert scene.plate.modules_through_thickness == 3
    assert scene.plate.size[2] == pytest.approx(BASE.plate.size[2] / 2)
    assert scene.plate.angle == angle


def test_every_direction_has_its_strips_and_two_have_finer_ones() -> None:
    wanted = strips(BASE, refinements=(2.0,), seeds=2)
    assert len(wanted) == len(set(wanted)) == 2 * len(ANGLES) + 2 * 2
    assert {strip.angle for strip in wanted if strip.refinement > 1} == {0.0, 45.0}


def test_the_scenes_own_modules_are_not_run_twice() -> None:
    wanted = strips(BASE, refinements=(1.0,), seeds=2)
    assert len(wanted) == len(set(wanted)) == 2 * len(ANGLES)


def test_what_is_no_strip_is_refused() -> None:
    data = BASE.model_dump(by_alias=True, exclude_none=True)
    without = parse_scene({name: table for name, table in data.items() if name != "notch"})
    disc = {"centre": [0.0, 0.0, 0.0], "diameter": 2e-3, "direction": [1.0, 0.0, 0.0]}
    two = data | {"notch": [*data["notch"], disc]}
    with pytest.raises(SceneError, match=r"notch\[1\]: a strip takes notches that are normal"):
        strips(parse_scene(two))
    with pytest.raises(SceneError, match=r"needs scenario = .tension. and one \[\[notch\]\]"):
        strips(without)
    elastic = parse_scene(data | {"material": {"damage": False, **ELASTIC}})
    with pytest.raises(SceneError, match=r"material\.damage = false: a crack needs bars"):
        strips(elastic)


@pytest.mark.parametrize("strip", [Strip(22.5, 1.0, 3), Strip(0.0, 0.5, 0)])
def test_a_strip_is_found_by_its_name(strip: Strip) -> None:
    assert Strip.named(strip.name) == strip
