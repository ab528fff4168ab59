"""What `ldem info` says of shapes, holes and notches."""

from pathlib import Path

import numpy as np
from support.blocks import block_scene

from taichi_ldem.scenarios import describe, describe_cuts
from taichi_ldem.solver.build import build_lattice

DISC = {"centre": [0.0, 0.0, 5e-4], "diameter": 1e-3, "direction": [1.0, 1.0, 0.0]}


def test_holes_and_notches_are_named_with_their_sizes() -> None:
    hole = {"shape": "circle", "diameter": 4e-3}
    scene = block_scene(20, 20, 2, hole=[hole], notch=[DISC, DISC | {"time": 2.5e-5}])
    rows = describe_cuts.rows(scene, build_lattice(scene))
    assert rows == {
        "holes": "1, 13.00 mm2 in modules, 12.57 mm2 as drawn",
        "notches": "2, opening at 25 us",
    }
    assert not any("during the run" in line for line in describe.left_out(scene))
    late = scene.changed("solver.duration=2e-5")
    assert describe_cuts.remarks(late) == [
        "notch.time = 2.5e-05 is after solver.duration = 2e-05: the notch never opens"
    ]


def test_a_plain_plate_says_what_is_left_out() -> None:
    scene = block_scene(6, 6, 2)
    assert describe_cuts.rows(scene, build_lattice(scene)) == {}
    assert "notches that open during the run (no notch.time)" in describe.left_out(scene)


def test_parts_that_do_not_hang_together_are_counted(tmp_path: Path) -> None:
    array = np.ones((6, 6))
    array[:3, :3] = array[3:, 3:] = 0  # two squares that meet in an edge
    np.save(tmp_path / "two.npy", array)
    scene = block_scene(6, 6, 2, plate={"shape": "mask", "mask": str(tmp_path / "two.npy")})
    assert describe_cuts.rows(scene, build_lattice(scene)) == {
        "shape": "two.npy: 50.0 % of the plate's box, in 2 parts that share no face of a module"
    }
