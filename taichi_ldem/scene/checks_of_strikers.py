"""Checks that compare strikers and supports with the plate, the clamp and the scenario."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from taichi_ldem.scene.strikers import MOST_STRIKERS, Striker
from taichi_ldem.scene.values import refuse

if TYPE_CHECKING:
    from taichi_ldem.scene.scene import Scene


def check_strikers(scene: Scene) -> None:
    """Refuse strikers that are too many, beside the plate or over the clamp."""
    strikers = scene.strikers
    if len(strikers) > MOST_STRIKERS:
        raise ValueError(f"{len(strikers)} tables [[striker]]: a scene has at most {MOST_STRIKERS}")
    for number, striker in enumerate(strikers):
        key = "striker" if len(strikers) == 1 else f"striker[{number}]"
        _check_striker(scene, key, striker)


def _check_striker(scene: Scene, key: str, striker: Striker) -> None:
    clamp = scene.clamp
    if not scene.plate.covers(*striker.position):
        why = "must be over the plate, in metres from its centre"
        raise refuse(f"{key}.position", striker.position, why)
    if clamp is None or clamp.kind == "free":
        return
    inner = clamp.inner_diameter
    assert inner is not None
    if striker.width >= inner:
        name = "diameter" if striker.ring_diameter is None else "ring_diameter"
        within = "" if striker.ring_diameter is None else " with the wall"
        why = f"must be smaller{within} than clamp.inner_diameter = {inner!r}"
        raise refuse(f"{key}.{name}", getattr(striker, name), why)
    if math.hypot(*striker.position) + striker.width / 2 >= inner / 2:
        why = f"the striker must stay inside clamp.inner_diameter = {inner!r}"
        raise refuse(f"{key}.position", striker.position, why)


def refuse_for_bend(scene: Scene) -> None:
    """Refuse what a bending test cannot use: supports that are no cylinders, a second striker."""
    supports = scene.supports
    if supports is not None and supports.kind != "cylinders":
        why = 'must be "cylinders" with scenario = "bend"; a plate on them is scenario = "impact"'
        raise refuse("supports.kind", supports.kind, why)
    if len(scene.strikers) > 1:
        raise ValueError(f'{len(scene.strikers)} tables [[striker]]: scenario = "bend" takes one')


def check_supports(scene: Scene) -> None:
    """Refuse supports that do not fit under the plate, or that overlap."""
    supports, plate = scene.supports, scene.plate
    if supports is None:
        return
    span, length = supports.span, plate.size[0]
    if span is not None:
        if span > length:
            raise refuse("supports.span", span, f"must be at most {length!r}, the plate's side x")
        if supports.diameter > span:
            why = f"must be at most supports.span = {span!r}"
            raise refuse("supports.diameter", supports.diameter, why)
        return
    key = "ring_diameter" if supports.kind == "ring" else "circle_diameter"
    width = plate.diameter or min(plate.size[:2])
    if supports.across > width:
        why = f"must be at most {width!r}, the width of the plate in metres"
        raise refuse(f"supports.{key}", supports.across, why)
    limit, text = supports.across, f"supports.{key} = {supports.across!r}"
    if supports.count is not None:
        limit *= math.sin(math.pi / supports.count)
        text = f"{limit:.6g}, with which {supports.count} balls on the circle touch each other"
    if supports.diameter > limit:
        raise refuse("supports.diameter", supports.diameter, f"must be at most {text}")
