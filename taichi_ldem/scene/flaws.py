"""Checks of what is cut out of the plate: notches and holes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from taichi_ldem.scene.values import refuse

if TYPE_CHECKING:
    from taichi_ldem.scene.scene import Scene
    from taichi_ldem.scene.specimen import Hole, Notch

FORMS = {
    "rectangle": ("normal", "position", "from", "to"),
    "parallelogram": ("points",),
    "disc": ("centre", "diameter", "direction"),
}
"""Keys of a notch that belong together, by the form of the flaw."""


def check_notches(scene: Scene) -> None:
    """Refuse notches of no form, of two, outside the plate, or with a time where none goes on."""
    for number, notch in enumerate(scene.notch):
        key = f"notch[{number}]"
        form = _form(key, notch)
        {"rectangle": _check_rectangle, "parallelogram": _check_points, "disc": _check_disc}[form](
            scene, key, notch
        )
        if notch.time and scene.scenario == "modes":
            why = 'must be 0 or absent with scenario = "modes", in which no time goes on'
            raise refuse(f"{key}.time", notch.time, why)


def _form(key: str, notch: Notch) -> str:
    given = {name for name in notch.model_dump(by_alias=True, exclude_none=True) if name != "time"}
    found = [form for form, names in FORMS.items() if given & {*names}]
    if not found:
        raise ValueError(
            f"table '[[notch]]': {key} must have the keys normal, position, from and to, or the "
            "key points, or the keys centre, diameter and direction"
        )
    if len(found) > 1:
        one, other = (next(n for n in FORMS[form] if n in given) for form in found[:2])
        raise ValueError(
            f"{key}.{other}: is not for a {found[0]}, which {key}.{one} describes; give one of them"
        )
    for name in FORMS[found[0]]:
        if name not in given:
            raise ValueError(f"missing key '{key}.{name}'")
    return found[0]


def _limits(scene: Scene) -> tuple[tuple[float, float], ...]:
    """Lower and upper limits of the plate along x, y and z, m."""
    x, y, z = scene.plate.size
    return (-x / 2, x / 2), (-y / 2, y / 2), (0.0, z)


def _check_rectangle(scene: Scene, key: str, notch: Notch) -> None:
    limits = _limits(scene)
    normal, *axes = notch.axes
    lower, upper = limits[normal]
    if not lower < notch.place < upper:
        why = f"must lie inside the plate, between {lower!r} and {upper!r}"
        raise refuse(f"{key}.position", notch.position, why)
    for axis, (start, stop) in zip(axes, notch.bounds, strict=True):
        lower, upper = limits[axis]
        if not start < stop:
            why = f"must differ from {key}.from along {'xyz'[axis]}"
            raise refuse(f"{key}.to", notch.to, why)
        if stop <= lower or start >= upper:
            why = f"must cut the plate, which has {'xyz'[axis]} between {lower!r} and {upper!r}"
            raise refuse(f"{key}.to", notch.to, why)


def _check_points(scene: Scene, key: str, notch: Notch) -> None:
    assert notch.points is not None
    first, second, third = notch.points
    one, two = ([b - a for a, b in zip(first, point, strict=True)] for point in (second, third))
    across = math.hypot(
        one[1] * two[2] - one[2] * two[1],
        one[2] * two[0] - one[0] * two[2],
        one[0] * two[1] - one[1] * two[0],
    )
    if not across > 1e-6 * math.hypot(*one) * math.hypot(*two):
        raise refuse(f"{key}.points", notch.points, "must be three corners that lie on no line")
    fourth = [b + c - a for a, b, c in zip(first, second, third, strict=True)]
    corners = [first, second, third, fourth]
    for axis, (lower, upper) in enumerate(_limits(scene)):
        places = [corner[axis] for corner in corners]
        if max(places) <= lower or min(places) >= upper:
            why = f"must cut the plate, which has {'xyz'[axis]} between {lower!r} and {upper!r}"
            raise refuse(f"{key}.points", notch.points, why)


def _check_disc(scene: Scene, key: str, notch: Notch) -> None:
    assert notch.centre is not None
    assert notch.diameter is not None
    assert notch.direction is not None
    if not any(notch.direction):
        raise refuse(f"{key}.direction", notch.direction, "must not be zero")
    length = math.hypot(*notch.direction)
    for axis, (lower, upper) in enumerate(_limits(scene)):
        part = notch.direction[axis] / length
        reach = 0.5 * notch.diameter * math.sqrt(max(0.0, 1 - part * part))
        middle = notch.centre[axis]
        if middle + reach <= lower or middle - reach >= upper:
            why = f"must cut the plate, which has {'xyz'[axis]} between {lower!r} and {upper!r}"
            raise refuse(f"{key}.centre", notch.centre, why)


def check_holes(scene: Scene) -> None:
    """Refuse holes without their sizes, outside the plate, or too small to be cut."""
    for number, hole in enumerate(scene.hole):
        _check_hole(scene, f"hole[{number}]", hole)


def _check_hole(scene: Scene, key: str, hole: Hole) -> None:
    needed, other = ("diameter", "size") if hole.shape == "circle" else ("size", "diameter")
    if getattr(hole, needed) is None:
        raise refuse(f"{key}.shape", hole.shape, f"needs {key}.{needed}")
    if getattr(hole, other) is not None:
        raise refuse(f"{key}.{other}", getattr(hole, other), f"is not for a {hole.shape}")
    if hole.shape == "circle" and hole.angle:
        raise refuse(f"{key}.angle", hole.angle, "is not for a circle")
    least = hole.diameter if hole.size is None else min(hole.size)
    assert least is not None
    if hole.shape == "slot" and hole.size is not None and hole.size[0] < hole.size[1]:
        raise refuse(f"{key}.size", hole.size, "must be no wider than it is long")
    spacing = scene.plate.spacing
    if least < spacing:
        why = f"must be at least {spacing:.6g}, one module"
        raise refuse(f"{key}.{needed}", getattr(hole, needed), why)
    x, y = (side / 2 for side in scene.plate.size[:2])
    if not (abs(hole.centre[0]) <= x and abs(hole.centre[1]) <= y):
        why = f"must lie on the plate, which reaches to {x!r} along x and {y!r} along y"
        raise refuse(f"{key}.centre", hole.centre, why)
