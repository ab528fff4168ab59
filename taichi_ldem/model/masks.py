"""Bodies from files: images and arrays that are extruded, voxels, and bodies of triangles.

A module belongs to the body where its centre does.
"""

import io
from typing import Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Plate
from taichi_ldem.scene.shape_file import content

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

DARK = 0.5
"""Brightness below which a pixel belongs to the body."""

DISTORTED = 0.02
"""Largest relative difference of the scales along x, y and z by which a body is made to fit."""

OFF_EDGES = (0.3719e-6, 0.6180e-6)
"""Shift of the lines along which a body is entered and left, in module edges: no line then goes
through an edge or a corner of a triangle."""


def read(plate: Plate) -> Mask:
    """(nz, ny, nx) the modules of a plate whose shape is in a file.

    Raises:
        SceneError: the file is not the one that the scene records, or describes no body.
    """
    data = content(plate)
    where = f"plate.{plate.shape}: '{plate.file}'"
    if plate.shape == "stl":
        found = _voxels(plate, data, where)
    else:
        assert plate.mask is not None
        image = plate.mask.lower().endswith(".png")
        found = sampled(_image(data, where) if image else _array(data, where), plate.modules)
    if not found.any():
        raise SceneError(f"{where}: leaves no module of the plate")
    return found


def sampled(shape: Mask, modules: tuple[int, int, int]) -> Mask:
    """(nz, ny, nx) a shape [y, x] or [z, y, x] at the centres of modules."""
    if shape.ndim == 2:
        shape = shape[None]
    places = [
        ((np.arange(n) + 0.5) * have / n).astype(int)
        for n, have in zip(modules[::-1], shape.shape, strict=True)
    ]
    return np.asarray(shape[np.ix_(*places)])


def _image(data: bytes, where: str) -> Mask:
    """[y, x] whether a pixel is dark and not transparent; the first row is that of least y."""
    from matplotlib.image import imread

    try:
        pixels = np.asarray(imread(io.BytesIO(data), format="png"), dtype=float)
    except Exception:  # what the reader of images raises is not documented
        raise SceneError(f"{where}: is not a PNG image") from None
    bright = pixels
    if pixels.ndim == 3:
        colours = pixels[..., :3] if pixels.shape[-1] > 2 else pixels[..., :1]
        bright = colours.mean(axis=-1)
        if pixels.shape[-1] in (2, 4):
            bright = np.where(pixels[..., -1] < DARK, 1.0, bright)
    return np.asarray(bright < DARK)[::-1]


def _array(data: bytes, where: str) -> Mask:
    """[y, x] or [z, y, x] whether an array is not 0."""
    try:
        found = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, OSError, EOFError):
        raise SceneError(f"{where}: is not an array of numbers (.npy)") from None
    if not isinstance(found, np.ndarray) or found.dtype.kind not in "biuf":
        raise SceneError(f"{where}: is not an array of numbers (.npy)")
    if found.ndim not in (2, 3) or 0 in found.shape:
        raise SceneError(f"{where}: has the shape {found.shape}, must be (y, x) or (z, y, x)")
    return np.asarray(found != 0)


# --- bodies of triangles --------------------------------------------------------------------------


def _voxels(plate: Plate, data: bytes, where: str) -> Mask:
    triangles = _triangles(data, where)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    scale = np.array(plate.size) / (high - low)
    if scale.max() > (1 + DISTORTED) * scale.min():
        fits = ", ".join(f"{side * scale[2]:.6g}" for side in high - low)
        raise SceneError(
            f"plate.size = {list(plate.size)}: would distort the body of '{plate.file}'; its "
            f"proportions are those of [{fits}]"
        )
    nx, ny, nz = plate.modules
    places = (triangles - low) / (high - low) * (nx, ny, nz)
    return filled(places, (nx, ny, nz))


def _triangles(data: bytes, where: str) -> Floats:
    """(n, 3, 3) corners of the triangles of a closed body."""
    try:
        import trimesh
    except ImportError:
        raise SceneError(
            'plate.shape = "stl": needs the package trimesh: pip install taichi_ldem[stl]'
        ) from None
    try:
        mesh: Any = trimesh.load(io.BytesIO(data), file_type="stl", force="mesh")
        closed, triangles = mesh.is_watertight, np.asarray(mesh.triangles, dtype=np.float64)
    except Exception:  # what the reader of meshes raises is not documented
        raise SceneError(f"{where}: is not an STL file") from None
    if not len(triangles) or not np.isfinite(triangles).all():
        raise SceneError(f"{where}: has no triangles")
    if not closed:
        raise SceneError(f"{where}: is not closed, so that it has no inside; mend the mesh first")
    return triangles


def filled(triangles: Floats, modules: tuple[int, int, int]) -> Mask:
    """(nz, ny, nx) the modules whose centre lies within a closed body.

    A line along z through the centres of a column of modules enters the body and leaves it again
    at each triangle that it goes through.

    Args:
        triangles: (n, 3, 3) corners x, y, z in module edges, from a corner of the prism.
    """
    nx, ny, nz = modules
    crossed = np.zeros((nz + 1, ny, nx), dtype=np.int64)
    for corners in triangles:
        flat = corners[:, :2] - OFF_EDGES
        low = np.maximum(np.ceil(flat.min(axis=0) - 0.5), 0).astype(int)
        high = np.minimum(np.floor(flat.max(axis=0) - 0.5), (nx - 1, ny - 1)).astype(int)
        if (low > high).any():
            continue
        x = np.arange(low[0], high[0] + 1) + 0.5 - flat[0, 0]
        y = (np.arange(low[1], high[1] + 1) + 0.5 - flat[0, 1])[:, None]
        (ax, ay), (bx, by) = flat[1] - flat[0], flat[2] - flat[0]
        area = ax * by - ay * bx
        if area == 0:  # seen edge-on
            continue
        first, second = (x * by - y * bx) / area, (y * ax - x * ay) / area
        inside = (first >= 0) & (second >= 0) & (first + second <= 1)
        height = corners[0, 2] + first * (corners[1, 2] - corners[0, 2])
        height = height + second * (corners[2, 2] - corners[0, 2])
        j, i = np.nonzero(inside)
        layer = np.clip(np.ceil(height[j, i] - 0.5), 0, nz).astype(int)
        np.add.at(crossed, (layer, j + low[1], i + low[0]), 1)
    return np.asarray(np.cumsum(crossed, axis=0)[:nz] % 2 == 1)
