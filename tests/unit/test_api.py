"""The Python interface, in processes of their own: it starts Taichi, which the tests share."""

import copy
import os
import pickle
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.paths import ROOT
from support.refusals import one_line

from taichi_ldem import Scene, SceneError, Simulation, run
from taichi_ldem.scene import parse_scene
from taichi_ldem.solver import backend

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
print("== pieces:", third.fragments.number.tolist(), third.fragments.nodes.tolist())
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


class Engine:
    """Stands in for the solver: samples at 0, 1, 2, 3 s in steps of a quarter of a second."""

    time_step = 0.25

    def __init__(self) -> None:
        self.time = 0.0
        self.dynamics = SimpleNamespace(masses=lambda: np.arange(8.0).reshape(2, 2, 2, 1))

    def samples(self) -> Iterator[SimpleNamespace]:
        while self.time <= 3.0:
            at = float(np.ceil(self.time))
            self.time = at + self.time_step
            yield SimpleNamespace(time=at)

    def advance(self, count: int) -> None:
        self.time += count * self.time_step

    def guard(self, sample: object) -> None:
        pass


@pytest.fixture
def simulation(monkeypatch: pytest.MonkeyPatch) -> Simulation:
    """A simulation without Taichi."""
    made = object.__new__(Simulation)
    made._engine, made._samples, made._callbacks = Engine(), [], []
    made._exists = np.ones((2, 2, 2, 1), dtype=bool)
    monkeypatch.setattr(Simulation, "history", property(lambda self: len(self._samples)))
    return made


def test_running_until_a_time_that_has_passed_takes_no_step(simulation: Simulation) -> None:
    assert simulation.run(until=1.0) == 2
    reached = simulation.time
    for passed in (1.0, 0.5, 0, -1.0, float("-inf"), np.float32(1.0)):
        assert simulation.run(until=passed) == 2
        assert simulation.time == reached
    assert simulation.run(until=2.0) == 3
    for no_time in (float("nan"), np.nan):
        with pytest.raises(ValueError, match="until = nan: must be a time in seconds"):
            simulation.run(until=no_time)
    with pytest.raises(TypeError, match="integer"):
        simulation.step(1.5)  # type: ignore[arg-type]
    assert simulation.time == 2.25
    assert simulation.run() == 4


def test_the_masses_of_nodes_are_public(simulation: Simulation) -> None:
    np.testing.assert_array_equal(simulation.masses, np.arange(8.0))


def in_a_thread(work: Callable[[], object]) -> list[object]:
    """What work returns, or raises, in another thread."""
    found: list[object] = []

    def catch() -> None:
        try:
            found.append(work())
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=catch, name="other")
    thread.start()
    thread.join(10)
    return found


def test_a_second_thread_is_refused_while_the_first_works(simulation: Simulation) -> None:
    refused: list[object] = []
    tried = (
        lambda: Simulation(ELASTIC),
        lambda: simulation.run(),
        lambda: simulation.masses,
        lambda: run(ELASTIC, "nowhere"),
    )
    simulation._callbacks = [lambda *_: refused.extend(e for f in tried for e in in_a_thread(f))]
    simulation.run(until=0.0)
    assert len(refused) == len(tried)
    for error in refused:
        assert isinstance(error, RuntimeError)
        assert "another thread is using a simulation" in str(error)
        assert "\n" not in str(error)
    assert in_a_thread(lambda: simulation.run(until=1.0)) == [2]  # later it may


def test_a_simulation_that_another_thread_has_open_is_not_closed(simulation: Simulation) -> None:
    simulation._thread = threading.current_thread()
    Simulation._open.add(simulation)
    try:
        (error,) = in_a_thread(lambda: Simulation(ELASTIC))
    finally:
        Simulation._open.discard(simulation)
    assert isinstance(error, RuntimeError)
    assert "a simulation is open in the thread 'MainThread'" in str(error)


def test_two_redirections_of_stdout_do_not_overlap() -> None:
    before = os.fstat(1)
    inside, leave = threading.Event(), threading.Event()

    def first() -> None:
        with backend._silent_stdout():
            inside.set()
            leave.wait(10)

    def second() -> None:
        with backend._silent_stdout():
            pass

    threads = [threading.Thread(target=work) for work in (first, second)]
    threads[0].start()
    assert inside.wait(10)
    threads[1].start()
    leave.set()
    for thread in threads:
        thread.join(10)
    assert os.path.samestat(os.fstat(1), before)


ELASTIC: dict[str, Any] = {
    "scenario": "impact",
    "plate": {"size": [1e-3] * 3, "modules_through_thickness": 2},
    "material": {
        "youngs_modulus": 3e9,
        "poisson_ratio": 0.25,
        "density": 1e3,
        "damage": False,
    },
    "solver": {"duration": 1e-5},
}


def test_numpys_numbers_are_taken_in_a_scene() -> None:
    tables = {name: dict(v) if isinstance(v, dict) else v for name, v in ELASTIC.items()}
    tables["plate"] |= {"size": np.full(3, 1e-3), "modules_through_thickness": np.int64(2)}
    tables["material"] |= {"damage": np.bool_(False), "density": np.float32(1e3)}
    assert Scene(**tables) == parse_scene(tables) == parse_scene(ELASTIC)
    tables["plate"]["modules_through_thickness"] = np.float64(2.5)
    with pytest.raises(SceneError, match=r"modules_through_thickness = 2\.5: must be a whole"):
        Scene(**tables)


def test_a_scene_made_from_tables_is_refused_in_one_line() -> None:
    held: list[object] = []
    held.append(held)
    for change, message in (
        ({"plate": {"size": [1e-3] * 2, "modules_through_thickness": 2}}, "must be a list of 3"),
        ({"plate": held}, "scene: nested too deeply"),
        ({"plat": {}}, "unknown key 'plat'"),
        ({"solver": {}}, "missing key 'solver.duration'"),
    ):
        with pytest.raises(SceneError) as error:
            Scene(**(ELASTIC | change))
        assert message in one_line(error)
    made = Scene(**ELASTIC)
    assert pickle.loads(pickle.dumps(made)) == copy.deepcopy(made) == made.model_copy() == made


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
    assert printed["pieces"].endswith("[1] [35]")
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
