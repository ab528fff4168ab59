"""Scenes as text: TOML files, overrides of single keys, and writing back."""

import re
import warnings
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w
from pydantic import BaseModel

from taichi_ldem.errors import SceneError, SceneNote
from taichi_ldem.reading import parse_toml
from taichi_ldem.scene.messages import nearest
from taichi_ldem.scene.schema import is_list, keys_of, may_be_single, single_tables
from taichi_ldem.scene.specimen import FILES
from taichi_ldem.scene.tables import DISORDERED, Output
from taichi_ldem.scene.values import show

MAX_FILE_BYTES = 1 << 20

EXCLUSIVE: dict[tuple[str, ...], str] = {
    ("material", "failure_strain"): "failure_factor",
    ("material", "failure_factor"): "failure_strain",
    **{("plate", key): "file_sha256" for key in FILES},
    **{("disorder", f"{name}_cv"): f"{name}_data" for name in DISORDERED},
    **{("disorder", f"{name}_data"): f"{name}_cv" for name in DISORDERED},
}
"""Keys of which a table has one only: an override of one removes the other."""


class Override(NamedTuple):
    """A key of a scene, by table and name, and its new value.

    Attributes:
        repeated: whether a scene may have several tables of this name.
        single: whether one of them need not be a list.
        number: of the table among these, from 0; None where it must be the only one.
    """

    path: tuple[str, ...]
    value: object
    repeated: bool = False
    single: bool = False
    number: int | None = None

    @property
    def key(self) -> str:
        """The key as a user writes it, ``section.key`` or ``section[number].key``."""
        first, *others = self.path
        number = "" if self.number is None else f"[{self.number}]"
        return ".".join((first + number, *others))


def read_file(path: Path) -> dict[str, Any]:
    """The tables of a TOML file; names of files in it are taken from the folder that it is in.

    Raises:
        SceneError: it cannot be read, is too large or is not TOML.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except FileNotFoundError:
        raise SceneError(f"{path}: no such scene file") from None
    except IsADirectoryError:
        raise SceneError(f"{path}: is a directory, not a scene file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read: {reason}") from None
    if len(content) > MAX_FILE_BYTES:
        raise SceneError(f"{path}: larger than {MAX_FILE_BYTES >> 20} MiB, which no scene is")
    return _beside(read_toml(content, path.name), path.parent)


def _beside(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same tables, in which a file of the plate's shape has its whole path."""
    plate = data.get("plate")
    for key in FILES:
        if isinstance(plate, dict) and isinstance(plate.get(key), str) and plate[key]:
            plate[key] = str(folder.absolute() / plate[key])
    return data


def read_toml(content: bytes, name: str) -> dict[str, Any]:
    """The tables of a TOML text; `name` opens the message of SceneError where it is not TOML."""
    try:
        return parse_toml(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise SceneError(f"{name}: line {line} is not UTF-8 text") from None
    except (ValueError, RecursionError) as error:  # ValueError: also an integer of 5000 digits
        reason = "nested too deeply" if isinstance(error, RecursionError) else error
        raise SceneError(f"{name}: not valid TOML: {reason}") from None


def write_toml(data: dict[str, Any]) -> str:
    """A resolved scene's tables as the text of a TOML file."""
    return "# Resolved scene, SI units, defaults included.\n" + tomli_w.dumps(data)


def parse_overrides(texts: Sequence[str], schema: type[BaseModel]) -> list[Override]:
    """Overrides `section.key=value`, with values in TOML or as bare words.

    Raises:
        SceneError: one that has another form or names a section that the schema lacks.
    """
    return [_parse_override(text, schema) for text in texts]


def _parse_override(text: str, schema: type[BaseModel]) -> Override:
    key, equals, value = (part.strip() for part in text.partition("="))
    path = tuple(key.split("."))
    number = None
    if numbered := re.fullmatch(r"(\w+)\[(\d{1,4})\]", path[0]):
        path, number = (numbered[1], *path[1:]), int(numbered[2])
    if not equals or not all(path) or len(path) > 2 or (len(path) == 1 and key != "scenario"):
        raise SceneError(f"--set {text}: must have the form section.key=value")
    fields = keys_of(schema)
    if len(path) == 2 and path[0] not in fields:
        hint = nearest(path[0], single_tables(schema))
        raise SceneError(f"--set {text}: unknown section '{path[0]}'; {hint}")
    repeated = len(path) == 2 and is_list(fields[path[0]])
    single = repeated and may_be_single(fields[path[0]])
    if number is not None and not repeated:
        raise SceneError(f"--set {text}: a scene has one table [{path[0]}], give it no number")
    return Override(path, _parse_value(text, value), repeated, single, number)


def _parse_value(text: str, value: str) -> object:
    try:
        parsed = parse_toml(f"value = {value}")
        if parsed.keys() == {"value"}:
            return parsed["value"]
    except (ValueError, RecursionError):
        if value[:1].isalpha() and value.replace("-", "").replace("_", "").isalnum():
            return value
    raise SceneError(f"--set {text}: the value is neither TOML nor a bare word")


def apply_overrides(data: dict[str, Any], overrides: Sequence[Override]) -> dict[str, Any]:
    """The same tables, changed in place in the order of the overrides.

    Raises:
        SceneError: a section of which the scene does not have exactly one table.
    """
    for override in overrides:
        table = data
        for section in override.path[:-1]:
            empty: Any = [] if override.repeated and not override.single else {}
            table = _table_of(override, table.setdefault(section, empty))
        table[override.path[-1]] = override.value
        table.pop(EXCLUSIVE.get(override.path, ""), None)
    given = {override.path for override in overrides}
    if ("solver", "duration") in given:
        _end_earlier(data, given)
    return data


def _table_of(override: Override, table: Any) -> dict[str, Any]:
    """The table that an override is for; of tables that may be repeated, the numbered or only."""
    section, number = override.path[0], override.number
    if override.repeated and isinstance(table, list | tuple):
        count = len(table)
        if number is None and count != 1:
            hint = f"give {section}[0] to {section}[{count - 1}]" if count else "change the file"
            raise SceneError(
                f"--set {override.key}: needs a scene with one table [[{section}]], and this one "
                f"has {count}; {hint}"
            )
        if number is not None and number >= count:
            order = ", numbered from 0" if count else ""
            raise SceneError(f"--set {override.key}: this scene has {count} [[{section}]]{order}")
        table = table[number or 0]
    elif number:
        raise SceneError(f"--set {override.key}: this scene has one table [{section}]")
    if not isinstance(table, dict):
        raise SceneError(f"--set {override.key}: '{section}' is not a table")
    return table


def _end_earlier(data: dict[str, Any], given: Collection[tuple[str, ...]]) -> None:
    """Fit the scene's output to an end that an override has put before some of it, with notes.

    A short run of a scene must not ask for more overrides than that of its duration. What another
    override asks for stays as it is.
    """
    end, output = data["solver"]["duration"], data.get("output", {})
    if not _is_number(end) or not isinstance(output, dict):
        return  # refused by the checks
    whole = f"solver.duration = {show(end)}"
    times = output.get("image_times")
    if isinstance(times, list | tuple) and ("output", "image_times") not in given:
        late = [time for time in times if _is_number(time) and time > end]
        if late:
            output["image_times"] = [time for time in times if time not in late]
            _note(f"output.image_times: left out what lies after {whole}: {show(late)}")
    default = Output.model_fields["history_interval"].default
    for key, interval, shorter, text in (
        ("history_interval", output.get("history_interval", default), end, "rows"),
        ("field_interval", output.get("field_interval"), 0.0, "fields"),
    ):
        if ("output", key) not in given and _is_number(interval) and interval > end > 0:
            data["output"] = output | {key: shorter}
            output = data["output"]
            _note(
                f"output.{key} = {show(interval)} is longer than {whole}: there are {text} at the "
                "start and at the end"
            )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _note(text: str) -> None:
    warnings.warn(text, SceneNote, stacklevel=2)
