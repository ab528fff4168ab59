"""What is said about a striker that never touched the plate."""

import pytest
from support.blocks import block_scene

from taichi_ldem.solver.contact.striker import STRIKERS

STRUCK = {"diameter": 0.4e-3, "mass": 1e-3, "velocity": 10.0, "gap": 1e-4}


@pytest.mark.parametrize(
    ("way", "force", "expected"),
    [
        (5e-5, 0.0, "it has come 5e-05 m of striker.gap = 0.0001 in solver.duration = 0.001"),
        (
            2.5e-3,
            0.0,
            "it has passed the top face by 0.0024 m beside all nodes; see striker.position and "
            "striker.diameter, 0.8 modules",
        ),
        (2.5e-3, 1.0, None),
    ],
    ids=["on its way", "passed", "touched"],
)
def test_without_contact_the_reason_is_said(way: float, force: float, expected: str | None) -> None:
    scene = block_scene(12, 12, 3, striker=STRUCK)
    rows = [
        {"striker_displacement_m": 0.0, "striker_force_n": 0.0},
        {"striker_displacement_m": way, "striker_force_n": force},
    ]
    lines = [] if expected is None else [f"the striker never touched the plate: {expected}"]
    assert STRIKERS[0].warnings(scene, rows) == lines
