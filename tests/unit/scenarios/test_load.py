"""The numbers of a plate under loads, from a history made by hand."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from support.blocks import block_scene

from taichi_ldem.scenarios.load import summary
from taichi_ldem.scenarios.runner import columns
from taichi_ldem.storage.folder import RunFolder

PULL = {"face": "+x", "traction": 1e6, "direction": "x"}


def test_peaks_of_the_loads_and_the_cracked_area(tmp_path: Path) -> None:
    material = {"damage": True, "fracture_energy": 1034.0, "failure_strain": 0.0175}
    scene = block_scene(6, 4, 6, load=[PULL, PULL | {"name": "pull"}], material=material)
    names = columns(scene)
    assert names[1:5] == [
        "load1_force_n", "load1_displacement_m", "pull_force_n", "pull_displacement_m",
    ]  # fmt: skip
    forces = [(0.0, 0.0), (2.0, -1.0), (2.0 + 1e-15, -5.0), (1.0, 3.0)]
    history: list[dict[str, Any]] = [dict.fromkeys(names, 0.0) for _ in forces]
    for n, (row, (first, second)) in enumerate(zip(history, forces, strict=True)):
        row |= {"time_s": 1e-6 * n, "load1_force_n": first, "pull_force_n": second}
        row |= {"load1_displacement_m": 1e-7 * n, "fracture_j": 1e-3 * n, "external_j": 0.5 * n}
    simulation: Any = SimpleNamespace(scene=scene)
    found = summary(simulation, history, RunFolder(tmp_path))
    assert (found["load1_peak_force_n"], found["load1_peak_time_s"]) == (2.0, 1e-6)
    assert found["load1_peak_displacement_m"] == 1e-7
    assert (found["pull_peak_force_n"], found["pull_peak_time_s"]) == (-5.0, 2e-6)
    assert found["cracked_area_m2"] == 3e-3 / 1034.0
    assert found["damage_onset_time_s"] is not None
    assert found["crack_from_x_m"] is None
    assert found["external_end_j"] == 1.5


def test_a_scene_without_loads_has_their_columns_neither() -> None:
    names = columns(block_scene(6, 4, 2))
    assert not [name for name in names if name.startswith(("load", "probe"))]
    assert "external_j" not in names
    probes = columns(block_scene(6, 4, 2, probe=[{"name": "tip", "point": [0, 0, 0]}]))
    assert [name for name in probes if name not in names] == [
        "tip_displacement_x_m", "tip_displacement_y_m", "tip_displacement_z_m",
        "tip_velocity_x_m_s", "tip_velocity_y_m_s", "tip_velocity_z_m_s",
    ]  # fmt: skip
    probe = {"name": "tip", "point": [0, 0, 0], "quantities": ["stress", "strain"]}
    stressed = columns(block_scene(6, 4, 2, probe=[probe]))
    assert [name for name in stressed if name not in names] == [
        "tip_strain_xx", "tip_strain_yy", "tip_strain_zz",
        "tip_strain_xy", "tip_strain_yz", "tip_strain_xz",
        "tip_stress_xx_pa", "tip_stress_yy_pa", "tip_stress_zz_pa",
        "tip_stress_xy_pa", "tip_stress_yz_pa", "tip_stress_xz_pa",
    ]  # fmt: skip
