"""Shots and movies of a run, on a run folder made from formulas."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.synthetic import synthetic_run

from taichi_ldem.cli import main
from taichi_ldem.errors import SceneError
from taichi_ldem.output.movie import _palette, _write_gif, _write_mp4, check
from taichi_ldem.solver.backend import vulkan_device
from taichi_ldem.storage.folder import RunFolder

needs_vulkan = pytest.mark.skipif(
    not vulkan_device(), reason="no Vulkan device: apt install mesa-vulkan-drivers"
)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--view", "left"], "--view left: must be below, above or cut"),
        (["--colour", "heat"], "--colour heat: must be damage, velocity, energy or fragment"),
        (["--movie", "--out", "a.avi"], "must end in .mp4 or .gif"),
        (["--movie", "--fps", "0"], "--fps 0.0: must lie between"),
        (["--movie", "--width", "10"], "--width 10: must lie between"),
    ],
)
def test_bad_options_are_one_line(
    cracked: RunFolder, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["render", str(cracked.path), *words]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert message in err


@pytest.fixture(scope="module")
def cracked(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return synthetic_run(tmp_path_factory.mktemp("runs") / "cracked")


@needs_vulkan
def test_a_movie_has_a_picture_a_stored_step(
    cracked: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    import imageio_ffmpeg

    words = ["--movie", "--colour", "velocity", "--section", "y=0", "--view", "above"]
    assert main(["render", str(cracked.path), *words, "--width", "480", "--fps", "4"]) == 0
    path = cracked.path / "movie.mp4"
    assert capsys.readouterr().out == f"{path}: 3 pictures\n"
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    assert about["size"] == (480, 360)
    assert about["codec"] == "h264"
    frames = [np.frombuffer(frame, np.uint8).reshape(360, 480, 3).astype(int) for frame in reader]
    assert len(frames) == 3 + 4  # and a second on the last
    at_rest, moving = frames[0][60:300], frames[2][60:300]
    # the far half of the plate: dark violet at rest, brighter where it moves
    drawn = (at_rest < 230).all(axis=2).mean()
    assert 0.05 < drawn < 0.5
    assert np.abs(moving - at_rest).max(axis=2).mean() > 5


def test_a_movie_goes_into_a_folder_with_a_colon_in_its_name(tmp_path: Path) -> None:
    """The encoder took `run:1/...` for the name of a protocol."""
    folder, picture = tmp_path / "run:1", tmp_path / "a.png"
    folder.mkdir()
    Image.new("RGB", (64, 48)).save(picture)
    _write_mp4(folder / "a.mp4", [picture], 2.0, 64)
    assert (folder / "a.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_gif_repeats_and_holds_its_last_picture(tmp_path: Path) -> None:
    pictures = [tmp_path / f"{shade}.png" for shade in (0, 200)]
    for picture, shade in zip(pictures, (0, 200), strict=True):
        Image.new("RGB", (640, 480), (shade, 0, 0)).save(picture)
    _write_gif(tmp_path / "a.gif", pictures, 10.0, 321)
    with Image.open(tmp_path / "a.gif") as gif:
        assert (gif.n_frames, gif.size, gif.info["loop"]) == (2, (320, 240), 0)
        assert gif.info["duration"] == 100
        gif.seek(1)
        assert gif.info["duration"] == 1000
        assert gif.convert("RGB").getpixel((5, 5)) == (200, 0, 0)


def test_a_gif_keeps_the_colour_of_small_things():
    # A plate's worth of greys and a blue of 16 pixels.
    greys = np.resize(np.arange(60, 250, dtype=np.uint8), (120, 160))
    image = np.stack([greys, greys, greys], axis=-1)
    image[10:14, 10:14] = (60, 120, 190)
    picture = Image.fromarray(image)
    shown = picture.quantize(palette=_palette([picture]), dither=Image.Dither.NONE).convert("RGB")
    assert np.abs(np.asarray(shown)[11, 11].astype(int) - (60, 120, 190)).max() < 10
    assert np.abs(np.asarray(shown).astype(int) - image).max() < 10


def test_a_missing_encoder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(SceneError, match="pip install imageio-ffmpeg"):
        check(tmp_path / "movie.mp4")
    check(tmp_path / "movie.gif")
