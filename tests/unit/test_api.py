"""The Python interface, in processes of their own: it starts Taichi, which the tests share."""

import os
import re
import subprocess
import sys

import pytest
from support.paths import ROOT

from taichi_ldem import Scene, SceneError
from taichi_ldem.scene import parse_scene

EXAMPLES = """
import runpy, sys
from taichi_ldem import Simulation
for name in sys.argv[1:]:
    print("==", name)
    made = runpy.run_path(f"examples/{name}.py")
"""
CHECKS = """
old = made["simulation"]

# closed: says so, and keeps what was taken
try:
    old.time
except RuntimeError as error:
    print("== closed:", error)
elastic = {"scenario": "impact", "plate": {"size": [1e-3] * 3, "modules_through_thickness": 2},
    "material": {"youngs_modulus": 3e9, "poisson_ratio": 0.25, "density": 1e3, "damage": False},
    "solver": {"duration": 1e-5}}
first = Simulation(elastic)
second = Simulation(first.scene, beside=True)
print("== beside:", first.time == second.time == 0.0)
try:
    Simulation(first.scene.changed("solver.precision=f32"), beside=True)
except ValueError as error:
    print("== other precision:", error)
third = Simulation(elastic)
print("== afresh:", repr(first), repr(third), third.broken_bars.bar.size, third.history.keys())
third.close()
third.close()
"""


def _python(*words: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_the_package_is_quick_and_imports_nothing() -> None:
    heavy = "{'taichi', 'numpy', 'pydantic', 'matplotlib'}"
    printed = _python(
        "-c",
        f"import sys, taichi_ldem; print({heavy} & set(sys.modules), dir(taichi_ldem))\n"
        "from taichi_ldem import Scene; print('taichi' in sys.modules)\n"
        "from taichi_ldem import Simulation; print('taichi' in sys.modules)",
    )
    first, *rest = printed.splitlines()
    assert first.startswith("set()")
    assert "Simulation" in first
    assert rest == ["False", "False"]


def test_an_unknown_name_is_refused() -> None:
    import taichi_ldem

    with pytest.raises(AttributeError, match="no attribute 'Simulaton'"):
        _ = taichi_ldem.Simulaton


def _printed(program: str, *examples: str) -> dict[str, str]:
    """What each example printed, and the checks of the program."""
    parts = re.split(r"^== (\w+(?: \w+)?):?", _python("-c", program, *examples), flags=re.M)
    return {name: text.strip() for name, text in zip(parts[1::2], parts[2::2], strict=True)}


@pytest.fixture(scope="module")
def printed() -> dict[str, str]:
    return _printed(EXAMPLES + CHECKS, "first_steps", "callback")


@pytest.fixture(scope="module")
def printed_by_others() -> dict[str, str]:
    return _printed(EXAMPLES, "sweep", "own_law")


def test_first_steps(printed: dict[str, str]) -> None:
    text = printed["first_steps"]
    # 36 x 36 x 3 modules: 37 x 37 x 4 corners and 36 x 36 x 3 centres
    assert f"{37 * 37 * 4 + 36 * 36 * 3:,} nodes" in text
    depth = float(re.search(r"deepest: ([\d.]+) mm at x = -?0.00, y = -?0.00", text)[1])
    assert 0.1 < depth <= 0.2  # a striker of 4 m/s has gone 0.2 mm in 50 us at most
    assert float(re.search(r"largest force (\d+) N", text)[1]) > 100


def test_a_callback_stops_a_run(printed: dict[str, str]) -> None:
    radii = [float(r) for r in re.findall(r"out to ([\d.]+) mm", printed["callback"])]
    assert radii == sorted(radii)
    assert radii[-1] > 2.0 >= radii[-2]
    assert "finished = False" in printed["callback"]


@pytest.mark.slow
def test_a_sweep_in_one_process(printed_by_others: dict[str, str]) -> None:
    rows = [line.split() for line in printed_by_others["sweep"].splitlines()[1:]]
    forces, broken = ([float(row[column]) for row in rows] for column in (1, 2))
    assert forces[0] < forces[1]
    assert 0 < broken[0] < broken[1]


@pytest.mark.slow
def test_a_law_of_ones_own_dissipates_g_f(printed_by_others: dict[str, str]) -> None:
    found, given = map(
        float, re.search(r"([\d.]+) J/m2, given: ([\d.]+)", printed_by_others["own_law"]).groups()
    )
    assert found == pytest.approx(given, rel=1e-6)


def test_what_a_second_simulation_does(printed: dict[str, str]) -> None:
    assert printed["closed"].startswith("this simulation is closed")
    assert printed["beside"] == "True"
    assert "must be those of the simulation that stays open" in printed["other precision"]
    assert "<Simulation of impact, closed>" in printed["afresh"]
    assert "35 nodes" in printed["afresh"]  # 27 corners, 8 centres
    assert "'time_s', 'kinetic_plate_j', 'strain_j', 'energy_error'" in printed["afresh"]


def test_a_changed_scene_keeps_what_follows_from_other_keys() -> None:
    scene = Scene.load(ROOT / "examples/plate.toml")
    changed = scene.changed("solver.duration=1e-4", "striker.velocity=2")
    assert changed.striker.velocity == 2.0
    assert changed.output.field_interval == pytest.approx(1e-5)  # a tenth
    assert changed.changed("solver.duration=3e-4", "striker.velocity=5") == scene
    with pytest.raises(SceneError, match="unknown section 'stricker'"):
        scene.changed("stricker.velocity=2")
    with pytest.raises(SceneError, match=r'law = "parabolic": must be "bilinear" or "exponential"'):
        scene.changed("material.law=parabolic")


def test_a_scenario_that_does_not_start_from_rest_is_refused() -> None:
    from taichi_ldem import Simulation

    data = {
        "scenario": "modes",
        "plate": {"size": [1e-3, 1e-3, 1e-3], "modules_through_thickness": 2},
        "material": {
            "youngs_modulus": 3e9,
            "poisson_ratio": 0.25,
            "density": 1e3,
            "damage": False,
        },
    }
    with pytest.raises(SceneError, match=r"taichi_ldem\.run"):
        Simulation(parse_scene(data))
