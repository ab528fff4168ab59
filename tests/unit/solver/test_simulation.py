import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import DAMAGE, SPACING, block_scene
from support.paths import ROOT
from support.reference import Body

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


def _shake(simulation: "Simulation", body: Body, speed: float) -> None:
    noise = np.random.default_rng(9).normal(0.0, speed, (len(body.places), 3))
    simulation.start_from(np.zeros((2, *simulation.dynamics.sites, 3)), body.spread(noise))


def test_samples_come_at_the_history_s_times(
    elastic: "Simulation", body: Body, monkeypatch: pytest.MonkeyPatch
) -> None:
    interval = elastic.scene.output.history_interval  # 1e-5 s, as long as a whole number of steps
    from taichi_ldem.solver.stability import chosen_time_step

    step, every = chosen_time_step(elastic.scene, elastic.critical_time_step)
    assert step * every == pytest.approx(interval, rel=1e-14)
    largest = elastic.scene.solver.safety * elastic.critical_time_step
    assert largest / (1 + 1 / (every - 1)) < step <= largest
    monkeypatch.setattr(elastic, "time_step", step)
    monkeypatch.setattr(elastic, "steps", 3 * every + 2)
    _shake(elastic, body, 1e-3)
    times = [sample.time for sample in elastic.samples()]
    end = elastic.steps * step  # within an interval, and sampled all the same
    assert times == pytest.approx([0.0, interval, 2 * interval, 3 * interval, end], rel=1e-12)
    assert elastic.step_number == elastic.steps + 1


def test_sampling_changes_nothing(elastic: "Simulation", body: Body) -> None:
    ends = []
    for looks in (0, 10):
        for name in ("displacement", "velocity"):
            for field in elastic.dynamics.fields()[name]:
                field.fill(0)
        elastic.now = elastic.step_number = 0
        _shake(elastic, body, 1.0)
        for _ in range(looks):
            elastic.sample_step()
        elastic.advance(20 - looks)
        ends.append(elastic.displacement())
    np.testing.assert_array_equal(*ends)


def test_whole_passes_take_the_numbers_of_the_step(taichi: None) -> None:
    """The kernel of a GPU, on a body in free flight: u = v dt."""
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(block_scene(3, 3, 1), in_strips=False)
    exists = simulation.dynamics.lattice.exists()[..., None]
    velocity = np.array([1.0, -2.0, 3.0]) * exists
    simulation.start_from(np.zeros_like(velocity), velocity)
    simulation.advance(1)
    np.testing.assert_allclose(
        simulation.displacement(), simulation.time_step * velocity, rtol=0, atol=1e-20
    )


def test_an_unstable_run_is_stopped_and_told_why(
    elastic: "Simulation", body: Body, monkeypatch: pytest.MonkeyPatch
) -> None:
    from taichi_ldem.errors import SimulationStopped

    monkeypatch.setattr(elastic, "time_step", 1.2 * elastic.critical_time_step)
    monkeypatch.setattr(elastic, "steps", 10_000)
    _shake(elastic, body, 1e-3)
    with pytest.raises(SimulationStopped, match=r"t = .*, step \d+: .*above the critical") as stop:
        list(elastic.samples())
    assert "\n" not in str(stop.value)
    assert elastic.step_number < 1000


def test_a_nan_is_told_with_its_place(elastic: "Simulation", body: Body) -> None:
    from taichi_ldem.errors import SimulationStopped

    _shake(elastic, body, 1e-3)
    samples = elastic.samples()
    next(samples)
    velocity = elastic.dynamics.get_velocity()
    velocity[0, 1, 2, 3, 0] = np.nan  # corner (i, j, k) = (2, 1, 0): x = -8 L, y = -L/2, z = 0
    elastic.dynamics.set_velocity(velocity)
    with pytest.raises(SimulationStopped, match="not finite") as stop:
        list(samples)
    # NaN spreads by one module a step until the next sample, so the place is near, not exact
    assert "node x = " in str(stop.value)
    assert stop.value.args[0].startswith("t = ")


@pytest.mark.parametrize(
    ("ledger", "said"),
    [
        # the striker of 1 MJ hides the plate's 0.2 J out of 1 J from the total error
        ({"kinetic_bodies": 1e6, "strain": 1.2, "external": 1.0}, "of what the plate holds"),
        ({"kinetic_bodies": 1e6, "kinetic_plate": 1.0, "contact": -1.0}, "contact gave the plate"),
        ({"kinetic_bodies": 1.1e6}, "the energy error reached 10 %"),
    ],
)
def test_the_guard_looks_at_the_plate_itself(
    elastic: "Simulation", ledger: dict[str, float], said: str
) -> None:
    from taichi_ldem.errors import SimulationStopped
    from taichi_ldem.solver.energy import Ledger

    sample, start = elastic.sample_step(), Ledger(kinetic_bodies=1e6)

    def look(end: Ledger) -> None:
        elastic.initial_ledger = start
        elastic.guard(replace(sample, ledger=end, energy_error=end.error(start)))

    with pytest.raises(SimulationStopped, match=said):
        look(Ledger(**ledger))
    look(Ledger(kinetic_bodies=1e6 - 1, strain=1.0))


def test_a_ledger_from_before_pieces_could_touch_is_restored(elastic: "Simulation") -> None:
    from taichi_ldem.solver.saving import BEFORE_PIECES

    elastic.sample_step()
    saved = elastic.saved_state()
    start = elastic.initial_ledger
    elastic.restore_state(saved | {"ledger/start": saved["ledger/start"][:BEFORE_PIECES]})
    assert elastic.initial_ledger == start


@pytest.mark.parametrize(
    ("share", "strain", "cause"),
    [
        (0.9, 0.3, "stretched bars lower the critical time step"),
        (0.5, -0.9, "a bar near zero length turns round"),
        (0.5, 0.01, "a collision too fast"),
    ],
)
def test_the_guard_names_what_bars_suffer(
    elastic: "Simulation", body: Body, share: float, strain: float, cause: str
) -> None:
    from taichi_ldem.solver import guard

    elastic.time_step = share * elastic.critical_time_step
    elastic.dynamics.set_displacement(1, body.spread(strain * body.positions))
    assert cause in guard.likely_cause(elastic, None)


def test_a_clamp_that_holds_nothing_is_refused(taichi: None) -> None:
    from taichi_ldem.solver.simulation import Simulation

    # the corners of the four modules in the middle lie 1.41 modules off it
    plate = {"shape": "disc", "diameter": 3 * SPACING}
    clamp = {"kind": "rim", "inner_diameter": 3 * SPACING}
    with pytest.raises(SceneError, match=r"^clamp\.inner_diameter = .*holds no node"):
        Simulation(block_scene(4, 4, 1, plate=plate, clamp=clamp))


# -- reset -----------------------------------------------------------------------------------------

HIT = {"diameter": 2e-3, "mass": 1e-3, "velocity": 15.0}
RINGS = {"kind": "rings", "inner_diameter": 3.2e-3, "outer_diameter": 4.8e-3}


def _cracking(**tables: Any) -> Scene:
    """A plate of 10 x 10 x 2 modules that cracks within 40 us."""
    given: dict[str, Any] = {
        "material": DAMAGE,
        "striker": HIT,
        "clamp": RINGS,
        "disorder": {"fracture_energy_cv": 0.2, "density_cv": 0.1, "seed": 1},
        "plate": {"perturbation": 0.1, "perturbation_seed": 1},
        "notch": [{"normal": "x", "position": 1e-3, "from": [-3e-3, 0], "to": [-2e-3, 5e-4]}],
        "solver": {"duration": 4e-5},
        "output": {"history_interval": 1e-6},
    }
    for name, table in tables.items():
        given[name] = given[name] | table if isinstance(given.get(name), dict) else table
    return block_scene(10, 10, 2, **given)


def _rows(simulation: "Simulation") -> list[tuple[Any, ...]]:
    return [
        (*vars(sample.ledger).values(), *sample.observed.values(), sample.broken_bars)
        for sample in simulation.samples()
    ]


@pytest.fixture
def without_estimate(taichi: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The estimate of the critical time step compiles kernels; here it is a number."""
    from taichi_ldem.solver import stability

    monkeypatch.setattr(stability, "critical_time_step", lambda dynamics: 1e-8)


@pytest.fixture(scope="module")
def built(taichi: None) -> list["Simulation"]:
    """A simulation that is not run, as soon as a test has put it here."""
    return []


@pytest.mark.slow
def test_a_reset_simulation_runs_as_a_fresh_one_to_the_last_bit(taichi: None) -> None:
    from taichi_ldem.solver.simulation import Simulation

    used = Simulation(_cracking())
    assert _rows(used)[-1][-1] > 10  # it has run to its end and broken bars
    other = _cracking(
        plate={"perturbation_seed": 2},
        disorder={"seed": 2},
        material={"fracture_energy": 800.0},
        striker={"velocity": 18.0, "mass": 2e-3, "diameter": 1.6e-3, "gap": 1e-6},
        clamp={"inner_diameter": 3.6e-3},
        notch=[{"normal": "y", "position": 1e-3, "from": [-3e-3, 0], "to": [-2e-3, 5e-4]}],
        solver={"duration": 3e-5, "safety": 0.6},
    )
    fresh = Simulation(other)
    used.reset(other)
    assert used.drawn == fresh.drawn
    rows = _rows(fresh)
    assert rows[-1][-1] > 10
    assert _rows(used) == rows
    np.testing.assert_array_equal(used.displacement(), fresh.displacement())
    for mine, its in zip(used.dynamics.new_broken(), fresh.dynamics.new_broken(), strict=True):
        np.testing.assert_array_equal(mine, its)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"solver": {"damping": 10.0}}, "damping: True needs other kernels"),
        ({"material": {"law": "exponential"}}, "law: exponential needs other kernels"),
        ({"striker": {"shape": "cylinder"}}, "striker: cylinder needs other kernels"),
        ({"striker": {"guided": False}}, "striker: hemisphere, not guided needs other kernels"),
        ({"striker": {"motion": "prescribed"}}, "striker: hemisphere, prescribed needs other"),
        ({"clamp": {"kind": "bonded"}}, "rings: fixed nodes needs other kernels"),
        ({"striker": {"friction": 0.3}}, r"striker: friction = 0\.3 needs other kernels than 0"),
        ({"clamp": {"friction": 0.0}}, "rings: friction = 0 needs other kernels than inf"),
        ({"plate": {"gravity": [0.0, 0.0, -9.81]}}, "gravity: True needs other kernels"),
        ({"contact": {"landing": "elastic"}}, r"contact\.landing: needs other kernels"),
        ({"floor": {}}, "floor: no other bodies can be added"),
        ({"plate": {"modules_through_thickness": 3}}, "plate: .* need other fields"),
        ({"solver": {"precision": "f32"}}, r"solver\.precision: "),
        ({"supports": {"span": 4e-3, "diameter": 1e-3}, "clamp": {"kind": "free"}}, "rings: no"),
    ],
)
def test_a_scene_that_needs_other_kernels_is_no_reset(
    without_estimate: None, built: list["Simulation"], change: dict[str, Any], said: str
) -> None:
    from taichi_ldem.solver.simulation import Simulation

    if not built:
        built.append(Simulation(_cracking()))
    with pytest.raises(ValueError, match=said):
        built[0].reset(_cracking(**change))


# -- whole runs, each in a process of its own ------------------------------------------------------

RUN = """
import json, sys
import numpy as np
sys.path.insert(0, "tests")
from support.blocks import DAMAGE, block_scene
from taichi_ldem.solver import backend

precision, threads, variant, out = sys.argv[1], int(sys.argv[2]), *sys.argv[3:]
variants = {"gone": {}, "closing": {"after_failure": "closing"}}
variants["crack"] = variants["closing"] | {"fracture": "crack"}
variants["viscous"] = variants["crack"] | {"crack_opening": "viscous"}
variants["strain"] = variants["crack"] | {"tip_criterion": "strain"}
variants["cubic"] = variants["strain"]
variants["volumes"] = variants["crack"] | {"poisson_ratio": 0.36}
rubs = {"friction": 0.3} if variant == "floor" else {}
below = {"floor": {"gap": 1e-5} | rubs, "plate": {"gravity": [1e3, 0.0, -1e4]}} if rubs else {}
if variant in ("strain", "cubic"):
    lattice = {"strain": "module", "cubic": "cubic-26"}[variant]
    below = {"plate": {"perturbation": 0.07, "lattice": lattice}}
scene = block_scene(
    16, 16, 3,
    material=DAMAGE | variants.get(variant, {}),
    striker={"diameter": 2e-3, "mass": 1e-3, "velocity": 6.0, "gravity": 9.81} | rubs,
    clamp={"kind": "rings", "inner_diameter": 5.2e-3, "outer_diameter": 7.6e-3} | rubs,
    **below,
    solver={"duration": 1.5e-4, "precision": precision, "threads": threads},
    output={"history_interval": 1e-6},
)
backend.start(scene.solver)
from taichi_ldem.solver.simulation import Simulation

simulation = Simulation(scene)
columns = "striker_displacement_m", "striker_velocity_m_s", "striker_force_n", "ring_force_n"
rows = [
    (s.time, *(s.observed[column] for column in columns),
     s.broken_bars, s.energy_error, s.energy_error_of_plate, *vars(s.ledger).values())
    for s in simulation.samples()
]
sites, bars = simulation.dynamics.new_broken()
bars = np.column_stack([sites, bars])
np.savez(out, rows=rows, displacement=simulation.displacement(), bars=bars)
"""


class Runs:
    """A cracking plate under a striker, by precision and threads; each run when it is asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.done: dict[str, dict[str, np.ndarray]] = {}

    def __getitem__(self, name: str) -> dict[str, np.ndarray]:
        """The arrays of a run, by a name as "f64-2-gone": precision, threads, variant."""
        if name not in self.done:
            path = self.folder / f"{name}.npz"
            command = [sys.executable, "-c", RUN, *name.split("-"), str(path)]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
            assert done.returncode == 0, done.stderr[-2000:]
            assert done.stdout == ""  # Taichi's banner is kept off it
            with np.load(path) as data:
                self.done[name] = dict(data)
        return self.done[name]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return Runs(tmp_path_factory.mktemp("runs"))


TIME, TRAVEL, VELOCITY, FORCE, RING, BROKEN, ERROR, ERROR_OF_PLATE = range(8)


@pytest.mark.parametrize("precision", ["f64", pytest.param("f32", marks=pytest.mark.slow)])
def test_the_number_of_threads_changes_no_bit(runs: Runs, precision: str) -> None:
    one, two = runs[f"{precision}-1-gone"], runs[f"{precision}-2-gone"]
    for name in one:
        np.testing.assert_array_equal(one[name], two[name])


@pytest.mark.slow
@pytest.mark.parametrize(
    "variant", ["closing", "crack", "viscous", "strain", "cubic", "volumes", "floor"]
)
def test_variants_keep_bits_and_energy(runs: Runs, variant: str) -> None:
    one, two, gone = runs[f"f64-1-{variant}"], runs[f"f64-2-{variant}"], runs["f64-2-gone"]
    for name in one:
        np.testing.assert_array_equal(one[name], two[name])
    rows = two["rows"]
    assert rows[-1, BROKEN] > 20
    assert rows[-1, ERROR_OF_PLATE] < 0.03
    assert not np.array_equal(two["displacement"], gone["displacement"])


def test_the_plate_cracks_and_the_energy_is_there(runs: Runs) -> None:
    rows = runs["f64-2-gone"]["rows"]
    assert rows[-1, BROKEN] == len(runs["f64-2-gone"]["bars"]) > 20
    assert np.all(np.diff(rows[:, BROKEN]) >= 0)
    whole = rows[:, BROKEN] == 0
    assert rows[whole, ERROR].max() < 1e-5
    # a bar softens within a few steps, which the ledger sees: some per cent of what cracks took
    assert rows[:, ERROR].max() < 5e-3
    assert rows[-1, ERROR_OF_PLATE] < 0.03
    # the striker: dv/dt = g - F/m, with the mean force of every interval, which ends half a step
    # after the velocity's time: 0.1 us of at most 200 N on 1 g
    time, velocity = rows[:, TIME], rows[:, VELOCITY]
    impulse = np.cumsum(rows[1:, FORCE] * np.diff(time))
    expected = 6.0 + 9.81 * time[1:] - impulse / 1e-3
    np.testing.assert_allclose(velocity[1:], expected, atol=0.02)


@pytest.mark.slow
def test_single_precision_follows_double(runs: Runs) -> None:
    double, single = runs["f64-2-gone"]["rows"], runs["f32-2-gone"]["rows"]
    whole = double[:, BROKEN] == 0
    assert np.count_nonzero(whole) >= 3
    # the rings lie on the faces: not a rounding error of the module's edge inside
    assert single[0, RING] == double[0, RING] == 0
    scale = double[whole, FORCE].max()
    np.testing.assert_allclose(single[whole, FORCE], double[whole, FORCE], atol=1e-3 * scale)
    assert single[-1, BROKEN] == pytest.approx(double[-1, BROKEN], rel=0.1)
    assert single[-1, VELOCITY] == pytest.approx(double[-1, VELOCITY], rel=1e-3)
    assert single[whole, ERROR].max() < 1e-5
    assert single[:, ERROR].max() < 5e-3
