"""The figures of probes and of further strikers."""

from pathlib import Path

from support.blocks import block_scene
from support.paths import CONFIGS

from taichi_ldem.output.curves.chart import Curve
from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scenarios.runner import columns
from taichi_ldem.scene import load_scene, scene_to_toml
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter


def test_strain_and_stress_of_probes_have_panels_of_their_own(tmp_path: Path) -> None:
    probes = [
        {"name": "a", "point": [0, 0, 0], "quantities": ["stress", "velocity"]},
        {"name": "b", "point": [0, 0, 0], "quantities": ["strain"]},
    ]
    scene = block_scene(6, 4, 2, probe=probes)
    folder = RunFolder.create(tmp_path / "run", force=False)
    folder.write_scene(scene_to_toml(scene))
    names = columns(scene)
    moved = {"time_s": 1e-4, "a_stress_yy_pa": 2e6, "b_strain_zz": 0.01}
    rows = [[0.0] * len(names), [moved.get(name, 0.0) for name in names]]
    with HistoryWriter(folder.history_file, names, rows):
        run = LoadedRun.read(RunFolder.open(folder.path))
    assert FIGURES["probes"].needs(run)
    assert FIGURES["probes"].panels is not None
    panels = FIGURES["probes"].panels(run)
    curves = {
        (panel.name, curve.label): curve.y[-1]
        for panel in panels
        for curve in panel.elements
        if isinstance(curve, Curve)
    }
    zero = dict.fromkeys([("probes_strain", f"b, along {a}") for a in "xy"], 0.0)
    zero |= dict.fromkeys([("probes_stress", f"a, along {a}") for a in "xz"], 0.0)
    assert curves == zero | {
        ("probes_strain", "b, along z"): 1.0,
        ("probes_stress", "a, along y"): 2.0,
    }


def test_probes_and_all_strikers_have_curves(tmp_path: Path) -> None:
    scene = load_scene(CONFIGS / "impact_drawing.toml")
    folder = RunFolder.create(tmp_path / "run", force=False)
    folder.write_scene(scene_to_toml(scene))
    names = columns(scene)
    moved = {"time_s": 1e-4, "middle_displacement_z_m": -1e-3, "striker2_velocity_m_s": 8.0}
    rows = [[0.0] * len(names), [moved.get(name, 0.0) for name in names]]
    with HistoryWriter(folder.history_file, names, rows):
        run = LoadedRun.read(RunFolder.open(folder.path))
    assert "probes" in SCENARIOS["impact"].figures
    assert FIGURES["probes"].needs(run)
    curves = {}
    for name in ("probes", "velocity"):
        panels = FIGURES[name].panels
        assert panels is not None
        elements = panels(run)[0].elements
        curves |= {curve.label: list(curve.y) for curve in elements if isinstance(curve, Curve)}
    assert curves == {
        "middle, along x": [0.0, 0.0],
        "middle, along y": [0.0, 0.0],
        "middle, along z": [0.0, -1.0],
        "striker, positive towards the plate": [0.0, 0.0],
        "striker2": [0.0, 8.0],
    }
