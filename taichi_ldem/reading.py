"""Reads files that this program wrote, and that may have been damaged or edited since.

What cannot be read is refused in one line with the file's name. Nothing is read before it is known
to be a regular file that fits into the memory: a FIFO would wait for ever, and a device might never
end.
"""

from __future__ import annotations

import json
import math
import os
import re
import stat
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichi_ldem.errors import DamagedFile
from taichi_ldem.machine import available_bytes

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MOST_DIGITS = 300
"""Digits of a whole number, beyond which no floating-point number is as large."""
SMALL = 1 << 24
"""Bytes of a file or an array that every machine has."""
MOST_LEVELS = 32
"""Levels of tables and lists within each other."""


def refuse_special(path: Path) -> int:
    """The size of a file, bytes.

    Raises:
        DamagedFile: it is not there, is no regular file, or is larger than the memory.
    """
    try:
        found = path.stat()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DamagedFile(f"cannot read '{path}': {reason}") from None
    if not stat.S_ISREG(found.st_mode):
        what = "a folder" if stat.S_ISDIR(found.st_mode) else "a pipe or a device"
        raise DamagedFile(f"cannot read '{path}': it is {what}, not a file")
    refuse_large(found.st_size, path)
    return found.st_size


def refuse_large(size: int, path: Path) -> None:
    """Raise DamagedFile where so many bytes of a file do not fit into the memory."""
    free = available_bytes() if size > SMALL else None  # asking takes longer than reading little
    if free is not None and size > free / 2:
        raise DamagedFile(
            f"cannot read '{path}': {size:,} bytes, and {free:,} bytes of memory are available"
        )


def read_bytes(path: Path) -> bytes:
    """The content of a regular file.

    Raises:
        DamagedFile: it cannot be read.
    """
    refuse_special(path)
    try:
        # it may have been replaced since: without this flag, opening a FIFO waits
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY)
        with open(descriptor, "rb") as file:
            return file.read()
    except OSError as error:
        raise DamagedFile(f"cannot read '{path}': {error.strerror}") from None


_BINARY = getattr(os, "O_BINARY", 0)


def read_text(path: Path) -> str:
    """The text of a file in UTF-8, without the mark that some editors put before it.

    Raises:
        DamagedFile: it cannot be read, or is no such text.
    """
    content = read_bytes(path)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DamagedFile(f"cannot read '{path}': line {line} is not UTF-8 text") from None


def read_json(path: Path) -> Any:
    """The content of a JSON file; every number in it is finite, and every text can be written.

    Raises:
        DamagedFile: it cannot be read, or is no such JSON.
    """
    text = read_text(path)
    try:
        return parse_json(text)
    except ValueError as error:
        raise DamagedFile(f"cannot read '{path}': {error}") from None


def read_object(path: Path) -> dict[str, Any]:
    """The object that a JSON file holds; DamagedFile as ``read_json``, and for anything else."""
    found = read_json(path)
    if not isinstance(found, dict):
        raise DamagedFile(f"cannot read '{path}': it does not hold a table of values")
    return found


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        DamagedFile: it cannot be read, or is no such TOML.
    """
    text = read_text(path)
    try:
        found = parse_toml(text)
        _refuse_odd(found)
    except RecursionError:
        raise DamagedFile(f"cannot read '{path}': nested too deeply") from None
    except ValueError as error:
        raise DamagedFile(f"cannot read '{path}': {error}") from None
    return found


def parse_json(text: str) -> Any:
    """What a JSON text holds, as ``read_json`` returns it; ValueError for any other text."""
    try:
        found = json.loads(text, parse_int=_whole, parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    _refuse_odd(found)
    return found


_LONG_KEY = re.compile(
    r"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){32}""", re.ASCII
)


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text, in a time that grows with its length.

    Raises:
        ValueError: it is not TOML, or a key has more than 32 parts: the parser's time grows with
            the square of their number.
        RecursionError: it is nested too deeply.
    """
    long = _LONG_KEY.search(text)
    if long is not None:
        line = text.count("\n", 0, long.start()) + 1
        raise ValueError(f"a key of more than 32 parts (at line {line})")
    return tomllib.loads(text)


def _whole(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise ValueError(f"a whole number of {len(text)} digits")
    return int(text)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]} is not a finite number")
    return value


def _refuse_odd(value: Any) -> None:
    """Raise ValueError for what no program can write or compute with.

    That is half of a character, a number that is too large or not finite, a date, or what is nested
    so deeply that functions that call themselves do not reach its end.
    """
    left = [(value, 0)]
    while left:
        item, depth = left.pop()
        if depth > MOST_LEVELS:
            raise ValueError("nested too deeply")
        if isinstance(item, dict):
            left += [(part, depth + 1) for pair in item.items() for part in pair]
        elif isinstance(item, list):
            left += [(part, depth + 1) for part in item]
        elif isinstance(item, str):
            if not item.isascii() and any("\ud800" <= letter <= "\udfff" for letter in item):
                raise ValueError("a text holds half of a character (a lone surrogate)")
        elif isinstance(item, float):
            _finite(repr(item))
        elif isinstance(item, int):
            if item.bit_length() > 3 * MOST_DIGITS:
                raise ValueError("a whole number of hundreds of digits")
        elif item is not None:
            raise ValueError(f"{item!s} is neither a number nor a text")


class Named(dict[str, Any]):
    """Values of a file by name; what it lacks is named together with the file.

    Args:
        path: of the file.
        kind: what its values are called, e.g. "column".
    """

    def __init__(self, path: Path, kind: str, values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self.path, self.kind = path, kind

    def __missing__(self, key: str) -> Any:
        raise DamagedFile(f"'{self.path}' has no {self.kind} '{key}'")
