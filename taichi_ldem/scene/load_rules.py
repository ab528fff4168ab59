"""Checks of loads, of the start and of probes, and the names that they have in the history.

Every check raises ValueError with a complete message.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from taichi_ldem.scene.loads import KINDS, Load, Probe
from taichi_ldem.scene.strikers import MOST_STRIKERS
from taichi_ldem.scene.values import refuse

if TYPE_CHECKING:
    from taichi_ldem.scene.scene import Scene

MOST_POINTS = 10_000
"""Points of all tables together: a resolved scene must stay within the size of scene files."""

LISTED = {"load": "load", "probe": "probe"}
"""Tables with names, and the word that the names begin with where a scene gives none."""

RESERVED = (
    "striker", "ring", "rings", "grip", "grips", "gauge", "support", "supports", "floor",
    "pieces", "plate", *(f"striker{number}" for number in range(2, MOST_STRIKERS + 1)),
)  # fmt: skip
"""Names with which columns of the history begin already."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")


def with_names(data: Any) -> Any:
    """Tables as TOML gives them, with names for the loads and probes that have none."""
    if not isinstance(data, Mapping):
        return data
    for table, word in LISTED.items():
        items = data.get(table)
        if isinstance(items, list | tuple) and all(isinstance(i, Mapping) for i in items):
            named = [{"name": f"{word}{n}"} | dict(item) for n, item in enumerate(items, 1)]
            data = {**data, table: named}
    return data


def check_loads(scene: Scene) -> None:
    """Check the loads, and that their files fit into the scene."""
    _check_names(scene)
    for number, load in enumerate(scene.loads):
        key = f"load[{number}]"
        if scene.plate.angle:
            why = "is for plate.angle = 0 only: its axes are those of the lattice"
            raise refuse(f"{key}.direction", load.direction, why)
        _check_region(key, load)
        _check_kind(key, load)
        _check_course(key, load)
        _check_jump(key, load)
    points = sum(len(load.times or ()) for load in scene.loads)
    if points > MOST_POINTS:
        raise ValueError(
            f"load: the tables of all loads have {points} lines together, and at most {MOST_POINTS}"
            " are taken; thin them out"
        )


def _check_names(scene: Scene) -> None:
    taken: dict[str, str] = {}
    for table, items in (("load", scene.loads), ("probe", scene.probes)):
        named: Sequence[Load | Probe] = items
        for number, item in enumerate(named):
            key, name = f"{table}[{number}].name", item.name or ""
            if not _NAME.fullmatch(name):
                why = "must begin with a letter and hold at most 32 letters, digits and underscores"
                raise refuse(key, name, why)
            if name in RESERVED:
                raise refuse(key, name, "is the name of a body; take another one")
            if name in taken:
                raise refuse(key, name, f"is the name of {taken[name]} already")
            taken[name] = f"{table}[{number}]"


def _one_of(key: str, item: Load | Probe, names: Sequence[str]) -> str:
    """The only one of some keys that is given."""
    given = [name for name in names if getattr(item, name) is not None]
    if not given:
        *most, last = names
        raise ValueError(f"missing key '{key}.{', '.join(most)}' or '{last}'")
    if len(given) > 1:
        why = f"cannot be given together with {key}.{given[0]}; give one of the two"
        raise refuse(f"{key}.{given[1]}", getattr(item, given[1]), why)
    return given[0]


def _check_region(key: str, load: Load) -> None:
    region = _one_of(key, load, ("face", "box"))
    inner, outer = load.inner_diameter, load.outer_diameter
    for name in ("inner_diameter", "outer_diameter", "centre"):
        value = getattr(load, name)
        if value is None:
            continue
        if region == "box":
            raise refuse(f"{key}.{name}", value, f"is for {key}.face, not for a box")
        if name == "centre" and inner is None and outer is None:
            raise refuse(f"{key}.centre", value, f"needs {key}.outer_diameter or .inner_diameter")
    if inner is not None and outer is not None and inner >= outer:
        why = f"must be smaller than {key}.outer_diameter = {outer!r}"
        raise refuse(f"{key}.inner_diameter", inner, why)


def _check_kind(key: str, load: Load) -> None:
    kind = _one_of(key, load, KINDS)
    if not any(load.direction):
        raise refuse(f"{key}.direction", load.direction, "must not be zero")
    if load.lateral == "held" and not load.prescribes:
        why = f"is for a velocity or a displacement, not for {key}.{kind}"
        raise refuse(f"{key}.lateral", load.lateral, why)


def _check_course(key: str, load: Load) -> None:
    needed = {"ramp": ("ramp",), "half-sine": ("duration",), "table": ("times", "factors")}
    allowed = {"constant": ("duration",), "ramp": ("duration",)}
    if load.table is not None:
        why = f"is read with a scene file only; give {key}.times and {key}.factors"
        raise refuse(f"{key}.table", load.table, why)
    wanted = needed.get(load.course, ())
    for name in ("ramp", "duration", "times", "factors"):
        value = getattr(load, name)
        if value is None and name in wanted:
            other = " or a file, 'table'" if name == "times" else ""
            raise ValueError(
                f"missing key '{key}.{name}'{other} ({key}.course = \"{load.course}\")"
            )
        if value is not None and name not in (*wanted, *allowed.get(load.course, ())):
            raise refuse(f"{key}.{name}", value, f'is not for {key}.course = "{load.course}"')
    if load.ramp and load.duration and load.ramp > load.duration:
        raise refuse(f"{key}.ramp", load.ramp, f"must be at most {key}.duration = {load.duration}")
    if load.times is None or load.factors is None:
        return
    if len(load.times) < 2 or len(load.factors) != len(load.times):
        why = f"must have as many numbers as {key}.times, two at least"
        raise refuse(f"{key}.factors", load.factors, why)
    for before, after in zip(load.times, load.times[1:], strict=False):
        if not after > before:
            raise refuse(f"{key}.times", load.times, f"must rise, and {after} follows {before}")


def _check_jump(key: str, load: Load) -> None:
    """Refuse a displacement that jumps: its nodes would need an infinite speed."""
    if not load.displacement:
        return
    jumps = {"constant": "at the start", "ramp": "at its duration", "table": "at the start"}
    if (
        load.course == "constant"
        or (load.course == "ramp" and load.duration is not None)
        or (load.factors is not None and load.factors[0] != 0)
    ):
        why = f'would jump {jumps[load.course]}; take a "ramp", or a "table" that begins with 0'
        raise refuse(f"{key}.displacement", load.displacement, why)


def check_start(scene: Scene) -> None:
    """Check the start."""
    start = scene.start
    if start is None:
        return
    given = {name: value for name, value in start if value is not None}
    if not given:
        raise ValueError(f"table '[start]' is empty; give one of {', '.join(dict(start))}")
    key, value = next(iter(given.items()))
    if scene.plate.angle:
        why = "is for plate.angle = 0 only: its axes are those of the lattice"
        raise refuse(f"start.{key}", value, why)
    if start.strain is not None and scene.grips is not None:
        raise refuse("start.strain", start.strain, "cannot be used with [grips], which set it")


def check_probes(scene: Scene) -> None:
    """Check the probes."""
    for number, probe in enumerate(scene.probes):
        key = f"probe[{number}]"
        region = _one_of(key, probe, ("point", "box", "plane"))
        if (region == "plane") != (probe.position is not None):
            if region == "plane":
                raise ValueError(f"missing key '{key}.position' ({key}.plane is given)")
            raise refuse(f"{key}.position", probe.position, f"is for {key}.plane only")
        if len({*probe.quantities}) < len(probe.quantities):
            raise refuse(f"{key}.quantities", list(probe.quantities), "names one of them twice")
    _refuse_far(scene)


def _refuse_far(scene: Scene) -> None:
    """Refuse points outside of the plate's prism, which are most likely in millimetres."""
    x, y, z = scene.plate.actual_size
    limits = ((-x / 2, x / 2), (-y / 2, y / 2), (0.0, z))
    margin = scene.plate.spacing
    for number, probe in enumerate(scene.probes):
        for value, (low, high) in zip(probe.point or (), limits, strict=False):
            if not low - margin <= value <= high + margin:
                why = f"must lie in the plate, m, which is {x:g} x {y:g} x {z:g}"
                raise refuse(f"probe[{number}].point", probe.point, why)
        if probe.plane is not None and probe.position is not None:
            low, high = limits["xyz".index(probe.plane)]
            if not low - margin <= probe.position <= high + margin:
                why = f"must lie between {low:g} and {high:g}, where the plate is"
                raise refuse(f"probe[{number}].position", probe.position, why)
