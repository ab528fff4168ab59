"""Files of a folder, damaged in the ways that disks, editors and people damage them."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

Rng = np.random.Generator
ODD_JSON = (
    "NaN",
    "-Infinity",
    "1e999",
    "9" * 400,
    '"text"',
    '"\\ud800"',
    "null",
    "true",
    "[]",
    "{}",
)
ODD_JSON += ("-1", "0", "1e300", "5e-324", "[" * 2000 + "]" * 2000, '{"a": [1, "x"]}', "[1, [2]]")
ODD_CELLS = (
    "nan",
    "inf",
    "-inf",
    "",
    "x",
    "1e999",
    "9" * 400,
    "0",
    "-1",
    "1e29",
    "1e300",
    "5e-324",
)
ODD_TOML = (
    "nan",
    "inf",
    "''",
    "'x'",
    "[]",
    "{}",
    "-1",
    "0",
    "9" * 400,
    "1979-05-27",
    "true",
    "1e300",
)


def damage(path: Path, rng: Rng) -> None:
    """Damage a file in one of many ways."""
    kinds: list[Callable[[Path, Rng], None]] = [special, raw, raw]
    own = {
        ".json": [json_value] * 5,
        ".csv": [cell, cell, cell, column, rows],
        ".toml": [toml_value] * 4,
        ".vtkhdf": [structure] * 6,
        ".h5": [raw],
    }
    kinds += own.get(path.suffix, [])  # type: ignore[arg-type]
    kinds[rng.integers(len(kinds))](path, rng)


def special(path: Path, rng: Rng) -> None:
    """Something else in the file's place, or nothing."""
    path.unlink()
    kind = rng.integers(6)
    if kind == 0:
        os.mkfifo(path)
    elif kind == 1:
        path.mkdir()
    elif kind == 2:
        path.symlink_to("/dev/zero")
    elif kind == 3:
        path.symlink_to("nowhere")
    elif kind == 4:
        path.touch()


def raw(path: Path, rng: Rng) -> None:
    """Bytes changed, cut off or put in."""
    content = path.read_bytes()
    at, size = int(rng.integers(len(content) + 1)), int(rng.integers(1, 40))
    noise = rng.integers(0, 256, size, dtype=np.uint8).tobytes()
    path.write_bytes(
        (
            content[:at],
            content[:at] + noise + content[at + size :],
            content[:at] + noise + content[at:],
            b"\xef\xbb\xbf" + content,
            content.replace(b"\n", b"\r\n"),
            content + content,
        )[rng.integers(6)]
    )


def json_value(path: Path, rng: Rng) -> None:
    """A value of a JSON file changed, taken out or renamed."""
    root = json.loads(path.read_text())
    places: list[tuple[dict | list, str | int]] = []
    left = [root]
    while left:
        item = left.pop()
        inner = list(item.items()) if isinstance(item, dict) else list(enumerate(item))
        places += [(item, key) for key, _ in inner]
        left += [value for _, value in inner if isinstance(value, dict | list)]
    if not places or rng.random() < 0.03:
        path.write_text(ODD_JSON[rng.integers(len(ODD_JSON))])
        return
    parent, key = places[rng.integers(len(places))]
    kind = rng.integers(8)
    if kind == 0:
        del parent[key]  # type: ignore[arg-type]
    elif kind == 1 and isinstance(parent, dict):
        parent[f"{key}x"] = parent.pop(str(key))
    else:
        parent[key] = "@@@"  # type: ignore[index,call-overload]
    text = json.dumps(root, indent=2)
    path.write_text(text.replace('"@@@"', ODD_JSON[rng.integers(len(ODD_JSON))]))


def cell(path: Path, rng: Rng) -> None:
    """A cell of a table changed."""
    lines = path.read_text().splitlines()
    at = int(rng.integers(len(lines)))
    cells = lines[at].split(",")
    cells[rng.integers(len(cells))] = ODD_CELLS[rng.integers(len(ODD_CELLS))]
    lines[at] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")


def column(path: Path, rng: Rng) -> None:
    """A column of a table taken out, or filled with one value."""
    table = [line.split(",") for line in path.read_text().splitlines()]
    at, kind = int(rng.integers(len(table[0]))), rng.integers(3)
    for number, row in enumerate(table):
        if len(row) <= at:
            continue
        if kind == 0:
            del row[at]
        elif kind == 1 and number:
            row[at] = ODD_CELLS[rng.integers(len(ODD_CELLS))] if number == 1 else table[1][at]
        elif kind == 2:
            row.append(row[at])
    path.write_text("\n".join(map(",".join, table)) + "\n")


def rows(path: Path, rng: Rng) -> None:
    """Rows of a table taken out, doubled or in another order."""
    lines = path.read_text().splitlines()
    at, kind = int(rng.integers(len(lines))), rng.integers(4)
    if kind == 0:
        lines = lines[: int(rng.integers(0, 4))]
    elif kind == 1:
        lines.insert(at, lines[at])
    elif kind == 2:
        lines = [lines[0], *lines[:0:-1]]
    else:
        del lines[at]
    path.write_text("\n".join(lines) + "\n")


def toml_value(path: Path, rng: Rng) -> None:
    """A line of a TOML file changed."""
    lines = path.read_text().splitlines()
    at = int(rng.integers(len(lines)))
    key, equals, _ = lines[at].partition("=")
    if equals and rng.random() < 0.8:
        lines[at] = f"{key}= {ODD_TOML[rng.integers(len(ODD_TOML))]}"
    else:
        del lines[at]
    path.write_text("\n".join(lines) + "\n")


def structure(path: Path, rng: Rng) -> None:
    """A dataset or an attribute of an HDF5 file changed."""
    with h5py.File(path, "r+", locking=False) as file:
        names: list[str] = []
        file.visit(names.append)
        name = names[rng.integers(len(names))]
        kind = rng.integers(9)
        if kind == 0 and "VTKHDF/Steps" in file:
            steps = file["VTKHDF/Steps"].attrs
            steps["NSteps"] = (-1, 0, 10**6, np.nan, "x", np.arange(3))[rng.integers(6)]
        elif kind == 1:
            del file[name]
        elif kind == 2:
            del file[name]
            file[name] = (
                h5py.SoftLink("/VTKHDF"),
                h5py.ExternalLink("/dev/zero", "/"),
                h5py.SoftLink("/nowhere"),
            )[rng.integers(3)]
        elif isinstance(file[name], h5py.Dataset):
            _change(file, name, int(kind), rng)


def _change(file: h5py.File, name: str, kind: int, rng: Rng) -> None:
    values = file[name][()]
    if kind == 3:
        values = values[: rng.integers(len(values) + 1)]
    elif kind == 4:
        values = np.concatenate([values, values])
    elif kind == 5:
        values = values.astype([np.float16, np.int8, np.complex64, "S4", bool][rng.integers(5)])
    elif kind == 6:
        values = values.ravel() if values.ndim > 1 else values[:, None]
    elif values.size:
        odd = (np.nan, np.inf, -1, 1e30, 255, 0, 1e9, -1e9)
        with np.errstate(all="ignore"):
            at = rng.integers(values.size, size=1 if kind == 7 else values.size)
            values.ravel()[at] = np.array(odd[rng.integers(len(odd))]).astype(values.dtype)
    del file[name]
    if kind == 8 and values.ndim and rng.random() < 0.3:
        values_shape = (10**12, *values.shape[1:])
        file.create_dataset(name, shape=values_shape, chunks=(1024, *values.shape[1:]), dtype="f8")
        return
    file.create_dataset(name, data=values, maxshape=(None, *values.shape[1:]))
