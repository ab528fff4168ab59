"""The series over notches: its specimens, what it runs again, and the slope it finds."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.paths import CONFIGS

from taichi_ldem.cli import main
from taichi_ldem.scene import load_scene
from taichi_ldem.studies import bending, compliance

BASE = load_scene(CONFIGS / "bend.toml")
SERIES = [
    bending.Specimen(*beam, spacing) for spacing in bending.SPACINGS for beam in bending.SPECIMENS
]


@pytest.mark.parametrize("specimen", SERIES, ids=lambda s: s.name)
def test_every_specimen_is_a_valid_scene_within_the_paper_s_ranges(
    specimen: bending.Specimen,
) -> None:
    scene = specimen.scene(BASE)
    assert scene.plate.spacing == pytest.approx(specimen.spacing, rel=1e-12)
    assert scene.plate.actual_size[1:] == pytest.approx((3e-3, specimen.width), rel=1e-12)
    # the paper: W 6.21 to 7.26 mm, a 1.9 to 6.38 mm; a is rounded by half a module at most
    assert 6.21e-3 <= specimen.width <= 7.26e-3
    assert 1.9e-3 <= specimen.notch <= 6.38e-3
    assert abs(specimen.depth - specimen.notch) <= specimen.spacing / 2 + 1e-12
    assert scene.notch[0].bounds == ((-1.5e-3, 1.5e-3), (0.0, specimen.depth))


def test_names_tell_the_specimens_apart() -> None:
    assert len({specimen.name for specimen in SERIES}) == len(SERIES)


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Commands that would have been run; each is taken to fail with exit code 3."""
    commands: list[list[str]] = []

    def record(command: list[str], **_: object) -> int:
        commands.append(command)
        return 3

    monkeypatch.setattr(bending, "run_child", record)
    return commands


def test_a_finished_specimen_is_not_run_again(tmp_path: Path, ran: list[list[str]]) -> None:
    done, missing = SERIES[:2]
    (tmp_path / done.name).mkdir()
    for name in ("summary.json", "statics.json"):
        (tmp_path / done.name / name).write_text("{}")
    for specimen in (done, missing):
        bending.run(specimen, BASE, tmp_path, [])
    (command,) = ran
    file = Path(command[command.index("bend") + 1])
    assert load_scene(file) == missing.scene(BASE)


def test_the_command_runs_a_series_on_the_scene_s_modules(
    tmp_path: Path, ran: list[list[str]]
) -> None:
    words = [
        "bend",
        str(CONFIGS / "bend_quick.toml"),
        "--series",
        "--out",
        str(tmp_path / "series"),
    ]
    assert main([*words, "--set", "solver.duration=9e-4"]) == 3
    scenes = [load_scene(Path(command[command.index("bend") + 1])) for command in ran]
    assert len(scenes) == len(bending.SPECIMENS)
    assert {scene.plate.spacing for scene in scenes} == {5e-4}
    assert {scene.solver.duration for scene in scenes} == {9e-4}
    assert main(["bend", str(CONFIGS / "tension.toml"), "--series"]) == 2


def test_a_perfectly_brittle_series_gives_its_fracture_energy(tmp_path: Path) -> None:
    """Beams whose strain energy at the peak is G B W phi, with a tenth of it in dents."""
    given = 1000.0
    for specimen in SERIES[:8]:
        alpha, beta = specimen.depth / specimen.width, 24e-3 / specimen.width
        unit = 3.35e9 * 3e-3
        published = compliance.whole_beam(beta) + compliance.added_by_notch(alpha, beta)
        dents = 1 / 9 * published
        statics = {
            "whole_m_n": (compliance.whole_beam(beta) + dents) / unit,
            "notched_m_n": (published + dents) / unit,
        }
        area = 3e-3 * specimen.width * compliance.calibration(alpha, beta)
        strain = given * area / 0.9
        keys = ("work", "kinetic", "contact", "fracture", "time")
        summary = {f"peak_{key}_j": 0.0 for key in keys} | {"peak_time_s": 0.0}
        summary |= {"peak_strain_j": strain, "absorbed_j": strain}
        summary |= {"fracture_per_ligament_j_m2": given, "fracture_j": 1e-2}
        summary |= {"fracture_beside_plane_j": 1e-3, "strain_end_j": 0.0, "kinetic_end_j": 0.0}
        folder = tmp_path / specimen.name
        folder.mkdir()
        (folder / "summary.json").write_text(json.dumps(summary))
        (folder / "statics.json").write_text(json.dumps(statics))
    bending.report(bending.read(SERIES, BASE, tmp_path), BASE, tmp_path)
    numbers = json.loads((tmp_path / "summary.json").read_text())
    assert numbers["fracture_energy_slope"] == pytest.approx(given, rel=1e-9)
    (line,) = numbers["lattices"]
    assert line["slope_through_origin"] == pytest.approx(given, rel=1e-9)
    assert abs(line["intercept_j"]) < 1e-9
    assert line["beside_plane"] == pytest.approx(0.1, rel=1e-12)
    assert len(numbers["specimens"]) == 8
    assert (tmp_path / "bending.png").stat().st_size > 10_000
    text = (tmp_path / "bending.md").read_text()
    assert "| 0.5 | 3 | 8 | 1000 |" in text


def test_the_line_s_confidence_is_student_s() -> None:
    """Anscombe's first set (1973): slope 0.5001 with standard error 0.1179, eleven points."""
    x = np.array([10, 8, 13, 9, 11, 14, 6, 4, 12, 7, 5], dtype=float)
    y = np.array([8.04, 6.95, 7.58, 8.81, 8.33, 9.96, 7.24, 4.26, 10.84, 4.82, 5.68])
    others = {
        "spacing_m": 1.0,
        "thickness_m": 1.0,
        "fracture_per_ligament_j_m2": 1.0,
        "beside_plane": 0.0,
    }
    rows = [others | {"b_w_phi_m2": a, "energy_j": b} for a, b in zip(x, y, strict=True)]
    line = bending.fit(rows)
    assert line["fracture_energy_slope"] == pytest.approx(0.5001, abs=1e-4)
    assert line["confidence_95"] == pytest.approx(2.2622 * 0.1179, rel=1e-3)  # t(0.975, 9)
    assert line["intercept_j"] == pytest.approx(3.0001, abs=1e-4)
