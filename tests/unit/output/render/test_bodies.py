"""Striker and clamp in a run's pictures."""

import numpy as np
import pytest
from support.synthetic import synthetic_run

from taichi_ldem.output.render.bodies import Bodies, bodies_at
from taichi_ldem.output.render.views import rotation_of
from taichi_ldem.scene import load_scene
from taichi_ldem.solver.contact.drawing import Drawing
from taichi_ldem.storage.folder import RunFolder


@pytest.fixture(scope="module")
def cracked(tmp_path_factory) -> RunFolder:
    return synthetic_run(tmp_path_factory.mktemp("runs") / "cracked")


def bodies(cracked, time, **changes):
    scene = load_scene(cracked.scene_file)
    history = {"time_s": np.array([0.0, 1e-3]), "striker_displacement_m": np.array([0.0, 2e-3])}
    history["striker_force_n"] = np.array([300.0, 300.0])
    striker = scene.striker.model_copy(update=changes)
    return bodies_at(scene.model_copy(update={"strikers": (striker,)}), history, time)


@pytest.mark.parametrize(("shape", "across"), [("hemisphere", 12.7e-3), ("cylinder", 92.8e-3)])
def test_the_striker_stands_where_the_history_says(cracked, shape, across):
    drawn = bodies(cracked, 0.5e-3, shape=shape, position=(3e-3, 0.0), gap=0.1e-3)
    corners = drawn.faces.reshape(-1, 3)
    assert corners[:, 2].min() == pytest.approx(3.2e-3 + 0.1e-3 - 1e-3)  # halfway along the 2 mm
    assert np.ptp(corners[:, 0]) == pytest.approx(12.7e-3)
    assert np.ptp(corners[:, 1]) >= across
    outward = drawn.faces.mean(axis=1) - corners.mean(axis=0)
    sides = np.linalg.norm(drawn.normals, axis=1) > 0.5
    assert np.all((drawn.normals * outward).sum(axis=1)[sides] > -1e-9)
    assert drawn.caption() == "blue: the striker, force on it 300 N;  dashed: the clamp"


def test_the_clamp_is_circles_from_above_and_places_from_the_side(cracked):
    drawn, centre = bodies(cracked, 0.0), np.zeros(3)
    above = drawn.circles(rotation_of(0.0, 90.0), centre)
    assert [np.linalg.norm(c, axis=1).max() for c in above] == pytest.approx([0.038, 0.045])
    side = drawn.circles(rotation_of(0.0, 0.0), centre)
    assert sorted({float(abs(x)) for line in side for x in line[:, 0]}) == [0.038, 0.045]
    assert sorted({float(z) for line in side for z in line[:, 1]}) == pytest.approx([0.0, 3.2e-3])
    (outline,) = drawn.outlines(rotation_of(180.0, -90.0), centre)
    np.testing.assert_allclose(np.linalg.norm(outline, axis=1), 6.35e-3, rtol=1e-9)


def test_several_strikers_have_their_numbers_in_pictures(cracked) -> None:
    scene = load_scene(cracked.scene_file)
    one = scene.striker.model_copy(update={"position": (-5e-3, 1e-3)})
    two = scene.striker.model_copy(update={"position": (7e-3, 0.0)})
    zeros = np.zeros(2)
    history = {"time_s": np.array([0.0, 1e-3])}
    for name in ("striker", "striker2"):
        history |= {f"{name}_displacement_m": zeros, f"{name}_force_n": zeros}
    drawn = bodies_at(scene.model_copy(update={"strikers": (one, two)}), history, 0.0)
    assert drawn.caption().startswith("blue: striker 1, force on it 0 N; striker 2, force on it")
    above = drawn.labels(rotation_of(0.0, 90.0), np.zeros(3))
    assert [label for label, _ in above] == ["1", "2"]
    np.testing.assert_allclose([at for _, at in above], [[-5e-3, 1e-3], [7e-3, 0.0]], atol=1e-9)
    assert bodies(cracked, 0.0).labels(rotation_of(0.0, 90.0), np.zeros(3)) == []


def test_bodies_of_one_colour_stand_together_in_the_caption() -> None:
    found = Bodies((Drawing("blue: a"), Drawing("dashed: the clamp"), Drawing("blue: b")))
    assert found.caption() == "blue: a; b;  dashed: the clamp"
