"""What a notch or a hole must look like, and what is said of others."""

from typing import Any

import pytest
from support.blocks import block_scene

from taichi_ldem.errors import SceneError

RECTANGLE = {"normal": "x", "position": 0.0, "from": [-1.0, -1.0], "to": [0.0, 1.0]}
POINTS = [[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [0.0, 0.0, 1e-3]]
DISC = {"centre": [0.0, 0.0, 5e-4], "diameter": 1e-3, "direction": [1.0, 1.0, 0.0]}


@pytest.mark.parametrize(
    ("notch", "message"),
    [
        ({}, r"table '\[\[notch\]\]': notch\[0\] must have the keys normal, position, from and to"),
        ({"normal": "x"}, r"missing key 'notch\[0\].position'"),
        ({"centre": DISC["centre"]}, r"missing key 'notch\[0\].diameter'"),
        (RECTANGLE | {"points": POINTS}, r"notch\[0\].points: is not for a rectangle"),
        (
            {"points": POINTS[:2]},
            r"notch\[0\].points = \[.*\]: must be a list of 3 points \[x, y, z\]",
        ),
        ({"points": 5.0}, r"points = 5.0: must be a list of 3 points \[x, y, z\]"),
        ({"points": [[0.0, 1.0], *POINTS[1:]]}, r"points\[0\] = .*: must be a list of numbers"),
        (
            {"points": [[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [2e-3, 0.0, 0.0]]},
            "must be three corners that lie on no line",
        ),
        (
            {"points": [[x + 1.0, y, z] for x, y, z in POINTS]},
            r"notch\[0\].points = .* must cut the plate, which has x between -0.002 and 0.002",
        ),
        (DISC | {"direction": [0.0, 0.0, 0.0]}, r"direction = .*: must not be zero"),
        (
            DISC | {"centre": [0.0, 0.0, 2e-3], "direction": [0.0, 0.0, 1.0]},
            r"notch\[0\].centre = .* must cut the plate, which has z between 0.0 and 0.001",
        ),
        (DISC | {"time": -1.0}, r"notch\[0\].time = -1.0: must be at least 0"),
    ],
)
def test_bad_notches_are_refused_in_one_line(notch: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        block_scene(8, 8, 2, notch=[notch])
    assert "\n" not in str(caught.value)


def test_a_notch_opens_where_time_goes_on() -> None:
    scene = block_scene(8, 8, 2, notch=[DISC | {"time": 1e-5}])
    assert scene.notch[0].opens_at == 1e-5
    with pytest.raises(SceneError, match=r'time = 1e-05: must be 0 or absent with .* "modes"'):
        scene.changed("scenario=modes")


@pytest.mark.parametrize(
    ("hole", "message"),
    [
        ({"shape": "circle"}, r'hole\[0\].shape = "circle": needs hole\[0\].diameter'),
        ({"shape": "slot", "diameter": 1e-3}, r'hole\[0\].shape = "slot": needs hole\[0\].size'),
        (
            {"shape": "circle", "diameter": 1e-3, "size": [1e-3, 1e-3]},
            r"hole\[0\].size = .*: is not for a circle",
        ),
        ({"shape": "circle", "diameter": 1e-3, "angle": 3}, "angle = 3: is not for a circle"),
        ({"shape": "slot", "size": [1e-3, 2e-3]}, "must be no wider than it is long"),
        ({"shape": "circle", "diameter": 1e-4}, "must be at least 0.0005, one module"),
        (
            {"shape": "circle", "diameter": 1e-3, "centre": [0.1, 0.0]},
            r"hole\[0\].centre = \[0.1, 0.0\]: must lie on the plate",
        ),
        ({"shape": "square"}, r'must be "circle", "rectangle" or "slot"'),
    ],
)
def test_bad_holes_are_refused_in_one_line(hole: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        block_scene(8, 8, 2, hole=[hole])
