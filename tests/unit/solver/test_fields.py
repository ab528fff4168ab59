"""The table of state: what a scene names is there, and nothing else."""

import dataclasses
from typing import TYPE_CHECKING

import pytest
from support.blocks import DAMAGE, block_scene
from support.paths import CONFIGS

from taichi_ldem.scene import DISORDERED, load_scene
from taichi_ldem.solver.features import Features, tables_of_all_features
from taichi_ldem.solver.fields import FIELDS, Layout, is_long, rows, suits_one_thread

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

UNEVEN = ("strength", "weakest", "modulus", "own_mass", "own_inverse_mass", "offset")


def test_what_a_scene_leaves_out_is_not_there(elastic: "Simulation") -> None:
    fields = elastic.field_bytes()
    for name in ("peak", "touched", "recorded", "removed", "damped", "softening", *UNEVEN):
        assert name not in fields
    assert elastic.body("striker") is None
    assert elastic.body("rings") is None


def test_features_follow_from_the_scene() -> None:
    assert Features.of(block_scene(2, 2, 2)) == Features()
    uneven = {
        "disorder": {f"{name}_cv": 0.1 for name in DISORDERED if name != "strength"},
        "plate": {"perturbation": 0.1},
        "solver": {"damping": 1.0},
    }
    elastic = Features.of(block_scene(2, 2, 2, **uneven))
    assert elastic == Features(damping=True, modulus=True, density=True, perturbed=True)
    damaged = Features.of(block_scene(2, 2, 2, material=DAMAGE, **uneven))
    assert damaged == dataclasses.replace(elastic, law="bilinear", strength=True)


def test_every_feature_is_left_out_with_its_reason_or_switched_on() -> None:
    scene = block_scene(2, 2, 2)
    names = [feature.name for feature in dataclasses.fields(Features)]
    assert len(Features().left_out()) == len(list(tables_of_all_features(scene))) == len(names)
    on = Features("bilinear", *[True] * (len(names) - 1))
    assert on.left_out() == []
    assert Features(damping=True).left_out() == [
        line for line in Features().left_out() if line != "damping (solver.damping = 0)"
    ]


# branches of the law and of crack tips that need no field
WITHOUT_FIELDS = ("closing", "flaws", "tip_strain")


@pytest.mark.parametrize(
    "name", [f.name for f in dataclasses.fields(Features) if f.name not in WITHOUT_FIELDS]
)
def test_a_feature_has_fields_of_its_own(name: str) -> None:
    layout = Layout.fitting((5, 20, 20), 8, True, 2)
    value = "bilinear" if name == "law" else True
    own = {row.name for row in rows(Features(**{name: value}), layout)}
    assert own > {row.name for row in rows(Features(), layout)}


def test_names_of_a_checkpoint_stay() -> None:
    """Files that were written under these names must open."""
    evolving = [row.name for row in FIELDS if row.evolves]
    of_volumes, of_bars = ["volume_damage", "volume_loss"], ["peak", "face_loss", "recorded"]
    of_bars.append("resistance")
    assert evolving == ["displacement", "velocity", *of_volumes, *of_bars, "damped"]


def test_strips_are_no_thinner_than_their_overlap_allows() -> None:
    for ny in range(4, 60):
        layout = Layout.fitting((5, ny, 20), 8, True, 16)
        assert layout.strips == 1 or (ny - 2) // layout.strips >= 4  # ROWS_PER_STRIP
        assert layout.pieces == 1
    on_gpu = Layout.fitting((5, 20, 40), 4, False, 16)
    assert (on_gpu.lanes.width, on_gpu.strips, on_gpu.bar_rows) == (1, 1, 20)
    assert on_gpu.pieces * on_gpu.piece >= on_gpu.lanes.length


@pytest.mark.parametrize(
    ("name", "settings", "long", "alone"),
    [
        ("impact", [], True, False),  # the paper's run, 18 minutes on two cores
        ("impact_quick", [], False, False),
        ("impact_quick", ["solver.threads=1"], False, True),
        ("bend_quick", [], False, True),  # few modules, and no number of threads
        ("bend_quick", ["solver.threads=2"], False, False),
        ("bend_quick", ["solver.arch=cuda"], False, False),
    ],
)
def test_how_a_scene_is_compiled_and_driven(
    name: str, settings: list[str], long: bool, alone: bool
) -> None:
    scene = load_scene(CONFIGS / f"{name}.toml", settings)
    assert (is_long(scene), suits_one_thread(scene)) == (long, alone)
