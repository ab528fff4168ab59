"""Pictures of the cracked plate: which steps are drawn, the child process, the images."""

import numpy as np
import pytest
from matplotlib.image import imread
from support.synthetic import synthetic_run

from taichi_ldem.output.render import snapshots as render
from taichi_ldem.output.render.snapshots import NO_DEVICE, render_run
from taichi_ldem.solver.backend import vulkan_device
from taichi_ldem.storage.store import RunFolder

needs_vulkan = pytest.mark.skipif(
    not vulkan_device(), reason="no Vulkan device: apt install mesa-vulkan-drivers"
)


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


def test_another_time_than_the_wanted_one_is_warning(cracked, capsys):
    render._steps(cracked, [5e-3, 2.6e-3])
    warning = capsys.readouterr().err
    assert warning.count("\n") == 1
    assert "no fields are stored at 2.6 ms: drawn at the nearest time, 5 ms" in warning


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
