"""What is varied: no value is dropped silently, and every value has a name of its own."""

import pytest
from support.members import SCENE

from taichi_ldem.ensemble.axes import make_axes
from taichi_ldem.ensemble.plan import make_plan
from taichi_ldem.errors import SceneError


def parts(vary: str) -> list[str]:
    (axis,) = make_axes(None, None, [vary])
    return [value.part for value in axis.values]


def test_values_that_differ_in_the_last_digit_are_members_of_their_own() -> None:
    close = ["1.0000000000001", "1.0000000000002", "1.0000000000003"]
    plan = make_plan(SCENE, vary=[f"striker.velocity={','.join(close)}"])
    assert [member.scene.striker.velocity for member in plan.members] == [float(v) for v in close]
    assert [member.name for member in plan.members] == [
        "velocity1",
        "velocity1.0000000000002",
        "velocity1.0000000000003",
    ]


def test_large_seeds_are_not_rounded_to_the_same_name() -> None:
    seeds = "1000000000000,1000000000001,9007199254740992,9007199254740993"
    plan = make_plan(SCENE, cv="0.25", seeds=seeds)
    assert [member.name for member in plan.members] == [
        f"cv0.25_seed{seed}" for seed in seeds.split(",")
    ]


def test_texts_that_differ_in_signs_only_have_names_of_their_own() -> None:
    assert parts("striker.shape='a b','a/b','a_b'") == ["shapeaxb", "shapeaxb-2", "shapeaxb-3"]
    long = ",".join(f"'{'x' * 80}{n}'" for n in range(2))
    first, second = parts(f"striker.shape={long}")
    assert first != second
    assert len(second) < 80


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ("striker.velocity=5,5.0", "5 equals 5.0; a member would be missing"),
        ("striker.velocity=5,4,5", "5 is given twice; a member would be missing"),
        ("striker.velocity=1e-1,0.1", "1e-1 equals 0.1; a member would be missing"),
        ("striker.mass=0.0,-0.0", "0.0 equals -0.0; a member would be missing"),
        ("striker.position=[0, 0],[0.0, 0.0]", "[0, 0] equals [0.0, 0.0]"),
        ("striker.shape='flat',flat", "'flat' equals flat"),
    ],
)
def test_equal_values_are_refused_instead_of_swallowed(vary: str, message: str) -> None:
    with pytest.raises(SceneError) as error:
        make_axes(None, None, [vary])
    assert message in str(error.value)


def test_a_name_that_no_folder_can_have_is_refused() -> None:
    data = f"[{', '.join(str(1000.0 + n) for n in range(20))}]"
    names = ("fracture_energy", "youngs_modulus", "density")
    with pytest.raises(SceneError, match="is too long for a folder"):
        make_plan(SCENE, vary=[f"disorder.{name}_data={data}" for name in names])
