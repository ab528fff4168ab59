"""Plates of every shape, with holes and notches, that a striker hits: energy, and the same bits."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.blocks import DAMAGE, block_scene

from taichi_ldem.scenarios import describe_cuts
from taichi_ldem.scene import Scene
from taichi_ldem.solver.build import build_lattice

SIDE = 12  # modules, with an edge of 0.5 mm


def _files(folder: Path) -> dict[str, str]:
    """An image and an array of the plate without a corner, and a box of triangles."""
    from PIL import Image

    whole = np.ones((SIDE, SIDE))
    whole[:3, :3] = 0
    np.save(folder / "body.npy", whole)
    Image.fromarray(np.where(whole[::-1], 0, 255).astype(np.uint8)).save(folder / "body.png")
    corners = np.array([[x, y, z] for x in (0, 6) for y in (0, 6) for z in (0, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [[q[0], q[n], q[n + 1]] for q in quads for n in (1, 2)]
    body = struct.pack("<80sI", b"", len(triangles))
    for triangle in triangles:
        body += struct.pack("<12fH", 0.0, 0.0, 0.0, *corners[triangle].ravel(), 0)
    (folder / "body.stl").write_bytes(body)
    return {name: str(folder / f"body.{name}") for name in ("png", "npy", "stl")}


HOLE = {"centre": [1.5e-3, 1.5e-3]}
SHAPES: dict[str, dict[str, Any]] = {
    "disc": {"plate": {"shape": "disc", "diameter": 6e-3}},
    "tube": {
        "plate": {"shape": "disc", "diameter": 6e-3},
        "hole": [{"shape": "circle", "diameter": 2e-3}],
        "striker": {"position": [2e-3, 0.0]},
    },
    "circle": {"hole": [HOLE | {"shape": "circle", "diameter": 2e-3}]},
    "rectangle": {"hole": [HOLE | {"shape": "rectangle", "size": [2e-3, 1e-3], "angle": 30.0}]},
    "slot": {"hole": [HOLE | {"shape": "slot", "size": [2.5e-3, 1e-3], "angle": 45.0}]},
    "png": {"plate": {"shape": "mask"}},
    "npy": {"plate": {"shape": "mask"}},
    "stl": {"plate": {"shape": "stl"}},
    "notch": {"notch": [{"normal": "x", "position": 1e-3, "from": [-1e-3, 0], "to": [1e-3, 1e-3]}]},
    "slanted": {"notch": [{"points": [[1e-3, 1e-3, 0], [2.5e-3, 2e-3, 0], [1e-3, 1e-3, 1e-3]]}]},
    "penny": {
        "notch": [
            {"centre": [1e-3, 1e-3, 5e-4], "diameter": 2e-3, "direction": [1, 1, 0.3], "time": 8e-6}
        ]
    },
}


def scene_of(name: str, folder: Path) -> Scene:
    """A plate that breaks under a striker, of a shape or with a flaw."""
    given = SHAPES[name]
    plate = dict(given.get("plate", {}))
    if name in ("png", "npy", "stl"):
        pytest.importorskip("trimesh" if name == "stl" else "PIL")
        plate[plate["shape"]] = _files(folder)[name]
    striker = {"diameter": 2e-3, "mass": 1e-3, "velocity": 40.0} | given.get("striker", {})
    more = {key: value for key, value in given.items() if key in ("hole", "notch")}
    solver = {"duration": 2e-5, "safety": 0.5, "threads": 1}
    output = {"history_interval": 5e-7}
    tables: dict[str, Any] = {"plate": plate, "striker": striker, "solver": solver}
    return block_scene(SIDE, SIDE, 2, material=DAMAGE, output=output, **tables, **more)


# of the plate's 144 modules seen from above; an image, an array and a body fill the whole box
AREAS = {"disc": np.pi * 36, "tube": np.pi * 32, "circle": 144 - np.pi * 4, "rectangle": 144 - 8}
AREAS |= {"slot": 144 - (6 + np.pi), "png": 135, "npy": 135, "stl": 144}


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_has_its_area_and_info_names_it(name: str, tmp_path: Path) -> None:
    scene = scene_of(name, tmp_path)
    lattice = build_lattice(scene)
    # the staircase of a hole may be wrong by two modules
    assert lattice.mask[0].sum() == pytest.approx(AREAS.get(name, 144), abs=2.1)
    rows = describe_cuts.rows(scene, lattice)
    if name in ("png", "npy", "stl"):
        assert rows["shape"].startswith(f"body.{name}: ")
    elif scene.hole:
        assert rows["holes"].startswith("1, ")
    elif scene.notch:
        assert rows["notches"].startswith("1")
        assert ("opening at 8 us" in rows["notches"]) == (name == "penny")


@pytest.mark.slow  # a lattice of its own each
@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_keeps_its_energy_and_goes_on_bitwise(
    taichi: None, name: str, tmp_path: Path
) -> None:
    from taichi_ldem.solver.simulation import Simulation

    scene = scene_of(name, tmp_path)
    simulation, saved = Simulation(scene), []

    def between() -> None:
        if simulation.step_number >= 60 and not saved:
            saved.append(simulation.saved_state())

    samples = [vars(sample) for sample in simulation.samples(between)]
    end, velocity = simulation.displacement(), simulation.dynamics.get_velocity()
    assert samples[-1]["broken_bars"] > 10
    assert max(sample["energy_error"] for sample in samples) < 0.01
    assert max(sample["energy_error_of_plate"] for sample in samples) < 0.01
    simulation.reset(scene)
    simulation.compile()
    simulation.restore_state(saved[0])
    again = [vars(sample) for sample in simulation.samples()]
    assert 5 < len(again) < len(samples)
    assert again == samples[-len(again) :]
    np.testing.assert_array_equal(simulation.displacement(), end)
    np.testing.assert_array_equal(simulation.dynamics.get_velocity(), velocity)
