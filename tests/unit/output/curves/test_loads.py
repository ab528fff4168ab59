"""The figure of the loads."""

from pathlib import Path

from support.blocks import block_scene

from taichi_ldem.output.curves.chart import Curve
from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scenarios.runner import columns
from taichi_ldem.scene import scene_to_toml
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter


def test_each_load_has_a_curve_and_its_work_is_named(tmp_path: Path) -> None:
    loads = [{"face": f"{s}x", "traction": 1e6, "direction": f"{s}x"} for s in "+-"]
    scene = block_scene(6, 4, 2, scenario="load", load=loads, start={"velocity": [1, 0, 0]})
    folder = RunFolder.create(tmp_path / "run", force=False)
    folder.write_scene(scene_to_toml(scene))
    names = columns(scene)
    start = [0.25 if name == "kinetic_plate_j" else 0.0 for name in names]
    end = [{"time_s": 1e-4, "load2_force_n": 3.0, "external_j": 0.5}.get(n, 0.0) for n in names]
    with HistoryWriter(folder.history_file, names, [start, end]):
        run = LoadedRun.read(RunFolder.open(folder.path))
    found = {name for name in SCENARIOS["load"].figures if FIGURES[name].needs(run)}
    assert {"loads", "energy"} <= found
    assert found.isdisjoint({"force", "velocity"})
    panels, energies = FIGURES["loads"].panels, FIGURES["energy"].panels
    assert panels is not None
    assert energies is not None
    curves = [element for element in panels(run)[0].elements if isinstance(element, Curve)]
    assert [curve.label for curve in curves] == [
        "load1, along its direction",
        "load2, along its direction",
    ]
    assert list(curves[1].y) == [0.0, 3.0]
    assert "probes" not in found
    given = energies(run)[0].elements[0]
    assert isinstance(given, Curve)
    assert given.label == "plate at the start + work of loads"
    assert list(given.y) == [0.25, 0.75]
