"""Folders that are held open: what is written into one reaches it, wherever it is renamed to.

A path is only a name. While a run goes on its folder may be renamed, or a link to it pointed
elsewhere, and another run may be started under the old name. A folder that is held is therefore
kept by its descriptor, and its files are opened, replaced and removed relative to that. Functions
of this module take paths; those directly in a held folder go through the descriptor.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from pathlib import Path

_HELD: dict[Path, int] = {}
"""Descriptors of held folders by the paths under which this process knows them."""

# Windows has no such descriptors, and renames no folder in which a file is open.
_SUPPORTED = os.open in os.supports_dir_fd and os.rename in os.supports_dir_fd


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold a folder that exists: its files are reached through its descriptor in the block."""
    if not _SUPPORTED:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    _HELD[folder] = _HELD[folder.absolute()] = descriptor
    try:
        yield
    finally:
        for path in [path for path, held in _HELD.items() if held == descriptor]:
            del _HELD[path]
        os.close(descriptor)


def identity(folder: Path | int) -> tuple[int, int]:
    """Device and inode of a folder, which tell it apart from another one of the same name."""
    found = os.stat(folder)
    return found.st_dev, found.st_ino


def current(folder: Path) -> Path:
    """Where a held folder is now: this path, or the one to which it has been renamed.

    Raises:
        OSError: it has been removed, or the system does not say where it is.
    """
    descriptor = _HELD.get(folder)
    if descriptor is None:
        return folder
    mine = identity(descriptor)
    for path in (folder, _named_by_system(descriptor)):
        with contextlib.suppress(OSError):
            if path is not None and identity(path) == mine:
                _HELD[path] = descriptor
                return path
    raise FileNotFoundError(errno.ENOENT, "the folder was removed or replaced", str(folder))


def refuse_moved(folder: Path) -> None:
    """Raise OSError where a held folder is no longer under this path.

    For what is started by the path, as other processes are.
    """
    if current(folder) != folder:
        raise OSError(f"'{folder}' was renamed or replaced; what was under way in it is ended")


def _named_by_system(descriptor: int) -> Path | None:
    """The path that the system has for a descriptor, where it tells."""
    with contextlib.suppress(OSError, ImportError):
        if sys.platform == "darwin":
            import fcntl

            name = fcntl.fcntl(descriptor, fcntl.F_GETPATH, bytes(1024))
            return Path(os.fsdecode(name.rstrip(b"\0")))
        return Path(os.readlink(f"/proc/self/fd/{descriptor}"))
    return None


def _reach(path: Path) -> tuple[str | Path, int | None]:
    """What to give to the system for a path: a name, and the folder in which it is."""
    descriptor = _HELD.get(path.parent)
    return (path, None) if descriptor is None else (path.name, descriptor)


def open_file(path: Path, mode: str) -> io.FileIO:
    """Open a file without a buffer."""
    name, folder = _reach(path)

    def opener(file: str, flags: int) -> int:
        return os.open(file, flags, 0o666, dir_fd=folder)

    return io.FileIO(os.fspath(name), mode, opener=opener)


def replace(old: Path, new: Path) -> None:
    """Rename a file within its folder, over the one that has the new name."""
    name, folder = _reach(old)
    goal, goal_folder = _reach(new)
    os.replace(name, goal, src_dir_fd=folder, dst_dir_fd=goal_folder)


def unlink(path: Path) -> None:
    """Remove a file; it may be absent."""
    name, folder = _reach(path)
    with contextlib.suppress(FileNotFoundError):
        os.unlink(name, dir_fd=folder)


def sync_folder(folder: Path) -> None:
    """Put the names in a folder on the disk, where the system can do that."""
    with contextlib.suppress(OSError):
        own = _HELD.get(folder)
        descriptor = os.open(folder, os.O_RDONLY) if own is None else own
        try:
            os.fsync(descriptor)
        finally:
            if own is None:
                os.close(descriptor)
