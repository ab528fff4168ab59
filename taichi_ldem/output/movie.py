"""Movies of a run: an MP4 or a GIF with one picture for each stored step."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.errors import SceneError
from taichi_ldem.output.render.snapshots import render_shot
from taichi_ldem.output.render.views import Shot
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.folder import RunFolder

SUFFIXES = (".mp4", ".gif")
_COLOURS = 192  # of a GIF
_COLOURED = 25  # spread of red, green and blue from which a pixel counts as coloured
HOLD_S = 1.0
"""Time for which a movie stays on its last picture, s."""


def check(path: Path) -> None:
    """Check that a movie can be written.

    Raises:
        SceneError: the file's format is unknown, or its encoder is missing.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise SceneError(f"--movie {path}: must end in .mp4 or .gif")
    if path.suffix.lower() == ".mp4":
        try:
            import imageio_ffmpeg  # noqa: F401
        except ImportError:
            raise SceneError(
                f"--movie {path}: needs the encoder of `pip install imageio-ffmpeg` (the extra "
                "[movie]); a .gif does not"
            ) from None


def movie(
    folder: RunFolder, path: Path, shot: Shot, *, fps: float = 12.0, width: int = 1120
) -> int:
    """Draw every stored step of a run and write the movie; returns its number of pictures.

    Args:
        fps: pictures a second.
        width: of a picture, pixels.

    Raises:
        SceneError: as `check`, or the pictures cannot be drawn.
        OSError: the movie cannot be written.
    """
    check(path)
    if not 0 < fps <= 120:
        raise SceneError(f"--fps {fps}: must lie between 0 and 120")
    if not 64 <= width <= 3840:
        raise SceneError(f"--width {width}: must lie between 64 and 3840 pixels")
    with tempfile.TemporaryDirectory() as scratch:
        pictures = [picture for _, picture in render_shot(folder, shot, Path(scratch))]
        made = Path(scratch, f"movie{path.suffix.lower()}")
        if made.suffix == ".gif":
            _write_gif(made, pictures, fps, width)
        else:
            _write_mp4(made, pictures, fps, width)
        write_whole(path, made.read_bytes())
    return len(pictures)


def load(picture: Path, width: int) -> Any:
    """A picture scaled to a width, its sides even as video wants them (PIL's Image)."""
    from PIL import Image

    with Image.open(picture) as image:
        height = round(image.height * width / image.width)
        size = width // 2 * 2, height // 2 * 2
        return image.convert("RGB").resize(size, Image.Resampling.LANCZOS)


def _write_mp4(path: Path, pictures: list[Path], fps: float, width: int) -> None:
    import imageio_ffmpeg

    size = load(pictures[0], width).size
    # H.264 with subsampled colours and the index first: plays in every browser
    writer = imageio_ffmpeg.write_frames(
        f"file:{path.absolute()}",  # with a colon in it, a bare path is the name of a protocol
        size,
        fps=fps,
        codec="libx264",
        pix_fmt_out="yuv420p",
        quality=None,
        macro_block_size=2,
        output_params=["-crf", "20", "-preset", "medium", "-movflags", "+faststart"],
    )
    writer.send(None)
    try:
        for picture in [*pictures, *pictures[-1:] * round(HOLD_S * fps)]:
            writer.send(np.ascontiguousarray(load(picture, width)))
    finally:
        writer.close()
    if not path.is_file() or not path.stat().st_size:
        raise OSError(f"the encoder wrote no '{path}'")


def _write_gif(path: Path, pictures: list[Path], fps: float, width: int) -> None:
    from PIL import Image

    images = [load(picture, width) for picture in pictures]
    # with one palette for all, parts that do not change are stored once
    palette = _palette(images[:: max(1, len(images) // 6)] + images[-1:])
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [round(1e3 / fps)] * len(frames)
    durations[-1] = round(1e3 * HOLD_S)
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=durations,
        loop=0,
        optimize=True,
        disposal=1,
    )


def _palette(images: list[Any]) -> Any:
    """A palette of some images, to which coloured pixels contribute as much as all pixels."""
    from PIL import Image

    pixels = np.concatenate([np.asarray(image).reshape(-1, 3) for image in images])
    coloured = pixels[np.ptp(pixels.astype(int), axis=1) > _COLOURED]
    if len(coloured):
        pixels = np.concatenate([pixels, np.resize(coloured, (len(pixels), 3))])
    return Image.fromarray(pixels[None]).quantize(_COLOURS)
