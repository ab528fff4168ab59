"""How a fault that pydantic finds becomes one line, and which key a user most likely meant."""

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from taichi_ldem.scene.schema import (
    holds_names,
    holds_points,
    is_list,
    length_of,
    limits_of,
    single_tables,
    table_of,
    tables_of,
)
from taichi_ldem.scene.values import show

Location = tuple[int | str, ...]

LARGEST_SHOWN = 1e9
"""Limits above it say how numbers are stored, not what a key means."""

NATURAL = {
    "thickness": "plate.size = [x, y, thickness]",
    "height": "plate.size = [x, y, thickness]",
    "width": "plate.size = [x, width, thickness]",
    "length": "plate.size = [length, y, thickness]",
    "modules": "plate.modules_through_thickness",
    "module_size": "plate.modules_through_thickness (the edge is the thickness over it)",
    "spacing": "plate.modules_through_thickness (the edge is the thickness over it)",
    "e": "material.youngs_modulus",
    "modulus": "material.youngs_modulus",
    "nu": "material.poisson_ratio",
    "rho": "material.density",
    "g_f": "material.fracture_energy",
    "gf": "material.fracture_energy",
    "r_f": "material.failure_factor",
    "eps_p": "material.failure_strain",
    "eps_r": "material.limit_strain",
    "strength": "material.failure_strain (strength over youngs_modulus)",
    "speed": "striker.velocity",
    "radius": "a diameter, twice the radius",
    "g": "plate.gravity or striker.gravity",
    "mu": "striker.friction or floor.friction",
    "dt": "solver.time_step",
    "end": "solver.duration",
    "end_time": "solver.duration",
    "time": "solver.duration",
}
"""Words that users type for a key whose name they do not know, and the key to give instead."""


def key_for(word: str, schema: type[BaseModel]) -> str | None:
    """The key of a scene, "section.key", that an option of this name was most likely meant for."""
    name = word.lstrip("-").replace("-", "_").lower()
    meant = NATURAL.get(name, "").partition(" ")[0]
    if meant.count("."):
        return meant
    for table in single_tables(schema):
        if name in tables_of(schema)[table].model_fields:
            return f"{table}.{name}"
    return None


def nearest(word: str, names: Sequence[str]) -> str:
    """A hint at the name that a misspelt word resembles, or at all names."""
    near = difflib.get_close_matches(word[:100], names, n=1)
    return f"did you mean '{near[0]}'?" if near else f"known: {', '.join(names)}"


def explain(fault: ErrorDetails, data: object, schema: type[BaseModel]) -> str:
    """One fault that pydantic found, as one line: key, value, and what would be right.

    Args:
        data: the tables that were validated.
        schema: the class that they were validated with.
    """
    kind, location = fault["type"], _as_written(fault["loc"], data)
    if kind == "value_error":  # a check of our own, complete but for the table's number
        return _numbered(str(fault["ctx"]["error"]), location)
    if kind == "extra_forbidden":
        return _unknown(location, schema)
    if kind == "missing":
        return _missing(location, data, schema)
    return f"{_key(location)} = {show(fault['input'])}: {_wish(fault, location, schema)}"


def _as_written(location: Location, data: object) -> Location:
    """A location without the number of a table that the file does not have as a list."""
    numbered = len(location) > 1 and isinstance(location[1], int)
    if numbered and isinstance(data, Mapping) and isinstance(data.get(location[0]), Mapping):
        return location[0], *location[2:]
    return location


def _numbered(message: str, location: Location) -> str:
    """A message of a table's own check, with the number of the table where there are several."""
    if len(location) < 2 or not isinstance(location[1], int):
        return message
    return re.sub(rf"(?<![\w.]){location[0]}\.", f"{_key(location[:2])}.", message)


def _unknown(location: Location, schema: type[BaseModel]) -> str:
    table = _table_at(location[:-1], schema)
    names = [field.alias or name for name, field in table.model_fields.items()]
    word = str(location[-1])
    meant = NATURAL.get(word.lower()) if word not in names else None
    hint = f"give {meant}" if meant else nearest(word, names)
    return f"unknown key '{_key(location)}'; {hint}"


def _missing(location: Location, data: object, schema: type[BaseModel]) -> str:
    if isinstance(location[-1], int):  # an element of a tuple
        value: Any = data
        for step in location[:-1]:
            value = value[step]
        wish = _elements(location[:-1], schema)
        return f"{_key(location[:-1])} = {show(value)}: must be a list of {wish}"
    if len(location) == 1 and location[0] in single_tables(schema):
        return f"missing table '[{location[0]}]'"
    return f"missing key '{_key(location)}'"


def _wish(fault: ErrorDetails, location: Location, schema: type[BaseModel]) -> str:
    """What would be right for a value that is not."""
    context = fault.get("ctx", {})
    other = _other_limit(fault["type"], location, schema)
    plain = {
        "float_type": "must be a number",
        "int_type": "must be a whole number",
        "bool_type": "must be true or false",
        "finite_number": "must be a finite number",
        "model_type": "must be a table",
        "model_attributes_type": "must be a table",
        "literal_error": f"must be {context.get('expected', '').replace(chr(39), chr(34))}",
        "greater_than": f"must be greater than {context.get('gt')}{other}",
        "greater_than_equal": f"must be at least {context.get('ge')}{other}",
        "less_than": f"must be less than {context.get('lt')}{other}",
        "less_than_equal": f"must be at most {context.get('le')}{other}",
    }
    if fault["type"] in ("tuple_type", "too_long"):
        return f"must be a list of {_elements(location, schema)}"
    return plain.get(fault["type"], fault["msg"].replace("Input should", "must"))


def _other_limit(kind: str, location: Location, schema: type[BaseModel]) -> str:
    """The limit on the other side of the one that a number is beyond; "" where there is none."""
    fields = _table_at(location[:-1], schema).model_fields if len(location) > 1 else {}
    field = fields.get(str(location[-1]))
    if field is None or not kind.startswith(("greater", "less")):
        return ""
    limits = limits_of(field.annotation, field.metadata)
    words = {">": "greater than", ">=": "at least", "<": "less than", "<=": "at most"}
    other = "<" if kind.startswith("greater") else ">"
    found = [
        f" and {words[sign]} {limit:g}"
        for sign, limit in limits.items()
        if sign.startswith(other) and abs(limit) <= LARGEST_SHOWN
    ]
    return "".join(found)


def _elements(location: Location, schema: type[BaseModel]) -> str:
    """The elements that the list at a location must have."""
    for name, field in _table_at(location[:-1], schema).model_fields.items():
        if location[-1] in (name, field.alias):
            if table_of(field) is not None:
                return "tables"
            kind = "names" if holds_names(field) else "numbers"
            kind = "points [x, y, z]" if holds_points(field) else kind
            return kind if is_list(field) else f"{length_of(field)} {kind}"
    return "numbers"


def _table_at(location: Location, schema: type[BaseModel]) -> type[BaseModel]:
    return tables_of(schema)[str(location[0])] if location else schema


def _key(location: Location) -> str:
    parts = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in location)
    return "".join(parts).removeprefix(".")
