"""Scenes: what is read, resolved, rounded and written back."""

import itertools
import math
from pathlib import Path
from typing import Any

import pytest
from support.blocks import block_scene
from support.paths import CONFIGS
from support.refusals import one_line

from taichi_ldem.errors import SceneError, SceneNote
from taichi_ldem.scene import Scene, load_scene, parse_scene, parse_scene_text, scene_to_toml

SCENE_FILES = sorted(CONFIGS.glob("*.toml"))

MINIMAL = """
scenario = "impact"
[plate]
size = [0.0928, 0.0928, 0.0032]
modules_through_thickness = 6
[material]
youngs_modulus = 3.35e9
poisson_ratio = 0.25
density = 1190
damage = false
[solver]
duration = 0.01
"""


@pytest.fixture
def minimal(tmp_path: Path) -> Path:
    path = tmp_path / "minimal.toml"
    path.write_text(MINIMAL)
    return path


def test_defaults_are_the_method_of_the_paper(minimal: Path) -> None:
    scene = load_scene(minimal)
    assert scene.striker is None
    assert scene.clamp is None
    assert scene.notch == ()
    assert scene.plate.surface_weights
    assert scene.plate.stiffness == "equation-2"
    assert scene.material.law == "bilinear"
    assert scene.material.fracture_areas == "derived"
    assert scene.solver.time_step == "auto"
    assert scene.solver.damping == 0
    assert scene.solver.precision == "f64"
    assert scene.solver.threads is None
    assert scene.output.history_interval == 1e-5
    assert scene.output.field_interval == 0.01 / 10


def test_whole_numbers_are_numbers(minimal: Path) -> None:
    density = load_scene(minimal).material.density
    assert density == 1190
    assert isinstance(density, float)


@pytest.mark.parametrize("config", SCENE_FILES, ids=lambda path: path.stem)
def test_shipped_scenes_say_what_they_are_for_and_load(config: Path) -> None:
    assert config.read_text().startswith("# ")
    assert load_scene(config).scenario == config.stem.partition("_")[0]


def test_the_paper_s_plate() -> None:
    plate = load_scene(CONFIGS / "impact.toml").plate
    assert plate.modules == (174, 174, 6)  # the paper's mesh
    assert plate.spacing == pytest.approx(0.5333e-3, rel=1e-4)  # the paper's L


def test_the_measured_strength_is_75_mpa() -> None:
    material = load_scene(CONFIGS / "impact_measured_strength.toml").material
    assert material.failure_strain == pytest.approx(75e6 / 3.35e9, rel=1e-15)
    assert material.limit_strain == material.failure_strain


FULL = """
[material]
fracture_energy = 1034
failure_strain = 0.0175
limit_strain = 0.03
[striker]
diameter = 0.0127
mass = 18.49
velocity = 1
position = [1e-3, -2e-3]
[clamp]
kind = "bonded"
inner_diameter = 0.076
outer_diameter = 0.09
[output]
image_times = [1e-3, 0.01]
[[notch]]
normal = "y"
position = 0
from = [0.01, 0]
to = [-0.01, 1e-3]
"""


@pytest.fixture
def full(tmp_path: Path) -> Path:
    head, solver = MINIMAL.replace("damage = false\n", "").split("[solver]")
    path = tmp_path / "full.toml"
    path.write_text(head + FULL.replace("[material]\n", "") + "[solver]" + solver)
    return path


@pytest.mark.parametrize("name", ["full", "minimal", *SCENE_FILES], ids=str)
def test_a_written_scene_reads_back_equal(
    name: str | Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    path = name if isinstance(name, Path) else request.getfixturevalue(name)
    scene = load_scene(path, ["solver.threads=2", "solver.time_step=9e-8"])
    again = tmp_path / "again.toml"
    again.write_text(scene_to_toml(scene))
    assert load_scene(again) == scene
    assert scene_to_toml(load_scene(again)) == scene_to_toml(scene)


def test_a_written_scene_names_resolved_defaults(minimal: Path) -> None:
    text = scene_to_toml(load_scene(minimal))
    assert "field_interval = 0.001\n" in text
    assert "surface_weights = true\n" in text
    assert "[striker]" not in text


def test_notch_axes_and_bounds(full: Path) -> None:
    (notch,) = load_scene(full).notch
    assert notch.axes == (1, 0, 2)
    assert notch.bounds == ((-0.01, 0.01), (0.0, 1e-3))


def test_overrides_win_in_order_and_make_tables(minimal: Path) -> None:
    scene = load_scene(
        minimal,
        [
            "solver.arch=cuda",
            "solver.arch = 'gpu'",
            "plate.surface_weights=false",
            "clamp.kind=free",
            "output.image_times=[0.001, 2e-3]",
        ],
    )
    assert scene.solver.arch == "gpu"
    assert not scene.plate.surface_weights
    assert scene.clamp is not None
    assert scene.clamp.kind == "free"
    assert scene.output.image_times == (0.001, 0.002)


def test_an_override_of_the_failure_strain_replaces_the_factor() -> None:
    scene = load_scene(CONFIGS / "impact.toml", ["material.failure_strain=0.017"])
    assert scene.material.failure_strain == 0.017
    assert scene.material.failure_factor is None


def _plate(**plate: object) -> Scene:
    return parse_scene(
        {
            "scenario": "impact",
            "plate": {"size": [0.01, 0.01, 0.003], "modules_through_thickness": 3, **plate},
            "material": {
                "youngs_modulus": 1e9,
                "poisson_ratio": 0.25,
                "density": 1e3,
                "damage": False,
            },
            "solver": {"duration": 1e-3},
        }
    )


def test_sides_are_rounded_to_whole_modules_within_a_percent() -> None:
    plate = _plate(size=[0.01005, 0.00995, 0.003]).plate
    assert plate.modules == (10, 10, 3)
    assert plate.actual_size == pytest.approx((0.01, 0.01, 0.003), rel=1e-12)


def test_a_side_further_off_is_refused_with_the_sizes_that_fit() -> None:
    with pytest.raises(SceneError, match=r"side y must be .* modules of 0\.001 m: 0\.009 or 0\.01"):
        _plate(size=[0.01, 0.0095, 0.003])


def test_a_side_shorter_than_a_module_is_refused() -> None:
    with pytest.raises(SceneError, match=r"side x must be .* of 0\.001 m: 0\.001$"):
        _plate(size=[0.0004, 0.01, 0.003])


def test_a_disc_covers_its_circle_only() -> None:
    plate = _plate(shape="disc", diameter=0.009).plate
    assert plate.covers(0, 0.0045)
    assert not plate.covers(0.004, 0.004)
    assert _plate().plate.covers(0.004, 0.004)


def test_fields_are_stored_at_start_intervals_images_and_end(minimal: Path) -> None:
    times = load_scene(
        minimal, ["output.field_interval=0.004", "output.image_times=[0.001]"]
    ).field_times
    assert times == (0.0, 0.001, 0.004, 0.008, 0.01)
    assert load_scene(minimal, ["output.field_interval=0"]).field_times == (0.0, 0.01)


def test_field_times_do_not_stop_short_of_a_rounded_end(minimal: Path) -> None:
    times = load_scene(minimal).field_times  # ten intervals of a tenth
    assert len(times) == 11
    assert times[-1] == 0.01
    assert all(math.isclose(b - a, 1e-3) for a, b in itertools.pairwise(times))


def test_a_byte_order_mark_and_windows_line_ends_are_read(minimal: Path) -> None:
    plain = load_scene(minimal)
    minimal.write_bytes(b"\xef\xbb\xbf" + MINIMAL.replace("\n", "\r\n").encode())
    assert load_scene(minimal) == plain


# -- overrides that shorten a run ------------------------------------------------------------------


def test_an_earlier_end_leaves_out_later_snapshots_with_a_note() -> None:
    with pytest.warns(SceneNote) as notes:
        scene = load_scene(CONFIGS / "impact.toml", ["solver.duration=5e-3"])
    assert [str(note.message) for note in notes] == [
        "output.image_times: left out what lies after solver.duration = 0.005: [0.006, 0.008]"
    ]
    assert scene.output.image_times == (1.75e-3,)
    assert parse_scene_text(scene_to_toml(scene), "x") == scene


def test_an_end_before_the_first_interval_stores_the_start_and_the_end() -> None:
    with pytest.warns(SceneNote) as notes:
        scene = load_scene(CONFIGS / "impact.toml", ["solver.duration=5e-6"])
    said = " ".join(str(note.message) for note in notes)
    assert "output.history_interval = 1e-05 is longer than solver.duration = 5e-06" in said
    assert "output.field_interval = 0.0005 is longer than solver.duration = 5e-06" in said
    assert scene.output.history_interval == 5e-6
    assert scene.field_times == (0.0, 5e-6)


def test_what_an_override_asks_for_after_the_end_is_refused() -> None:
    settings = ["solver.duration=5e-3", "output.image_times=[6e-3]"]
    with pytest.raises(SceneError, match=r"^command line: output\.image_times = 0\.006: must lie"):
        load_scene(CONFIGS / "impact.toml", settings)
    with pytest.raises(SceneError, match=r"^command line: output\.field_interval = 0\.006"):
        load_scene(
            CONFIGS / "impact.toml",
            ["solver.duration=5e-3", "output.field_interval=6e-3", "output.image_times=[]"],
        )


@pytest.mark.filterwarnings("error")
def test_a_later_end_gives_no_note() -> None:
    scene = load_scene(CONFIGS / "impact.toml", ["solver.duration=0.02"])
    assert scene.output == load_scene(CONFIGS / "impact.toml").output
    with pytest.raises(SceneError, match=r'solver\.duration = "long": must be a number'):
        load_scene(CONFIGS / "impact.toml", ["solver.duration=long"])


# -- overrides of the only notch -------------------------------------------------------------------


def test_an_override_changes_the_only_notch(full: Path) -> None:
    scene = load_scene(full, ["notch.position=1e-3", "notch.from=[-0.02, 0]"])
    assert scene.notch[0].position == 1e-3
    assert scene.notch[0].from_ == (-0.02, 0.0)
    assert scene.changed("notch.normal=x").notch[0].normal == "x"
    with pytest.raises(SceneError, match=r"^command line: notch\[0\]\.position = 1\.0: must lie"):
        load_scene(full, ["notch.position=1"])


def test_an_override_of_a_notch_needs_exactly_one(full: Path, minimal: Path) -> None:
    other = "[[notch]]\nnormal = 'x'\nposition = 0\nfrom = [0, 0]\nto = [0.01, 1e-3]\n"
    full.write_text(full.read_text() + other)
    for path, count, hint in (
        (minimal, 0, "change the file"),
        (full, 2, "give notch[0] to notch[1]"),
    ):
        with pytest.raises(SceneError) as refused:
            load_scene(path, ["notch.position=1e-3"])
        assert one_line(refused) == (
            "--set notch.position: needs a scene with one table [[notch]], and this one has "
            f"{count}; {hint}"
        )
    assert load_scene(full, ["notch[1].position=1e-3"]).notch[1].position == 1e-3


# -- contact of pieces -----------------------------------------------------------------------------

NOTCHED = {"notch": [{"normal": "x", "position": 2.5e-4, "from": [-1, -1], "to": [1, 1]}]}
TOUCH = {"contact": {"fragments": True, "friction": 0.3}}
BONDED = {"kind": "bonded", "inner_diameter": 1e-3, "outer_diameter": 2e-3}


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (TOUCH, "scene: contact.fragments = true: needs material.damage = true or a [[notch]], as"),
        (
            NOTCHED | {"contact": {"fragments": True, "friction": -0.1}},
            "scene: contact.friction = -0.1: must be at least 0 and at most 10",
        ),
        (
            NOTCHED | {"contact": {"friction": 0.3}},
            "scene: contact.friction = 0.3: needs contact.fragments = true",
        ),
        (
            NOTCHED | {"contact": {"fragments": "yes"}},
            'scene: contact.fragments = "yes": must be true or false',
        ),
        (NOTCHED | TOUCH | {"scenario": "modes"}, 'scene: scenario = "modes": takes no table [c'),
        (
            {"contact": {"landing": "soft"}, "floor": {}},
            'scene: contact.landing = "soft": must be',
        ),
        (
            {"contact": {"landing": "elastic"}, "clamp": BONDED},
            'scene: contact.landing = "elastic": needs a striker, a clamp of the kind "rings", sup',
        ),
    ],
)
def test_contact_is_refused_where_it_means_nothing(tables: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError) as refused:
        block_scene(4, 4, 2, **tables)
    assert one_line(refused).startswith(said)


def test_a_table_of_contact_may_say_that_pieces_do_not_touch() -> None:
    scene = block_scene(4, 4, 2, contact={"fragments": False})
    assert scene.contact is not None
    assert not scene.contact.fragments
