"""The reference of scene keys, ``docs/scene-keys.md``, made from the schema.

python -m taichi_ldem.scene.reference docs/scene-keys.md
"""

from __future__ import annotations

import sys
import types
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from taichi_ldem.scene import Scene
from taichi_ldem.scene.schema import is_list, keys_of, limits_of, may_be_single, table_of
from taichi_ldem.scene.values import OneOf

HEAD = """# Scene keys

<!-- Made by: python -m taichi_ldem.scene.reference docs/scene-keys.md (a test compares) -->

SI units everywhere. The plate is centred at x = y = 0 with its bottom at z = 0; the striker comes
from above. A table or key that a scene leaves out is a feature that is neither allocated nor
compiled; unknown keys are refused. On the command line `--set section.key=value` overrides the
file. `ldem info SCENE.toml` says what a scene implies.

"""


def reference() -> str:
    """The page, Markdown."""
    parts = [HEAD, "## Top\n\n"]
    simple = {n: f for n, f in keys_of(Scene).items() if table_of(f) is None}
    parts.append(_rows(simple.items()))
    for name, field in keys_of(Scene).items():
        table = table_of(field)
        if table is None:
            continue
        several = is_list(field) and not may_be_single(field)
        title = f"[[{name}]]" if several else f"[{name}]"
        needed = "needed" if field.is_required() else "may be left out"
        about = " ".join((table.__doc__ or "").split())
        parts.append(f"\n## `{title}`\n\n{about} ({needed})\n\n")
        parts.append(_rows(table.model_fields.items()))
    return "".join(parts)


def _rows(fields: Any) -> str:
    lines = ["| key | values | default | what |\n|---|---|---|---|\n"]
    for name, field in fields:
        key, values = field.alias or name, _values(field.annotation, field.metadata)
        about = (field.description or "").replace("|", "\\|")
        lines.append(f"| `{key}` | {values} | {_default(field)} | {about} |\n")
    return "".join(lines)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**needed**"
    if field.default is None or field.default is PydanticUndefined:
        return "none"
    return f"`{_toml(field.default)}`"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _values(kind: Any, metadata: Sequence[Any] = ()) -> str:
    """The values that a key may have, in words."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return _values(inner[0], [*inner[1:], *metadata])
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_values(k, metadata) for k in inner if k is not type(None))
    if origin is typing.Literal:
        return ", ".join(f"`{_toml(value)}`" for value in inner)
    if origin is tuple:
        if Ellipsis in inner:
            return f"list of {_values(inner[0])}"
        return f"{len(inner)} of: {_values(inner[0])}"
    for item in metadata:
        names = getattr(item, "func", None)
        if isinstance(names, OneOf):
            return ", ".join(f"`{_toml(value)}`" for value in names.names)
    words = {float: "number", int: "whole number", bool: "`true`, `false`", str: "text"}
    return words.get(kind, str(kind)) + _limits(metadata)


def _limits(metadata: Sequence[Any]) -> str:
    found = limits_of(None, metadata)
    return ",".join(f" {sign} {value:g}" for sign, value in found.items())


def main(arguments: Sequence[str]) -> int:
    """Write the page, or print it."""
    if arguments:
        Path(arguments[0]).write_text(reference(), encoding="utf-8")
    else:
        print(reference())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
