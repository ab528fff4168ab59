"""The file of a plate whose shape is an image, an array or a body of triangles."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.reading import refuse_special

if TYPE_CHECKING:
    from taichi_ldem.scene.specimen import Plate

LARGEST = 1 << 28
"""Bytes of a file above which it is refused."""


def content(plate: Plate) -> bytes:
    """The bytes of a plate's file, as its scene records it.

    Raises:
        SceneError: it cannot be read, is too large, or is not the one that the scene records.
    """
    file = plate.file
    assert file is not None
    where = f"plate.{plate.shape}"
    try:
        size = refuse_special(file)
        if size > LARGEST:
            raise SceneError(f"{where}: '{file}' is larger than {LARGEST >> 20} MiB")
        found = file.read_bytes()
    except DamagedFile as error:
        raise SceneError(f"{where}: {error}") from None
    except OSError as error:
        raise SceneError(f"{where}: cannot read '{file}': {error.strerror}") from None
    if plate.file_sha256 not in (None, digest(found)):
        raise SceneError(
            f"{where}: '{file}' has changed: its SHA-256 is {digest(found)[:16]}..., and the scene "
            f"records {str(plate.file_sha256)[:16]}..."
        )
    return found


def digest(data: bytes) -> str:
    """SHA-256 as text."""
    return hashlib.sha256(data).hexdigest()
