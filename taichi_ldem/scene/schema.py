"""The schema seen from outside: which tables and lists a scene has, read from its class."""

import typing
from collections.abc import Iterator, Sequence
from typing import Any

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo


def tables_of(schema: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """The tables of a schema by key, those that may be repeated included."""
    found = ((key, table_of(field)) for key, field in keys_of(schema).items())
    return {key: table for key, table in found if table is not None}


def keys_of(schema: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a schema by the keys that a file has for them."""
    return {field.alias or name: field for name, field in schema.model_fields.items()}


def single_tables(schema: type[BaseModel]) -> list[str]:
    """Keys of the tables that a scene has once, or may have once without being a list."""
    fields = keys_of(schema)
    return [k for k in tables_of(schema) if not is_list(fields[k]) or may_be_single(fields[k])]


SINGLE = "a single table [key] is as good as a list [[key]]"
"""Marks, among a field's metadata, a list of tables that need not be written as a list."""


def may_be_single(field: FieldInfo) -> bool:
    """Whether a field that holds a list of tables takes a single table, too."""
    return SINGLE in field.metadata


def table_of(field: FieldInfo) -> type[BaseModel] | None:
    """The table that a field of a schema holds, once or several times."""
    for kind in _flat(field.annotation):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def is_list(field: FieldInfo) -> bool:
    """Whether a field holds a list of any length."""
    return any(Ellipsis in typing.get_args(kind) for kind in _flat(field.annotation))


def holds_names(field: FieldInfo) -> bool:
    """Whether a field's list holds words of a fixed choice."""
    return any(typing.get_origin(kind) is typing.Literal for kind in _flat(field.annotation))


def holds_points(field: FieldInfo) -> bool:
    """Whether a field's list holds lists of numbers."""
    return any(
        typing.get_origin(kind) is tuple
        and any(typing.get_origin(inner) is tuple for inner in typing.get_args(kind))
        for kind in _flat(field.annotation)
    )


def length_of(field: FieldInfo) -> int | None:
    """Number of elements that a field's list must have; None where any will do."""
    for kind in _flat(field.annotation):
        if typing.get_origin(kind) is tuple and Ellipsis not in typing.get_args(kind):
            return len(typing.get_args(kind))
    return None


def limits_of(kind: Any, metadata: Sequence[Any] = ()) -> dict[str, float]:
    """The limits of a number of a type with metadata, by their signs: ">", ">=", "<", "<="."""
    found: dict[str, float] = {}
    for inner in _flat(kind):
        if typing.get_origin(inner) is typing.Annotated:
            metadata = [*typing.get_args(inner)[1:], *metadata]
    for item in metadata:
        for part in getattr(item, "metadata", None) or [item]:  # a Field within Annotated
            for limit, sign in ((Gt, ">"), (Ge, ">="), (Lt, "<"), (Le, "<=")):
                if isinstance(part, limit):
                    found[sign] = getattr(part, limit.__name__.lower())
    return found


def _flat(kind: Any) -> Iterator[Any]:
    """A type and all types that it is composed of."""
    yield kind
    for inner in typing.get_args(kind):
        yield from _flat(inner)
