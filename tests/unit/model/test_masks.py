"""Bodies from images, arrays and triangles."""

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.blocks import block_scene

from taichi_ldem.errors import SceneError
from taichi_ldem.model import masks, outlines
from taichi_ldem.scene import Scene


def _scene(file: Path, shape: str = "mask", size: tuple[int, int, int] = (12, 8, 2)) -> Scene:
    return block_scene(*size, plate={"shape": shape, shape: str(file)})


def _png(path: Path, pixels: np.ndarray) -> Path:
    from matplotlib.image import imsave

    imsave(path, pixels, format="png")
    return path


def test_dark_pixels_are_the_body_and_the_first_row_is_at_the_top(tmp_path: Path) -> None:
    pixels = np.ones((8, 12, 4))
    pixels[:3, :5, :3] = 0.1  # dark in the upper left corner
    pixels[6:, 9:, :3] = 0.2
    pixels[6:, 9:, 3] = 0.0  # dark but transparent
    mask = outlines.body(_scene(_png(tmp_path / "body.png", pixels)))
    expected = np.zeros((8, 12), dtype=bool)
    expected[5:, :5] = True
    np.testing.assert_array_equal(mask, [expected, expected])


def test_an_image_is_stretched_to_the_sides_of_the_plate(tmp_path: Path) -> None:
    y, x = np.mgrid[-1:1:400j, -1:1:600j]
    pixels = np.where(np.hypot(x, y) < 0.8, 0.0, 1.0)
    grey = np.dstack([pixels, pixels, pixels])
    mask = outlines.body(_scene(_png(tmp_path / "body.PNG", grey), size=(48, 32, 1)))
    assert mask.mean() == pytest.approx(np.pi * 0.8**2 / 4, rel=0.02)


def test_an_array_counts_upwards_along_all_axes(tmp_path: Path) -> None:
    flat = np.zeros((8, 12))
    flat[0, :3] = -2.5
    np.save(tmp_path / "flat.npy", flat)
    mask = outlines.body(_scene(tmp_path / "flat.npy"))
    assert mask[:, 0, :3].all()
    assert mask.sum() == 6
    solid = np.zeros((2, 4, 6), dtype=np.uint8)
    solid[1, 3, 5] = 1
    np.save(tmp_path / "solid.npy", solid)
    mask = outlines.body(_scene(tmp_path / "solid.npy"))
    assert mask[1, 6:, 10:].all()
    assert mask.sum() == 4


def _sphere(rings: int = 24) -> np.ndarray:
    """(n, 3, 3) triangles of a ball of diameter 1 around the middle of the unit cube."""
    polar = np.linspace(0, np.pi, rings + 1)
    around = np.linspace(0, 2 * np.pi, 2 * rings + 1)
    t, p = np.meshgrid(polar, around, indexing="ij")
    grid = 0.5 + 0.5 * np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    both = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)])
    return np.asarray(both.reshape(-1, 3, 3))


def _box(low: float, high: float) -> np.ndarray:
    """(12, 3, 3) triangles of a cube."""
    found = []
    for axis in range(3):
        for side in (low, high):
            square = np.array([(low, low), (high, low), (high, high), (low, high)])
            corners = np.insert(square, axis, side, axis=1)
            found += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.array(found)


def test_a_ball_of_triangles_is_filled() -> None:
    count = 24
    mask = masks.filled(count * _sphere(), (count, count, count))
    axes = np.arange(count) + 0.5 - count / 2
    z, y, x = np.meshgrid(axes, axes, axes, indexing="ij")
    radius = np.sqrt(x**2 + y**2 + z**2)
    assert mask[radius < 0.97 * count / 2].all()
    assert not mask[radius > count / 2].any()


def test_a_hollow_box_keeps_its_hollow() -> None:
    """Its faces go through centres of modules, and the edges of its triangles do."""
    triangles = np.concatenate([_box(0.0, 8.0), _box(2.5, 5.5)])
    mask = masks.filled(triangles, (8, 8, 8))
    assert mask.sum() == 8**3 - 3**3
    assert not mask[3:5, 3:5, 3:5].any()


def _stl(triangles: np.ndarray) -> bytes:
    """A binary STL file."""
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    data = np.zeros(len(triangles), dtype=facet)
    data["corners"] = triangles
    return bytes(80) + np.uint32(len(triangles)).tobytes() + data.tobytes()


def test_an_stl_body_fills_the_plate_s_box(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    file = tmp_path / "box.stl"
    file.write_bytes(_stl(25.4 * _box(-3.0, 5.0)))  # in any unit, anywhere
    scene = _scene(file, "stl", (8, 8, 8))
    assert outlines.body(scene).all()
    file.write_bytes(_stl(_box(-3.0, 5.0)[:-1]))
    with pytest.raises(SceneError, match=r"is not closed, so that it has no inside"):
        outlines.body(_scene(file, "stl", (8, 8, 8)))
    file.write_bytes(_stl(_box(0.0, 1.0)))
    with pytest.raises(SceneError, match=r"plate\.size = .* proportions are those of \[0.001, "):
        outlines.body(_scene(file, "stl", (12, 8, 2)))


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    (tmp_path / "box.stl").write_bytes(_stl(_box(0.0, 1.0)))
    with pytest.raises(SceneError, match=r"pip install taichi_ldem\[stl\]"):
        outlines.body(_scene(tmp_path / "box.stl", "stl", (4, 4, 4)))


def _npy(values: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values, allow_pickle=True)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("body.png", b"no image", "is not a PNG image"),
        ("body.npy", b"no array", "is not an array of numbers"),
        ("body.npy", _npy(np.array([{}])), "is not an array of numbers"),
        ("body.npy", _npy(np.ones(5)), r"has the shape \(5,\), must be \(y, x\) or \(z, y, x\)"),
        ("body.npy", _npy(np.zeros((4, 4))), "leaves no module of the plate"),
    ],
)
def test_bad_files_are_refused_in_one_line(
    tmp_path: Path, name: str, data: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(SceneError, match=rf"plate\.mask: '.*{name}': {message}"):
        outlines.body(_scene(tmp_path / name))
