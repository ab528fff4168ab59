"""Files that survive a kill, a full disk and a second process.

A kill may come between any two system calls. A file that is replaced is therefore written beside
the old one and renamed; a file that grows gets its new end first, which no reader looks at yet, and
then the few bytes in the old part that lead to it.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import h5py
from filelock import BaseFileLock, FileLock, Timeout

from taichi_ldem.errors import SceneError
from taichi_ldem.storage import place

if TYPE_CHECKING:
    from typing_extensions import Buffer

LOCK = "run.lock"
_NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)
# A kill cuts a write at the end of a page: the nodes of HDF5's indexes must not cross one.
_ALIGNED = {"alignment_threshold": 2048, "alignment_interval": 4096}
_END_OF_FILE = 40
"""Where the superblock (version 0, HDF5's default) holds the address of the end of file."""
TEMPORARY = ".tmp"


def write_whole(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Write a file whole or not at all; an old one stays until the new one is on the disk.

    Args:
        sync: wait until it is on the disk; False for many files that can be made again.

    Raises:
        OSError: it could not be written; what had been written is removed.
    """
    temporary = path.with_name(path.name + TEMPORARY)
    try:
        with place.open_file(temporary, "wb") as file:
            _write_all(file, content, 0)
            if sync:
                os.fsync(file.fileno())
        place.replace(temporary, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            place.unlink(temporary)
        raise _named(error, path) from None
    if sync:
        place.sync_folder(path.parent)


def _write_all(file: io.FileIO, content: bytes, at: int) -> None:
    """Write until all is written: a full disk takes a part first, and then complains."""
    view = memoryview(content)
    file.seek(at)
    while len(view):
        done = file.write(view)
        if not done:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        view = view[done:]


def _named(error: OSError, path: Path) -> OSError:
    """The same error with the file's name, which errors of bare descriptors lack."""
    number = error.errno or errno.EIO
    return OSError(number, os.strerror(number), str(path))


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder for this process; the system releases the lock however the process ends.

    What this process writes into the folder stays in it, wherever it is renamed to. On a file
    system that has no locks the folder is not locked.

    Raises:
        SceneError: another process holds the folder.
    """
    lock = _take(folder)
    try:
        if lock is not None:
            _write_holder(folder, f"process {os.getpid()} on {socket.gethostname()}\n")
        with place.held(folder):
            yield
    finally:
        if lock is not None:
            lock.release()


def refuse_locked(folder: Path) -> None:
    """Raise SceneError where another process holds a folder; the folder stays as it is."""
    if (folder / LOCK).is_file():
        lock = _take(folder)
        if lock is not None:
            lock.release()


def _take(folder: Path) -> BaseFileLock | None:
    """The lock of a folder, acquired; None on a file system that has no locks."""
    holder = _read_holder(folder)
    lock = FileLock(folder / LOCK, timeout=0, thread_local=False)
    try:
        lock.acquire()
    except Timeout:
        if not _read_holder(folder):  # some versions of filelock empty the file first
            _write_holder(folder, holder)
        holder = holder.strip() or "another process"
        raise SceneError(f"run folder '{folder}' is in use by {holder}") from None
    except NotImplementedError:
        return None
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return None
        raise
    return lock


# The holder's name begins at the second byte: on Windows a lock denies others the first one.


def _read_holder(folder: Path) -> str:
    if not (folder / LOCK).is_file():  # a FIFO would wait for a writer
        return ""
    with contextlib.suppress(OSError), open(folder / LOCK, "rb", buffering=0) as file:
        file.seek(1)
        return file.read(200).decode("utf-8", "replace")
    return ""


def _write_holder(folder: Path, holder: str) -> None:
    with contextlib.suppress(OSError), open(folder / LOCK, "r+b", buffering=0) as file:
        file.truncate(1)
        file.seek(1)
        file.write(holder.encode())


class Appending:
    """A text file that grows line by line; each is on its way to the disk when ``append`` returns.

    Raises:
        OSError: the disk is full, or the file has been removed meanwhile (writes to a removed file
            would succeed, and be lost).
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = place.open_file(path, "r+b")
        self._end = os.fstat(self._file.fileno()).st_size

    def append(self, text: str) -> None:
        """Add text; after an error a part of it may stand there, without its line end."""
        content = text.encode()
        try:
            if os.fstat(self._file.fileno()).st_nlink == 0:
                raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
            _write_all(self._file, content, self._end)
        except OSError as error:
            raise _named(error, self._path) from None
        self._end += len(content)

    def sync(self) -> None:
        """Put all of it on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file; nothing is pending."""
        self._file.close()


class Patch(io.RawIOBase):
    """A file for HDF5 whose changes stay in memory until ``commit`` writes them in a safe order.

    HDF5 writes a file's index and its end of file in an order of its own, and does not survive an
    error in between: here it never sees one.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = place.open_file(path, "r+b")
        self._size = os.fstat(self._file.fileno()).st_size
        # not its size: after a kill there may be bytes behind the end that HDF5 knows
        self._file.seek(_END_OF_FILE)
        self._old = min(self._size, int.from_bytes(self._file.read(8) or b"", "little"))
        self._at = 0
        self._writes: list[tuple[int, bytes]] = []

    def readable(self) -> bool:  # noqa: D102
        return True

    def writable(self) -> bool:  # noqa: D102
        return True

    def seekable(self) -> bool:  # noqa: D102
        return True

    def tell(self) -> int:  # noqa: D102
        return self._at

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:  # noqa: D102
        self._at = offset + (0, self._at, self._size)[whence]
        return self._at

    def truncate(self, size: int | None = None) -> int:  # noqa: D102
        self._size = self._at if size is None else size
        return self._size

    def readinto(self, buffer: Buffer) -> int:  # noqa: D102
        view = memoryview(buffer).cast("B")
        count = max(0, min(len(view), self._size - self._at))
        self._file.seek(self._at)
        old = self._file.read(count) or b""
        view[: len(old)] = old
        view[len(old) : count] = bytes(count - len(old))
        for start, content in self._writes:
            low, high = max(start, self._at), min(start + len(content), self._at + count)
            if low < high:
                view[low - self._at : high - self._at] = content[low - start : high - start]
        self._at += count
        return count

    def write(self, data: Buffer) -> int:  # noqa: D102
        content = bytes(data)
        self._writes.append((self._at, content))
        self._at += len(content)
        self._size = max(self._size, self._at)
        return len(content)

    def commit(self) -> None:
        """Write what lies beyond the old end, then the file's head, then the rest of the old part.

        After a kill the file is as before, or its head (HDF5's superblock, which says how long the
        file is) admits an end that nothing points to yet, or some datasets are longer than the
        count of steps says.
        """
        new = [(max(at, self._old), data[max(0, self._old - at) :]) for at, data in self._writes]
        old = [(at, data[: max(0, self._old - at)]) for at, data in self._writes]
        try:
            for at, data in new:
                _write_all(self._file, data, at)
            if self._size > os.fstat(self._file.fileno()).st_size:
                self._file.truncate(self._size)
            os.fsync(self._file.fileno())
            for at, data in sorted(old, key=lambda write: write[0] > 0):
                _write_all(self._file, data, at)
            os.fsync(self._file.fileno())
        except OSError as error:
            raise _named(error, self._path) from None

    def close(self) -> None:
        """Forget what has not been committed."""
        self._file.close()
        super().close()


@contextlib.contextmanager
def patched(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file to be changed; what the block does is written when it ends well."""
    with Patch(path) as patch:
        with h5py.File(patch, "r+", **_ALIGNED) as file:
            yield file
        patch.commit()


@contextlib.contextmanager
def created(path: Path) -> Iterator[h5py.File]:
    """A new HDF5 file, written whole when the block ends well."""
    image = MemoryFile()
    with image as file:
        yield file
    write_whole(path, image.content)


class MemoryFile:
    """An HDF5 file in memory; ``content`` holds its bytes after the block."""

    content: bytes = b""

    def __enter__(self) -> Any:
        self._bytes = io.BytesIO()
        self._file = h5py.File(self._bytes, "w", **_ALIGNED)
        return self._file

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
        self.content = self._bytes.getvalue()
