"""Images inside a page: a run's figures, its snapshots, or plain maps where there is no painter."""

from __future__ import annotations

import base64
import io
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.errors import SceneError
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.output.render.surfaces import FAILED_SHARE
from taichi_ldem.output.report.page import Picture, Snapshots
from taichi_ldem.reading import read_bytes
from taichi_ldem.storage.fields import read_fields, read_times
from taichi_ldem.storage.folder import RunFolder

_WIDTH_PX = 800
MISSING = (
    f"White or missing: modules with {100 * FAILED_SHARE:.0f} % or more of their bars broken; "
    "they are still in the model."
)


def embedded(file: Path) -> str:
    """A PNG as a data address."""
    return _address(read_bytes(file), "png")


def _address(data: bytes, kind: str) -> str:
    return f"data:image/{kind};base64," + base64.b64encode(data).decode()


def snapshots(run: LoadedRun, most: int) -> tuple[list[Snapshots], str]:
    """The plate over time, from below and above.

    Without a Vulkan device they are plain maps, and a line says why.

    Args:
        most: times at which it is drawn, at most.
    """
    from taichi_ldem.output.render.snapshots import render_shot
    from taichi_ldem.output.render.views import Shot

    folder, scene = run.folder, run.scene
    if most < 1 or not folder.fields_file.exists() or not run.drawn:
        return [], ""
    stored = read_times(folder.fields_file)
    if not stored.size:
        return [], ""
    chosen = np.unique(np.linspace(0, len(stored) - 1, min(most, len(stored))).round().astype(int))
    times = [float(stored[step]) for step in chosen]
    struck = (scene.striker is not None or scene.floor is not None) and not run.is_beam
    views = ("below", "above") if struck else ("above",)
    with tempfile.TemporaryDirectory() as scratch:
        try:
            found = []
            for view in views:
                into = Path(scratch, view)
                into.mkdir()
                drawn = render_shot(folder, Shot(view=view), into, times)
                pictures = [Picture(f"{1e3 * at:.3f} ms", _small(file)) for at, file in drawn]
                found.append(Snapshots(view, [at for at, _ in drawn], pictures, MISSING))
            return found, ""
        except SceneError as error:
            return [plain_maps(folder, [int(step) for step in chosen])], str(error)


def _small(file: Path) -> str:
    """A picture as WebP of the page's width."""
    from taichi_ldem.output.movie import load

    packed = io.BytesIO()
    load(file, _WIDTH_PX).save(packed, "WEBP", quality=82)
    return _address(packed.getvalue(), "webp")


def plain_maps(folder: RunFolder, steps: Sequence[int]) -> Snapshots:
    """Largest share of broken bars in each column of modules, drawn without any device."""
    pictures, times = [], []
    for step in steps:
        fields = read_fields(folder.fields_file, step)
        caption = f"{1e3 * fields.time:.3f} ms, broken bars, from below"
        pictures.append(Picture(caption, _plain_map(fields)))
        times.append(fields.time)
    return Snapshots("broken bars", times, pictures)


def _plain_map(fields: Any) -> str:
    from matplotlib import colormaps
    from PIL import Image

    base = fields.points[fields.hexahedra[:, 0]]
    edge = np.linalg.norm(fields.points[fields.hexahedra[0, 1]] - base[0])
    i, j = np.rint((base - base.min(axis=0))[:, :2] / edge).astype(int).T
    column = np.full((j.max() + 1, i.max() + 1), -1.0)
    np.maximum.at(column, (j, i), fields.broken_fraction)
    colours = colormaps["YlOrRd"](np.clip(column / FAILED_SHARE, 0.0, 1.0))[..., :3]
    colours[column < 0] = 1.0
    # from below with y upwards: x points to the left
    pixels = (255 * colours[::-1, ::-1]).astype(np.uint8)
    scale = max(1, _WIDTH_PX // max(pixels.shape[:2]))
    packed = io.BytesIO()
    Image.fromarray(pixels.repeat(scale, axis=0).repeat(scale, axis=1)).save(packed, "PNG")
    return _address(packed.getvalue(), "png")
