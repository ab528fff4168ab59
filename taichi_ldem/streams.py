"""Standard output and error that never end a command: what they show is a courtesy.

A reader may go away while a run goes on: `ldem impact ... | head`, a terminal that is closed, a
full disk under a redirected output. Nothing that a run computes may depend on it.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import select
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing_extensions import Buffer

READER_GONE = (errno.EPIPE, errno.EIO, errno.EBADF)
"""A closed pipe, a terminal that hung up, a closed descriptor: nobody is left to complain to."""


class Courtesy(io.FileIO):
    """A descriptor to which writing never fails: after the first error the rest is dropped.

    Attributes:
        lost: the first error; None as long as everything has been written.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "w", closefd=False)
        self.lost: OSError | None = None

    def write(self, data: Buffer) -> int:  # noqa: D102
        if self.lost is None:
            try:
                while (written := super().write(data)) is None:  # a full pipe that does not block
                    select.select([], [self], [])
                return written
            except OSError as error:
                self.lost = error
        return len(memoryview(data).cast("B"))


@contextlib.contextmanager
def courteous() -> Iterator[None]:
    """Let nothing that is printed in the block fail, nor text that the encoding lacks."""
    _open_closed()
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (_courtesy(stream) for stream in before)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        sys.stdout, sys.stderr = before


def _open_closed() -> None:
    """Open closed standard descriptors on nothing, or the run's own files would get their numbers.

    Native code prints to descriptor 1, whatever file that is.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free


def _courtesy(stream: Any) -> Any:
    """A stream like this one to which writing never fails; others stay."""
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8")
    # a console of Windows takes text, not bytes; what pytest or a notebook puts here stays
    if type(stream) is not io.TextIOWrapper or (sys.platform == "win32" and stream.isatty()):
        return stream
    with contextlib.suppress(OSError, ValueError):
        stream.flush()
    try:
        descriptor = stream.fileno()
    except (OSError, ValueError):
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(Courtesy(descriptor)),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


def refuse_lost() -> None:
    """Raise OSError where standard output is a command's product and could not be written.

    A reader that has read enough and gone is no error.
    """
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    lost = getattr(raw, "lost", None)
    if lost is not None and lost.errno not in READER_GONE:
        raise OSError(lost.errno, lost.strerror, "standard output")
