"""What an ensemble varies: each key with its values, and their parts of the members' names."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Override, parse_overrides

CV, SEED = "disorder.fracture_energy_cv", "disorder.seed"
SHORT = {CV: "cv", SEED: "seed"}
"""Names of these keys in the members' names; another key is named by its last word."""

MAX_MEMBERS = 100_000
_LONGEST = 60  # characters of a value in a member's name


@dataclass(frozen=True)
class Value:
    """A value of a varied key.

    Attributes:
        text: as it was given.
        override: the same as an override of the scene.
        part: of a member's name, with the key's word; different for every value of the key.
    """

    text: str
    override: Override
    part: str


@dataclass(frozen=True)
class Axis:
    """A varied key and its values, each of which is given once."""

    key: str
    values: tuple[Value, ...]


def make_axes(cv: str | None, seeds: str | None, vary: Sequence[str]) -> list[Axis]:
    """The varied keys, the seed last; the arguments are those of ``plan.make_plan``.

    Raises:
        SceneError: an option is not acceptable, a key or a value is given twice, or the members
            would be too many.
    """
    given = list(_given(cv, seeds, vary))
    if not given:
        raise SceneError("nothing is varied: give --cv, --seeds or --vary")
    keys = [key for key, _, _ in given]
    for key in keys:
        if keys.count(key) > 1:
            raise SceneError(f"--vary {key}: the key is varied twice")
    count = 1
    for _, _, texts in given:
        count *= len(texts)
    if count > MAX_MEMBERS:
        raise SceneError(f"an ensemble has at most {MAX_MEMBERS} members, not {count}")
    words = _words(keys)
    return [_axis(*axis, word) for axis, word in zip(given, words, strict=True)]


def _given(
    cv: str | None, seeds: str | None, vary: Sequence[str]
) -> Iterator[tuple[str, str, list[str]]]:
    """Each varied key with the option that names it and its values as texts, the seed last."""
    if cv is not None:
        yield CV, f"--cv {cv}", [_variability(cv, text) for text in _split(cv)]
    for text in vary:
        key, equals, values = (part.strip() for part in text.partition("="))
        if not equals or not values or key.count(".") != 1:
            raise SceneError(f"--vary {text}: must have the form section.key=value,value,...")
        yield key, f"--vary {text}", _split(values)
    if seeds is not None:
        yield SEED, f"--seeds {seeds}", [str(seed) for seed in _seeds(seeds)]


def _variability(given: str, text: str) -> str:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise SceneError(f"--cv {given}: must be numbers of at least 0, as in 0.10,0.25")
    return repr(value + 0.0)  # no -0.0


def _seeds(text: str) -> list[int]:
    wish = f"--seeds {text}: must be whole numbers of at least 0, as in 0:4 or 1,5,7"
    found: list[int] = []
    for part in text.split(","):
        first, colon, last = (word.strip() for word in part.partition(":"))
        if not (first.isdecimal() and (last.isdecimal() or not colon)) or len(first + last) > 30:
            raise SceneError(wish)
        end = int(last) if colon else int(first) + 1
        if len(found) + end - int(first) > MAX_MEMBERS:
            raise SceneError(f"--seeds {text}: must be at most {MAX_MEMBERS} seeds")
        found += range(int(first), end)
    if not found:
        raise SceneError(wish)
    return found


def _split(text: str) -> list[str]:
    """Values between commas; commas within brackets or quotes do not separate."""
    cuts, depth, quote = [-1], 0, ""
    for place, letter in enumerate(text):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0 and not quote:
            cuts.append(place)
    cuts.append(len(text))
    return [text[a + 1 : b].strip() for a, b in itertools.pairwise(cuts)]


def _words(keys: Sequence[str]) -> list[str]:
    """The name of each key in a member's name: its last word, if no other key has the same one."""
    last = [key.rpartition(".")[2] for key in keys]
    return [
        SHORT.get(key, word if last.count(word) == 1 else key.replace(".", "-"))
        for key, word in zip(keys, last, strict=True)
    ]


# --- values ---------------------------------------------------------------------------------------


def _axis(key: str, option: str, texts: Sequence[str], word: str) -> Axis:
    """A varied key; SceneError where a value is missing, or equal to an earlier one."""
    seen: dict[Any, str] = {}
    taken: set[str] = set()
    values: list[Value] = []
    for text in texts:
        if not text:
            raise SceneError(f"{option}: a value is missing")
        (override,) = parse_overrides([f"{key}={text}"])
        earlier = seen.setdefault(_comparable(override.value), text)
        if len(seen) == len(values):
            same = f"{text} is given twice" if earlier == text else f"{earlier} equals {text}"
            raise SceneError(f"{option}: {same}; a member would be missing")
        part = next(part for part in _parts(text) if part not in taken)
        taken.add(part)
        values.append(Value(text, override, word + part))
    return Axis(key, tuple(values))


def _comparable(value: Any) -> Any:
    """A value of TOML as something that can be looked up: equal for equal numbers, 5 and 5.0."""
    if isinstance(value, list):
        return ("list", *map(_comparable, value))
    if isinstance(value, dict):
        return ("table", *((key, _comparable(value[key])) for key in sorted(value)))
    return str(value) if isinstance(value, bool) or value != value else value


def _parts(text: str) -> Iterator[str]:
    """Names of a value, the best first; those that follow tell it from values of the same name."""
    if text.isdecimal():
        yield text
    try:
        number = float(text)
    except ValueError:
        name = re.sub(r"[^0-9A-Za-z.+-]+", "x", text).strip("x")[:_LONGEST]
    else:
        yield f"{number:.12g}"
        name = repr(number)
    yield name
    for count in range(2, MAX_MEMBERS + 2):
        yield f"{name}-{count}"
