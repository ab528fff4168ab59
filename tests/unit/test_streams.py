"""Printing never ends a command: a reader that went away, a full disk, a closed descriptor."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_ldem.streams import Courtesy, courteous, refuse_lost


def _stream(descriptor: int) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.FileIO(descriptor, "w", closefd=False), encoding="utf-8")


def test_a_pipe_without_a_reader_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """What `| head` leaves."""
    read, write = os.pipe()
    os.close(read)
    before = _stream(write)
    monkeypatch.setattr(sys, "stdout", before)
    with courteous():
        for _ in range(3):
            print("t = 0.1 ms", flush=True)
        refuse_lost()  # who has read enough has lost nothing
    assert sys.stdout is before
    with pytest.raises(BrokenPipeError):
        print("as before", flush=True)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full")
def test_a_full_disk_ends_no_run_and_a_product_that_is_lost_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with open("/dev/full", "wb") as full:
        monkeypatch.setattr(sys, "stdout", _stream(full.fileno()))
        with courteous():
            print("progress", flush=True)
            with pytest.raises(OSError, match="No space left on device: 'standard output'"):
                refuse_lost()


def test_names_that_are_no_text_can_be_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    read, write = os.pipe()
    monkeypatch.setattr(sys, "stdout", _stream(write))
    with courteous():
        print(os.fsdecode(b"run\xff"))
    os.close(write)
    with open(read, "rb") as text:
        assert text.read() == b"run\\udcff\n"


def test_a_full_pipe_that_does_not_block_is_waited_for() -> None:
    read, write = os.pipe()
    os.set_blocking(write, False)
    stream = Courtesy(write)
    size = 1 << 17
    child = subprocess.Popen(["wc", "-c"], stdin=read, stdout=subprocess.PIPE)
    os.close(read)
    left = size
    while left:
        left -= stream.write(b"x" * left)
    os.close(write)
    assert int(child.communicate()[0]) == size
    assert stream.lost is None


def test_closed_standard_descriptors_lead_to_nothing() -> None:
    code = (
        "import os, sys\n"
        "from taichi_ldem.streams import courteous\n"
        "with courteous():\n"
        "    print('unread'); print('unread', file=sys.stderr)\n"
        "    assert os.fstat(1).st_rdev == os.stat(os.devnull).st_rdev\n"
    )
    close = 'exec "$0" -c "$1" >&- 2>&-'
    assert subprocess.run(["sh", "-c", close, sys.executable, code], check=False).returncode == 0
