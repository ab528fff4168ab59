"""The files that give the course of a load: read with the scene, of which they become part."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.reading import read_text

LARGEST_TABLE = 1 << 20
"""Bytes of a file, as of a scene."""


def with_tables(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The tables of a scene with the values of the files that its loads name.

    Args:
        folder: of the scene file, to which the names of files are relative.

    Raises:
        SceneError: a file cannot be read, or does not hold two columns of numbers.
    """
    loads = data.get("load")
    if not isinstance(loads, list | tuple):
        return data  # none, or refused by the checks
    return data | {"load": [_read(load, n, folder) for n, load in enumerate(loads)]}


def _read(load: Any, number: int, folder: Path) -> Any:
    if not isinstance(load, dict) or not isinstance(load.get("table"), str):
        return load
    key = f"load[{number}].table"
    for other in ("times", "factors"):
        if other in load:
            raise SceneError(f"{key}: cannot be given together with load[{number}].{other}")
    times, factors = read_course(folder / load["table"], key)
    return {k: v for k, v in load.items() if k != "table"} | {"times": times, "factors": factors}


def read_course(path: Path, key: str) -> tuple[list[float], list[float]]:
    """Times (s) and factors of a CSV file of two columns, which may have a line of names above.

    Args:
        key: of the scene, which opens the message.

    Raises:
        SceneError: it cannot be read, or is no such file.
    """
    try:
        text = read_text(path)
    except DamagedFile as error:
        raise SceneError(f"{key}: {error}") from None
    if len(text) > LARGEST_TABLE:
        raise SceneError(f"{key}: '{path}' is larger than {LARGEST_TABLE >> 20} MiB")
    lines = [line for line in text.splitlines() if line.strip()]
    if lines and not _is_row(lines[0]):
        del lines[0]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of an empty file
            values = np.loadtxt(lines, delimiter=",", ndmin=2)
    except ValueError:
        values = np.zeros((0, 0))
    if values.shape[0] < 2 or values.shape[1] != 2:
        raise SceneError(
            f"{key}: '{path}' must hold at least two lines of two numbers with a comma between "
            "them: time in s, factor"
        )
    return values[:, 0].tolist(), values[:, 1].tolist()


def _is_row(line: str) -> bool:
    try:
        float(line.partition(",")[0])
    except ValueError:
        return line.lstrip().startswith("#")
    return True
