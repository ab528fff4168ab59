"""Pictures of the cracked plate: the surface that is drawn, the child process, the images."""

import numpy as np
import pytest
from matplotlib.image import imread
from support.synthetic import synthetic_run

from taichi_ldem.output.render import snapshots as render
from taichi_ldem.output.render.bodies import bodies_at
from taichi_ldem.output.render.snapshots import NO_DEVICE, Shot, exterior, render_run
from taichi_ldem.scene import load_scene
from taichi_ldem.solver.backend import vulkan_device
from taichi_ldem.storage.store import _OWN_FILES, Fields, RunFolder, hexahedral_mesh

needs_vulkan = pytest.mark.skipif(
    not vulkan_device(), reason="no Vulkan device: apt install mesa-vulkan-drivers"
)


def fields_of(mask: np.ndarray, broken: np.ndarray, displacement: float = 0.0) -> Fields:
    points, hexahedra, _ = hexahedral_mesh(mask, 1.0, (0.0, 0.0, 0.0))
    moved = np.full((len(points), 3), displacement, dtype=np.float32)
    fraction = broken.astype(np.float32)
    return Fields(points, hexahedra, moved, moved, fraction, 0.0, np.zeros(1))


# --- surface --------------------------------------------------------------------------------------


def test_one_module_shows_six_faces_with_outward_normals():
    fields = fields_of(np.ones((1, 1, 1), dtype=bool), np.zeros(1), displacement=2.0)
    surface = exterior(fields, np.ones(1, dtype=bool))
    outward = surface.corners.mean(axis=1) - 2.5  # the middle of the displaced module
    np.testing.assert_allclose(surface.normals, 2 * outward, atol=1e-12)
    assert sorted(map(tuple, np.rint(2 * outward).astype(int))) == sorted(
        [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    )
    assert not surface.opened.any()


def test_shared_faces_are_drawn_only_once_a_crack_opens_them():
    mask = np.ones((1, 1, 3), dtype=bool)
    part = np.ones(3, dtype=bool)
    whole = exterior(fields_of(mask, np.zeros(3)), part)
    assert len(whole.corners) == 14  # a 3 x 1 x 1 prism
    cracked = exterior(fields_of(mask, np.array([0.1, render.GONE, 0.3])), part)
    assert len(cracked.corners) == 12  # two separate modules
    assert cracked.opened.sum() == 2
    np.testing.assert_allclose(np.unique(cracked.value), np.float32([0.1, 0.3]))


def test_a_module_that_a_corner_has_left_is_not_drawn():
    fields = fields_of(np.ones((1, 1, 2), dtype=bool), np.zeros(2))
    fields.displacement[fields.hexahedra[1, 6]] = 9.0  # a corner of the second module only
    surface = exterior(fields, np.ones(2, dtype=bool))
    assert len(surface.corners) == 6
    assert surface.corners.max() <= 1.0
    assert surface.opened.sum() == 1


def test_a_cut_face_is_not_taken_for_a_cracks_wall():
    mask = np.ones((1, 2, 1), dtype=bool)
    cut = exterior(fields_of(mask, np.zeros(2)), np.array([False, True]))
    assert len(cut.corners) == 6
    assert not cut.opened.any()


@pytest.mark.parametrize(
    ("view", "towards_eye", "right"),
    [("below", (0, 0, -1), (-1, 0, 0)), ("cut", (0, -1, 0), (1, 0, 0))],
)
def test_views_look_where_they_say(view, towards_eye, right):
    for panel in render._VIEWS[view](np.array((0.09, 0.09, 0.003))).panels:
        np.testing.assert_allclose(panel.rotation[2], towards_eye, atol=1e-12)
        np.testing.assert_allclose(panel.rotation[0], right, atol=1e-12)
        np.testing.assert_allclose(panel.rotation @ panel.rotation.T, np.eye(3), atol=1e-12)


# --- striker and clamp ----------------------------------------------------------------------------


def bodies(cracked, time, **changes):
    scene = load_scene(cracked.scene_file)
    history = {"time_s": np.array([0.0, 1e-3]), "striker_displacement_m": np.array([0.0, 2e-3])}
    history["striker_force_n"] = np.array([300.0, 300.0])
    striker = scene.striker.model_copy(update=changes)
    return bodies_at(scene.model_copy(update={"striker": striker}), history, time)


@pytest.mark.parametrize(("shape", "across"), [("hemisphere", 12.7e-3), ("cylinder", 92.8e-3)])
def test_the_striker_stands_where_the_history_says(cracked, shape, across):
    told = bodies(cracked, 0.5e-3, shape=shape, position=(3e-3, 0.0), gap=0.1e-3)
    corners = told.faces.reshape(-1, 3)
    assert corners[:, 2].min() == pytest.approx(3.2e-3 + 0.1e-3 - 1e-3)  # halfway along the 2 mm
    assert np.ptp(corners[:, 0]) == pytest.approx(12.7e-3)
    assert np.ptp(corners[:, 1]) >= across
    outward = told.faces.mean(axis=1) - corners.mean(axis=0)
    sides = np.linalg.norm(told.normals, axis=1) > 0.5
    assert np.all((told.normals * outward).sum(axis=1)[sides] > -1e-9)
    assert told.caption() == "blue: the striker, force on it 300 N;  dashed: the clamp"


def test_the_clamp_is_circles_from_above_and_places_from_the_side(cracked):
    told, centre = bodies(cracked, 0.0), np.zeros(3)
    above = told.clamp_lines(render._rotation(0.0, 90.0), centre)
    assert [np.linalg.norm(c, axis=1).max() for c in above] == pytest.approx([0.038, 0.045])
    side = told.clamp_lines(render._rotation(0.0, 0.0), centre)
    assert sorted({float(abs(x)) for line in side for x in line[:, 0]}) == [0.038, 0.045]
    assert sorted({float(z) for line in side for z in line[:, 1]}) == pytest.approx([0.0, 3.2e-3])
    outline = told.outline(render._rotation(180.0, -90.0), centre)
    np.testing.assert_allclose(np.linalg.norm(outline, axis=1), 6.35e-3, rtol=1e-9)


# --- the caller's side ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cracked(tmp_path_factory) -> RunFolder:
    return synthetic_run(tmp_path_factory.mktemp("runs") / "cracked")


@pytest.mark.parametrize(
    ("times", "steps"),
    [
        (None, [1, 2]),  # the scene's image time 5 ms, and the end
        ([0.0], [0]),
        ([2.6e-3, 4.9e-3, 1.0], [1, 2]),  # fields are stored at 0, 5 and 10 ms
        ([], []),
    ],
)
def test_the_nearest_stored_steps_are_drawn_once(cracked, times, steps):
    assert [step for step, _ in render._steps(cracked, times)] == steps


def test_another_time_than_the_wanted_one_is_told(cracked, capsys):
    render._steps(cracked, [5e-3, 2.6e-3])
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "no fields are stored at 2.6 ms: drawn at the nearest time, 5 ms" in told


def test_pictures_of_other_shots_have_other_names():
    shots = [
        Shot(view="above"),
        Shot(view="above", section=("x", 0.0)),
        Shot(view="above", section=("x", 2e-3)),
        Shot(azimuth=25.0, elevation=-35.0),
        Shot(colour="energy"),
    ]
    names = [shot.name for shot in shots]
    assert names == ["above", "above_x0", "above_x0.002", "below_az25_el-35", "below_energy"]
    assert all(_OWN_FILES.fullmatch(f"shot_1.4ms_{name}.png") for name in names)


def test_without_a_vulkan_device_one_line_says_how_to_get_one(cracked, monkeypatch, capsys):
    for variable in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):  # old and new name
        monkeypatch.setenv(variable, "/nowhere/driver.json")
    assert render_run(cracked, [0.0]) == []
    out, err = capsys.readouterr()
    assert out == ""
    assert err == NO_DEVICE + "\n"
    assert "mesa-vulkan-drivers" in err


def test_a_child_that_dies_is_one_line(cracked, monkeypatch, capsys):
    monkeypatch.setattr(render.sys, "executable", "/bin/false")
    assert render_run(cracked, [0.0]) == []
    err = capsys.readouterr().err
    assert "code 1" in err
    assert err.count("\n") == 1


def test_a_child_that_hangs_is_ended(cracked, monkeypatch, capsys):
    monkeypatch.setattr(render, "TIMEOUT_S", 0.05)
    monkeypatch.setattr(render, "TIMEOUT_PER_PICTURE_S", 0.0)
    assert render_run(cracked, [0.0]) == []
    assert "took more than" in capsys.readouterr().err


# --- pictures -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pictures(cracked, tmp_path_factory) -> dict[str, np.ndarray]:
    """Pictures at 10 ms, by folder and view."""
    intact = synthetic_run(tmp_path_factory.mktemp("runs") / "intact", cracked=False)
    working = tmp_path_factory.mktemp("working")
    images = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(working)
        for name, folder in (("cracked", cracked), ("intact", intact)):
            for path in render_run(folder, [10e-3]):
                images[f"{name} {path.name}"] = imread(path)[..., :3]
    assert list(working.iterdir()) == []  # GGUI would leave its imgui.ini
    return images


@needs_vulkan
def test_three_pictures_a_time_with_something_on_them(pictures):
    names = [f"crack_10ms_{view}.png" for view in ("below", "above", "cut")]
    assert list(pictures) == [f"{run} {name}" for run in ("cracked", "intact") for name in names]
    for image in pictures.values():
        assert image.shape == (1050, 1400, 3)
        plate = (np.abs(image - 1.0) > 0.05).any(axis=2)
        assert 0.1 < plate.mean() < 0.8


@needs_vulkan
def test_cracks_show(pictures):
    for view in ("below", "above", "cut"):
        name = f"crack_10ms_{view}.png"
        differs = np.abs(pictures[f"cracked {name}"] - pictures[f"intact {name}"]).max(axis=2) > 0.1
        assert differs.mean() > 0.005
    # The key at the bottom and the blue striker aside, a whole plate has no colours but greys.
    whole = pictures["intact crack_10ms_below.png"][:900]
    assert (whole[..., 0] - whole[..., 2]).max() < 0.1
    assert np.ptp(pictures["cracked crack_10ms_below.png"][:900], axis=2).max() > 0.3


@needs_vulkan
def test_seen_from_below_plus_x_is_on_the_left(pictures):
    # The synthetic crack along +x has no counterpart along -x.
    image, whole = (pictures[f"{run} crack_10ms_below.png"] for run in ("cracked", "intact"))
    differs = (np.abs(image - whole).max(axis=2) > 0.1)[400:620]  # rows around y = 0
    row = differs[differs[:, 500:680].sum(axis=1).argmax()]
    assert row[500:680].mean() > 0.9
    assert not row[760:830].any()  # between the middle and the circular crack


@needs_vulkan
def test_the_striker_shows_over_the_plate(pictures):
    image = pictures["intact crack_10ms_above.png"][100:900]
    blue = image[..., 2] - image[..., 0] > 0.15
    assert 0.002 < blue.mean() < 0.1
