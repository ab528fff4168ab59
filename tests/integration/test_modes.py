"""`ldem modes`: which scenes it takes, what it writes."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from support.command import ldem
from support.paths import CONFIGS

from taichi_ldem.cli import main
from taichi_ldem.scene import load_scene, parse_scene, scene_to_toml

SMALL = [  # 30 x 30 x 1 modules
    "--set", "plate.size=[0.09, 0.09, 0.003]", "--set", "plate.modules_through_thickness=1",
    "--set", "clamp.inner_diameter=0.06", "--set", "clamp.outer_diameter=0.084",
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "modes"
    command = ["modes", str(CONFIGS / "modes_quick.toml"), "--out", str(out), "--count", "7"]
    assert ldem(*command, "--quiet", *SMALL).returncode == 0
    return out


def test_a_finished_folder_holds_the_numbers(folder: Path) -> None:
    values = json.loads((folder / "summary.json").read_text())
    found = np.array(values["frequencies_hz"])
    assert len(found) == len(values["residuals"]) == 7
    assert (np.diff(found) >= 0).all()
    assert max(values["residuals"]) < 1e-4  # eigen.TOLERANCE
    plate = [name for name in values["names"] if name != "outside"]
    assert plate[:3] == ["(0, 0)", "(1, 0)", "(1, 0)"]
    one, two = (n for n, name in enumerate(values["names"]) if name == "(1, 0)")
    assert found[one] == pytest.approx(found[two], rel=1e-6)  # the square's symmetry
    assert values["groups"][one] == values["groups"][two]
    with (folder / "modes.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["frequency_hz"]) for row in rows] == pytest.approx(found)
    assert "| (1, 0) x 2 |" in (folder / "modes.md").read_text()
    assert (folder / "modes.png").stat().st_size > 10_000
    assert load_scene(folder / "scene.toml").modes.count == 7  # type: ignore[union-attr]


def test_shapes_open_in_vtk_and_are_held_where_the_rings_are(folder: Path) -> None:
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(folder / "modes.vtkhdf"))
    reader.Update()
    grid = reader.GetOutput()
    assert grid.GetNumberOfCells() == 900
    places = vtk_to_numpy(grid.GetPoints().GetData())
    radius = np.hypot(places[:, 0], places[:, 1])
    for number in range(1, 8):
        shape = vtk_to_numpy(grid.GetPointData().GetArray(f"mode_{number:02d}"))
        assert np.abs(shape).max() <= 1
        assert np.abs(shape).max() > 0.9  # the largest may be at a centre node
        assert not shape[(radius > 0.0301) & (radius < 0.0419)].any()


@pytest.mark.slow  # a lattice of its own
def test_any_scene_will_do_and_is_told_what_is_left_out(tmp_path: Path) -> None:
    out = tmp_path / "impact"
    command = ["modes", str(CONFIGS / "impact_small.toml"), "--out", str(out), "--count", "1"]
    settings = ["--set", "plate.modules_through_thickness=1", "--set", "striker.gravity=9.81"]
    printed = ldem(*command, *settings).stdout
    assert "taken as bonded" in printed
    assert "striker is left out" in printed
    assert json.loads((out / "summary.json").read_text())["names"] == ["(0, 0)"]


def test_impact_refuses_the_scene_of_modes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["impact", str(CONFIGS / "modes.toml"), "--out", str(out)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not out.exists()


def test_too_many_modes_are_refused(tmp_path: Path) -> None:
    command = ["modes", str(CONFIGS / "modes_quick.toml"), "--out", str(tmp_path / "run")]
    size = ["--set", "plate.size=[0.004, 0.004, 0.001]", "--set", "clamp.kind=free"]
    done = ldem(*command, *size, "--count", "900")
    assert done.returncode == 2
    assert "modes.count = 900: at most" in done.stderr


def test_only_modes_need_no_end_time(tmp_path: Path) -> None:
    scene = load_scene(CONFIGS / "modes.toml")
    file = tmp_path / "again.toml"
    file.write_text(scene_to_toml(scene))
    assert load_scene(file) == scene
    data = {
        "scenario": "modes",
        "plate": {"size": [0.01, 0.01, 0.001], "modules_through_thickness": 1},
        "material": {
            "youngs_modulus": 3e9, "poisson_ratio": 0.25, "density": 1e3, "damage": False,
        },
    }  # fmt: skip
    assert parse_scene(data).modes is None
    with pytest.raises(ValueError, match="missing table '\\[solver\\]'"):
        parse_scene(data | {"scenario": "impact"})
