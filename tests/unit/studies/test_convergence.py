"""The arithmetic of the convergence study; its runs are the study's own."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.paths import CONFIGS

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import load_scene
from taichi_ldem.studies.convergence import plan as plans
from taichi_ldem.studies.convergence import records, report
from taichi_ldem.studies.convergence.cracking import mean_of, places
from taichi_ldem.studies.convergence.run import (
    CRACKING,
    IMPACT,
    SEED_REACH,
    VIBRATION,
    WAVE,
    exact_wave,
    finite_elements,
    kind,
)
from taichi_ldem.studies.convergence.study import run


def _row(seconds: float, error: float, modules: int = 4, timed: bool = False) -> records.Row:
    record: dict[str, Any] = {"spacing_m": 1 / modules}
    return records.Row(plans.Point(modules, 0.5), {"x": error}, seconds, 0.5, 1e-7, record, timed)


@pytest.mark.parametrize("exponent", [1.0, 2.0, 0.7])
def test_the_order_of_a_power_law_is_found(exponent: float) -> None:
    sizes = np.array([0.1, 0.2, 0.5])
    assert report.order(list(sizes), list(3 * sizes**exponent)) == pytest.approx(exponent)


def test_a_polynomial_is_extrapolated_to_its_value_at_zero() -> None:
    sizes = np.array([1.0, 2.0, 3.0])
    assert records.extrapolated(list(sizes), list(5 - sizes + 2 * sizes**2), 2) == pytest.approx(5)
    assert records.extrapolated(list(sizes), list(5 - sizes), 1) == pytest.approx(5)


def test_a_single_error_has_no_order() -> None:
    assert np.isnan(report.order([0.1, 0.2], [0.0, 0.1]))


def test_the_front_holds_what_nothing_beats() -> None:
    rows = [_row(1, 0.5), _row(2, 0.6), _row(3, 0.1), _row(4, 0.1), _row(0.5, 1e-9, timed=True)]
    assert report.pareto(rows, "x") == [rows[0], rows[2]]


def test_errors_of_histories_are_relative_mean_squares() -> None:
    time_s = [0.0, 1.0, 2.0, 3.0]
    reference = {"time": time_s, "signals": {"f": [3.0, 4.0, 0.0, 9.0]}, "values": {"v": 2.0}}
    record = {"time": time_s, "signals": {"f": [3.0, 4.0, 1.0, 0.0]}, "values": {"v": 1.9}}
    # |(0, 0, 1)| over |(3, 4, 0)|: the last row, which may be a step late, is left out
    assert records.differences(record, reference) == pytest.approx({"f": 0.2, "v": 0.05})


def test_a_wave_that_comes_late_is_slow() -> None:
    time_s = np.linspace(0.0, 10.0, 401)

    def pulse(at: float) -> list[float]:
        return list(np.exp(-((time_s - at) ** 2)))

    reference = {"time": list(time_s), "signals": {"displacement": pulse(5.0)}, "flight_s": 4.0}
    record = {"time": list(time_s), "signals": {"displacement": pulse(5.2)}}
    # over the same distance in 4.2 instead of 4 s: 1 - 4 / 4.2
    assert records.differences(record, reference)["speed"] == pytest.approx(0.2 / 4.2, rel=1e-3)


def test_advice_names_the_cheapest_that_is_good_enough() -> None:
    study = records.Study(Path(), load_scene(CONFIGS / "wave.toml"), WAVE, Path(),
                       plans.Plan((4,), 0, 4, "x"))  # fmt: skip
    rows = [_row(1, 0.04, 2), _row(2, 0.02, 3), _row(9, 0.009, 8)]
    one, five = report.advice(study, rows)
    assert "choose 8 modules" in one
    assert "costs 9 s" in one
    assert "choose 2 modules" in five
    assert "None of these" in report.advice(study, rows[:2])[0]


def _wave_records(study: records.Study, folder: Path) -> None:
    """Records of pulses that come late by h^2, and early by a hundredth of the step squared."""
    time_s, scene = np.linspace(0.0, 10.0, 401), study.scene

    def write(name: str, at: float, **more: object) -> None:
        pulse = {"displacement": list(np.exp(-((time_s - at) ** 2)))}
        record = {"time": list(time_s), "signals": pulse, **more}
        (folder / f"{name}.json").write_text(json.dumps(record))

    exact = {"flight_s": 4.0, "speed_m_s": 1677.0, "continuum_m_s": 1678.0}
    write("reference", 5.0, **exact)
    fine = plans.Point(study.plan.timed, plans.FINE_STEP)
    for point in [*study.points(), *study.steps(), fine]:
        edge = scene.plate.size[2] / point.modules
        late = (edge / scene.plate.size[2]) ** 2 - 0.01 * point.share**2
        size = {"steps": 10, "bars": 10, "spacing_m": edge}
        step = {"share": point.share, "time_step_s": point.share * 1e-7}
        cost = dict.fromkeys(("cpu_s", "wall_s", "compile_s", "energy_error"), point.modules**4)
        write(point.name, 5.0 + late, **cost, **size, **step)


def test_a_wave_s_report_is_written_from_what_has_run(tmp_path: Path) -> None:
    file = CONFIGS / "wave.toml"
    study = records.Study(file, load_scene(file), WAVE, tmp_path, plans.PLANS[WAVE])
    study.claim(False)
    _wave_records(study, tmp_path)
    assert run(file, tmp_path) == 0
    assert (tmp_path / "convergence.png").stat().st_size > 10_000
    space, in_time = report.orders(study.rows())["speed"]
    # of second order in both, as made up; the step adds a little to the one in space
    assert space == pytest.approx(2.0, abs=0.1)
    assert in_time == pytest.approx(2.0, abs=0.1)
    text = (tmp_path / "convergence.md").read_text()
    assert "For an error of 5 % in the speed, choose 3 modules" in text  # 1 - 4 / 4.11 = 2.7 %
    with (tmp_path / "convergence.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(study.points()) + len(study.steps())


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("impact_convergence", IMPACT),
        ("modes_convergence", VIBRATION),
        ("modes_convergence_clamped", VIBRATION),
        ("impact_convergence_cracking", CRACKING),
        ("wave", WAVE),
    ],
)
def test_scenes_say_what_they_are_a_reference_for(name: str, what: str) -> None:
    scene = load_scene(CONFIGS / f"{name}.toml")
    assert kind(scene) == what
    plan = plans.PLANS[what]
    for modules in (*plan.modules, plan.reference or 4):  # every side a whole number of modules
        finer = load_scene(CONFIGS / f"{name}.toml", [f"plate.modules_through_thickness={modules}"])
        np.testing.assert_allclose(finer.plate.actual_size, scene.plate.size, rtol=1e-12)


def test_a_scene_that_is_no_reference_is_refused() -> None:
    with pytest.raises(SceneError, match="a convergence study needs"):
        kind(load_scene(CONFIGS / "tension.toml"))


def test_a_clamped_plate_needs_finite_elements(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SceneError, match="install scikit-fem"):
        run(CONFIGS / "modes_convergence_clamped.toml", tmp_path)


def test_finite_elements_approach_kirchhoffs_clamped_plate() -> None:
    # thin: 24 mm between clamped edges, 0.6 mm thick, nu = 0.25: a clamped circular plate has
    # f = 10.2158 / (2 pi a^2) sqrt(D / (rho h)) (Leissa, Vibration of Plates, Table 2.1)
    settings = ["plate.size=[0.032, 0.032, 0.0006]", "plate.modules_through_thickness=2"]
    scene = load_scene(CONFIGS / "modes_convergence_clamped.toml", settings)
    found = finite_elements(scene, (1,))["values"]["frequency"]
    m, h = scene.material, scene.plate.actual_size[2]
    bending = m.youngs_modulus * h**3 / (12 * (1 - m.poisson_ratio**2))
    kirchhoff = 10.2158 / (2 * np.pi * 0.012**2) * (bending / (m.density * h)) ** 0.5
    # faces held over 3 mm only, and shear: softer by some per cent
    assert 0.9 < found / kirchhoff < 1.0


@pytest.mark.slow
def test_the_exact_wave_has_the_continuum_s_speed() -> None:
    exact = exact_wave(load_scene(CONFIGS / "wave.toml"), (2, 3, 4))
    # sections of 2, 3 and 4 modules are 3.6, 2.5 and 1.9 % slow
    assert exact["speed_m_s"] == pytest.approx(exact["continuum_m_s"], rel=2e-3)


def test_another_scene_s_runs_are_not_taken(tmp_path: Path) -> None:
    scenes = [load_scene(CONFIGS / f"{name}_convergence.toml") for name in ("impact", "modes")]
    first, second = (
        records.Study(Path(), scene, IMPACT, tmp_path, plans.PLANS[IMPACT]) for scene in scenes
    )
    first.claim(False)
    first._own(tmp_path / "2_modules.json")
    (tmp_path / "2_modules.json").write_text("{}")
    first.claim(False)
    with pytest.raises(SceneError, match="another scene"):
        second.claim(False)
    (tmp_path / "mine.json").write_text("precious")
    with pytest.raises(SceneError, match=r"mine.json' is no record of this study"):
        second.claim(True)
    assert [file.name for file in tmp_path.glob("*.json")] == ["mine.json"]
    (tmp_path / "mine.json").unlink()
    second.claim(True)


def test_confidence_intervals_are_student_s() -> None:
    # t(0.975, 2) = 4.3027 (any table), deviation 1, three values
    assert mean_of([1.0, 2.0, 3.0]) == pytest.approx((2.0, 4.3027 / 3**0.5), rel=1e-4)
    assert np.isnan(mean_of([1.0])[1])
    assert np.isnan(mean_of([])[0])


def test_the_striker_s_places_are_the_same_every_time() -> None:
    scene = load_scene(CONFIGS / "impact_convergence_cracking.toml")
    found = places(scene, 4)
    assert found == places(scene, 4)
    assert len(set(found)) == 4
    assert np.abs(found).max() <= SEED_REACH * scene.plate.size[2]
