"""Kinds of values that keys take, and the base of all tables."""

import itertools
import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError, PydanticKnownError

MAGNITUDE = 1e20
"""Numbers in SI units lie between 1 / MAGNITUDE and MAGNITUDE."""


def _plausible(value: float) -> float:
    # what passes cannot overflow or underflow in any formula of the solver
    if value == 0 or 1 / MAGNITUDE <= abs(value) <= MAGNITUDE:
        return value
    raise PydanticCustomError("magnitude", "must lie between 1e-20 and 1e20 in SI units")


Real = Annotated[float, Field(strict=True), AfterValidator(_plausible)]
Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Flag = Annotated[bool, Field(strict=True)]
Seed = Annotated[int, Field(strict=True, ge=0, lt=1 << 63)]
Axis = Literal["x", "y", "z"]


@dataclass(frozen=True)
class OneOf:
    """Validator of a text that must be one of the names known when a scene is read.

    ``typing.Literal`` fixes its values when the module is imported; these names may grow later.
    """

    names: Collection[str]

    def __call__(self, value: object) -> str:
        """The value itself; pydantic's error for literals if it is not among the names."""
        if isinstance(value, str) and value in self.names:
            return value
        *most, last = (repr(name) for name in self.names)
        expected = f"{', '.join(most)} or {last}" if most else last
        raise PydanticKnownError("literal_error", {"expected": expected})


class Table(BaseModel):
    """A table of a scene: immutable, and without keys that nobody reads."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def plain(value: Any) -> Any:
    """A value with Python's own numbers in place of NumPy's, and lists in place of arrays."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "dtype") and hasattr(value, "tolist"):
        return value.tolist()
    return value


def refuse(key: str, value: object, why: str) -> ValueError:
    """The error of a check of our own; its text is complete and names key and value."""
    return ValueError(f"{key} = {show(value)}: {why}")


def show(value: object) -> str:
    """A value as TOML would write it, on one line of at most 64 characters."""
    text = "".join(itertools.islice(_pieces(value), 64))
    return text if len(text) <= 64 else f"{text[:60]} ..."


def _pieces(value: object) -> Iterator[str]:
    if isinstance(value, dict):
        yield "a table"
    elif isinstance(value, list | tuple):
        yield "["
        for number, item in enumerate(value):
            yield ", " if number else ""
            yield from _pieces(item)
        yield "]"
    elif isinstance(value, bool | str):
        yield json.dumps(value)  # escapes line breaks
    elif isinstance(value, int) and value.bit_length() > 256:
        yield "an integer of hundreds of digits"  # repr of such integers may raise
    else:
        yield str(value)
