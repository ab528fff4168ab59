"""The file of a plate's shape: where it is looked for, and how it is known again."""

import os
from pathlib import Path

import numpy as np
import pytest
from support.blocks import block_scene

from taichi_ldem.errors import SceneError
from taichi_ldem.model import outlines
from taichi_ldem.scene import Scene, load_scene, scene_to_toml
from taichi_ldem.storage import plate_shape
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.provenance import scene_hash, unequal


def _scene(folder: Path) -> Scene:
    """A plate of 6 x 4 modules, as in a file beside its scene."""
    array = np.ones((4, 6))
    array[0, 0] = 0
    np.save(folder / "body.npy", array)
    plain = block_scene(6, 4, 1)
    text = scene_to_toml(plain).replace('shape = "rectangle"', 'shape = "mask"\nmask = "body.npy"')
    (folder / "scene.toml").write_text(text)
    return load_scene(folder / "scene.toml")


def test_a_file_is_looked_for_beside_its_scene(tmp_path: Path) -> None:
    scene = _scene(tmp_path)
    assert Path.cwd() != tmp_path
    assert scene.plate.mask == str(tmp_path / "body.npy")
    assert outlines.body(scene).sum() == 23
    assert scene.plate.file_sha256 is not None
    assert len(scene.plate.file_sha256) == 64


def test_another_file_of_the_same_name_is_refused(tmp_path: Path) -> None:
    scene = _scene(tmp_path)
    np.save(tmp_path / "body.npy", np.ones((4, 6)))
    with pytest.raises(SceneError, match=r"plate\.mask: '.*body\.npy' has changed: its SHA-256 is"):
        outlines.body(scene)
    # the scene does not record a file that it is asked for anew
    assert outlines.body(scene.changed(f"plate.mask='{tmp_path}/body.npy'")).all()


def test_a_run_folder_keeps_the_file(tmp_path: Path) -> None:
    given, kept = tmp_path / "given", tmp_path / "kept"
    given.mkdir()
    scene = _scene(given)
    folder = RunFolder.create(kept, force=False)
    plate_shape.write_scene(folder, scene, plate_shape.read(scene))
    (given / "body.npy").unlink()
    moved = RunFolder(kept.rename(tmp_path / "moved"))
    again = moved.read_scene()
    assert outlines.body(again).sum() == 23
    # it is known by its contents, wherever it lies
    assert scene_hash(again) == scene_hash(scene)
    assert not list(unequal(again, scene, ()))
    assert "body.npy" in moved._record()["files"]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"shape": "mask"}, r'plate\.shape = "mask": needs plate\.mask, the name of a file'),
        ({"mask": "a.png"}, r'plate\.mask = "a\.png": is for plate\.shape = "mask" only'),
        ({"shape": "mask", "mask": "a.bmp"}, r"must end in \.png or \.npy"),
        ({"shape": "stl", "stl": "a.obj"}, r"must end in \.stl"),
        ({"shape": "mask", "mask": "none.png"}, r"plate\.mask: cannot read 'none\.png': No such"),
        ({"file_sha256": "0"}, r'is for plate\.shape = "mask" or "stl" only'),
    ],
)
def test_bad_keys_are_refused_in_one_line(keys: dict[str, str], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        block_scene(6, 4, 1, plate=keys)


def test_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.png")
    with pytest.raises(SceneError, match="is a pipe or a device, not a file"):
        block_scene(6, 4, 1, plate={"shape": "mask", "mask": str(tmp_path / "a.png")})
