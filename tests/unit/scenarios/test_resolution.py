"""Remarks on rigid bodies that are finer than a module."""

from typing import Any

import pytest
from support.blocks import SPACING, block_scene

from taichi_ldem.scenarios.resolution import unresolved
from taichi_ldem.scene import parse_scene

STRIKER = {"diameter": 2e-3, "mass": 1e-3, "velocity": 1.0}
GRIPS = {"length": SPACING, "velocity": 1.0, "ramp": 1e-5}


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"striker": STRIKER}, None),
        ({"striker": STRIKER | {"diameter": 4e-4}}, "striker.diameter is 0.8 modules"),
        ({"supports": {"span": 3e-3, "diameter": 3e-4}}, "supports.diameter is 0.6 modules"),
        ({"clamp": {"kind": "rim", "inner_diameter": 4e-4}}, "clamp.inner_diameter is 0.8 modules"),
        ({"clamp": {"kind": "rim", "inner_diameter": 5.8e-3}}, "rim is 0.2 modules"),
        ({"clamp": {"kind": "rim", "inner_diameter": 4e-3}}, None),
    ],
)
def test_a_body_below_a_module_is_named(tables: dict[str, Any], words: str | None) -> None:
    lines = unresolved(block_scene(12, 12, 3, **tables))
    assert len(lines) == (words is not None)
    assert words is None or words in lines[0]


@pytest.mark.parametrize(
    ("length", "angle", "words"),
    [
        (0.5 * SPACING, 0, None),
        (0.4 * SPACING, 0, "grips.length is 0.4 modules: the grips hold only the nodes of the end"),
        (0.5 * SPACING, 30, "grips.length is 0.5 modules: at this plate.angle the grips hold only"),
        (SPACING, 30, None),
    ],
)
def test_grips_below_a_module_are_named(length: float, angle: int, words: str | None) -> None:
    data = block_scene(12, 6, 3).model_dump(by_alias=True, exclude_none=True)
    data |= {"scenario": "tension", "grips": GRIPS | {"length": length}}
    data["plate"]["angle"] = angle
    lines = unresolved(parse_scene(data))
    assert len(lines) == (words is not None)
    assert words is None or words in lines[0]
