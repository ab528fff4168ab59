"""The copy of a plate's shape in the run folder, so that the folder is enough to run again."""

from pathlib import Path

from taichi_ldem.scene import Scene, scene_to_toml
from taichi_ldem.scene.shape_file import content
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.folder import RunFolder


def read(scene: Scene) -> bytes | None:
    """The file of a scene's shape; None where it has none.

    It is read before a folder is emptied, in which it may lie.

    Raises:
        SceneError: it cannot be read, or is not the one that the scene records.
    """
    return None if scene.plate.file is None else content(scene.plate)


def write_scene(folder: RunFolder, scene: Scene, shape: bytes | None = None) -> None:
    """Write a run's scene, with a copy of its shape's file beside it.

    Args:
        shape: contents of the file; None: the scene has none, or the copy is there already.
    """
    file = scene.plate.file
    if file is not None:
        copy = "body" + Path(file).suffix.lower()
        if shape is not None:
            write_whole(folder.path / copy, shape)
        plate = scene.plate.model_copy(update={scene.plate.shape: copy})
        scene = scene.model_copy(update={"plate": plate})
    folder.write_scene(scene_to_toml(scene))
