"""Tables of strikers and supports: what a scene may say, and what is said about the rest."""

from pathlib import Path
from typing import Any

import pytest
from support.blocks import block_scene
from support.scenes import GOOD

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene, load_scene, parse_scene_text, scene_to_toml
from taichi_ldem.storage.provenance import canonical

HIT = {"diameter": 1e-3, "mass": 1e-3, "velocity": 2.0}
SECOND = HIT | {"position": [1e-3, 0.0], "shape": "cone", "nose_angle": 30.0}


def struck(*strikers: dict[str, Any], **tables: Any) -> Scene:
    given = strikers[0] if len(strikers) == 1 else list(strikers)
    return block_scene(12, 12, 3, striker=given, **tables)


def refused(*strikers: dict[str, Any], **tables: Any) -> str:
    with pytest.raises(SceneError) as error:
        struck(*strikers, **tables)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"velocity": -1}, "striker.velocity = -1: must be at least 0"),
        (
            {"velocity": [1, 2]},
            "striker.velocity = [1, 2]: must be a number, towards the plate, or",
        ),
        (
            {"velocity": "fast"},
            'striker.velocity = "fast": must be a number, towards the plate, or',
        ),
        ({"velocity": [0, 0, 1]}, "striker.velocity = [0, 0, 1]: its z must be at most 0, towards"),
        ({"velocity": [1.0, 0, -1]}, "needs striker.guided = false, as a guided striker moves"),
        ({"mass": None}, "scene: missing key 'striker.mass'"),
        ({"motion": "prescribed", "gravity": 9.81}, 'must be 0 with striker.motion = "prescribed"'),
        ({"nose_angle": 30.0}, 'striker.nose_angle = 30.0: is for striker.shape = "cone" only'),
        ({"shape": "cone"}, "missing key 'striker.nose_angle' (striker.shape = \"cone\")"),
        ({"shape": "cone", "nose_angle": 90}, "striker.nose_angle = 90: must be at most 89 and at"),
        ({"shape": "ogive", "nose_radius": 4e-4}, "must be at least 0.0005, half of striker.diam"),
        (
            {"shape": "ring", "ring_diameter": 9e-4},
            "must be at least striker.diameter = 0.001, the",
        ),
        ({"shape": "wedge"}, 'striker.shape = "wedge": must be "hemisphere", "cylinder", "cone", '),
    ],
)
def test_a_striker_that_cannot_be_is_refused_in_one_line(keys: dict[str, Any], said: str) -> None:
    table = {key: value for key, value in (HIT | keys).items() if value is not None}
    assert said in refused(table)
    # the second of several is named by its number
    assert said.replace("striker.", "striker[1].") in refused(HIT, table)


def test_a_striker_must_fit_inside_the_clamp_with_its_ring() -> None:
    clamp = {"kind": "rim", "inner_diameter": 4e-3}
    ring = HIT | {"shape": "ring", "ring_diameter": 3.5e-3}
    assert "must be smaller with the wall than clamp.inner_diameter" in refused(ring, clamp=clamp)
    assert "striker[1].position" in refused(HIT, HIT | {"position": [1.9e-3, 0]}, clamp=clamp)


def test_a_velocity_along_minus_z_is_the_number() -> None:
    number, vector = struck(HIT), struck(HIT | {"velocity": [0.0, 0.0, -2.0]})
    assert number.striker is not None
    assert vector.striker is not None
    assert number.striker.vector == vector.striker.vector == (0.0, 0.0, -2.0)
    assert number.striker.speed == vector.striker.speed == 2.0


def test_one_striker_is_a_table_and_several_are_a_list(tmp_path: Path) -> None:
    one, two = struck(HIT), struck(HIT, SECOND)
    assert struck(HIT) == block_scene(12, 12, 3, striker=[HIT])  # a list of one is the same
    assert one.striker == one.strikers[0] == two.striker
    assert [striker.shape for striker in two.strikers] == ["hemisphere", "cone"]
    for scene, head in ((one, "\n[striker]\n"), (two, "\n[[striker]]\n")):
        text = scene_to_toml(scene)
        assert head in text
        assert parse_scene_text(text, "again") == scene == scene.changed()
    assert canonical(one)["striker.mass"] == 1e-3
    assert not block_scene(12, 12, 3).strikers
    assert "striker" not in scene_to_toml(block_scene(12, 12, 3))
    assert "9 tables [[striker]]: a scene has at most 8" in refused(*[HIT] * 9)
    assert 'scenario = "bend" takes one' in refused(
        HIT, HIT, scenario="bend", supports={"span": 4e-3, "diameter": 1e-3}
    )


def test_an_override_names_the_striker_by_its_number(tmp_path: Path) -> None:
    path = tmp_path / "one.toml"
    path.write_text(GOOD)
    for key in ("striker.velocity", "striker[0].velocity"):
        scene = load_scene(path, [f"{key}=2.5"])
        assert [striker.speed for striker in scene.strikers] == [2.5]
    second = "[[striker]]\ndiameter = 0.01\nmass = 1.0\nvelocity = 1.0\nposition = [0.01, 0]\n"
    path.write_text(GOOD.replace("[striker]", "[[striker]]") + second)
    scene = load_scene(path, ["striker[1].velocity=[0, 0, -3]"])
    assert [striker.speed for striker in scene.strikers] == [1.065, 3.0]
    for key, said in (
        ("striker.velocity=1", "and this one has 2; give striker[0] to striker[1]"),
        ("striker[2].mass=1", "this scene has 2 [[striker]], numbered from 0"),
        ("plate[0].size=1", "a scene has one table [plate], give it no number"),
        ("striker[1].mass=-1", "command line: striker[1].mass = -1: must be greater than 0"),
        ("striker[1].mas=1", "command line: unknown key 'striker[1].mas'; did you mean 'mass'?"),
    ):
        with pytest.raises(SceneError) as error:
            load_scene(path, [key])
        assert said in str(error.value)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"span": 4e-3, "count": 3}, 'supports.count = 3: is for supports.kind = "balls" only'),
        ({}, "missing key 'supports.span' (supports.kind = \"cylinders\")"),
        ({"kind": "ring"}, "missing key 'supports.ring_diameter' (supports.kind = \"ring\")"),
        ({"kind": "ring", "ring_diameter": 7e-3}, "must be at most 0.006, the width of the plate"),
        (
            {"kind": "ring", "ring_diameter": 5e-4},
            "must be at most supports.ring_diameter = 0.0005",
        ),
        ({"kind": "balls", "circle_diameter": 4e-3, "count": 2}, "supports.count = 2: must be at"),
        (
            {"kind": "balls", "circle_diameter": 4e-3, "count": 20},
            "supports.diameter = 0.001: must be at most 0.000625738, with which 20 balls on the",
        ),
    ],
)
def test_supports_that_cannot_be_are_refused_in_one_line(keys: dict[str, Any], said: str) -> None:
    assert said in refused(HIT, supports={"diameter": 1e-3} | keys)


def test_a_bending_test_lies_on_cylinders() -> None:
    ring = {"kind": "ring", "ring_diameter": 4e-3, "diameter": 1e-3}
    said = refused(HIT, scenario="bend", supports=ring)
    assert 'supports.kind = "ring": must be "cylinders" with scenario = "bend"' in said
    assert not struck(HIT, supports=ring).is_beam
