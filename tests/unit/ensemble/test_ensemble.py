"""Ensembles: what they consist of, what happens to members that fail, and what comes out.

Where the solver is not the point, a member is a small script.
"""

import io
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console
from scipy import stats
from support.paths import CONFIGS, SCENES
from support.synthetic import synthetic_run

from taichi_ldem.cli import main
from taichi_ldem.ensemble import attempt as attempts
from taichi_ldem.ensemble.attempt import FOLDER, PYTHON, Commands, Task, attempt, read_attempts
from taichi_ldem.ensemble.conduct import Conductor, duration, reached_time
from taichi_ldem.ensemble.figures import envelope, make_panels
from taichi_ldem.ensemble.plan import (
    ATTEMPTS,
    MEMBERS,
    Plan,
    make_plan,
    read_plan,
    refuse_other_plan,
    write_plan,
)
from taichi_ldem.ensemble.pools import LocalPool, local_workers
from taichi_ldem.ensemble.report import report
from taichi_ldem.ensemble.results import Row, read_rows, statistics, write_statistics, write_table
from taichi_ldem.ensemble.run import How, check, run
from taichi_ldem.ensemble.table3 import markdown
from taichi_ldem.errors import SceneError
from taichi_ldem.storage.durable import locked

SCENE = SCENES / "cracking.toml"
PAPER = CONFIGS / "impact.toml"
SPEEDS = "striker.velocity=2,2.5,3"

FAKE = """
import json, os, sys, time
folder, asked, how = sys.argv[1:]
name = os.path.basename(folder)
with open(os.path.join(folder, "runs"), "a") as file:
    file.write(how + "\\n")
count = len(open(os.path.join(folder, "runs")).readlines())
deeds = json.loads(asked).get(name, [])
deed = deeds[count - 1] if count <= len(deeds) else "finish"
if deed == "fail":
    print("first line", file=sys.stderr)
    print("error: the plate is " + name, file=sys.stderr)
    sys.exit(7)
if deed == "checkpoint":
    open(os.path.join(folder, "checkpoint.h5"), "w").close()
    sys.exit(4)
if deed == "refused":
    sys.exit(2)
if deed == "hang":
    time.sleep(60)
if deed == "die":
    os.kill(os.getpid(), 9)
with open(os.path.join(folder, "summary.json"), "w") as file:
    json.dump({"first_peak_force_n": 100.0 + count, "wall_s": 1.0}, file)
"""


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(attempts, "POLL", 0.02)
    monkeypatch.setattr(attempts, "STOP_POLL", 0.02)


@pytest.fixture
def fake(tmp_path):
    """Commands of members that do what is asked of their first, second ... run."""
    script = tmp_path / "fake.py"
    script.write_text(FAKE)

    def commands(**asked: list[str]) -> Commands:
        words = (PYTHON, "-I", "-S", str(script), FOLDER, json.dumps(asked))
        return Commands((*words, "begin"), (*words, "resume"))

    return commands


@pytest.fixture
def plan() -> Plan:
    return make_plan(SCENE, vary=[SPEEDS])


@pytest.fixture
def conduct(plan, tmp_path):
    """Runs the three members with given commands; exit code and the conductor."""
    folder = tmp_path / "ensemble"
    folder.mkdir()
    write_plan(plan, folder, 1)

    def go(commands: Commands, **options) -> tuple[int, Conductor]:
        pool = LocalPool(2)
        conductor = Conductor(plan, folder, pool, commands, **options)
        code = conductor.run()
        pool.close()
        return code, conductor

    go.folder = folder
    return go


def runs(folder: Path, name: str) -> list[str]:
    return (folder / MEMBERS / name / "runs").read_text().split()


def states(folder: Path, name: str) -> list[str]:
    return [outcome.state for outcome in read_attempts(folder, name)]


# --- the plan -------------------------------------------------------------------------------------


def names(**options) -> list[str]:
    return [member.name for member in make_plan(SCENE, **options).members]


def test_full_product_with_readable_names():
    assert names(vary=["striker.velocity=2,2.50", "striker.mass=0.04,5e-2"]) == [
        "velocity2_mass0.04",
        "velocity2_mass0.05",
        "velocity2.5_mass0.04",
        "velocity2.5_mass0.05",
    ]


def test_cv_by_seeds():
    plan = make_plan(SCENE, cv="0.10,0.5", seeds="3:5", vary=["disorder.density_cv=0.2"])
    assert [member.name for member in plan.members] == [
        f"cv{cv}_density_cv0.2_seed{seed}" for cv in ("0.1", "0.5") for seed in (3, 4)
    ]
    disorder = plan.members[-1].scene.disorder
    assert disorder is not None
    assert (disorder.fracture_energy_cv, disorder.density_cv, disorder.seed) == (0.5, 0.2, 4)
    assert plan.members[0].group == plan.members[1].group != plan.members[2].group


def test_no_variability_is_one_homogeneous_member_whatever_the_seeds():
    plan = make_plan(SCENE, cv="0,0.25", seeds="0:3")
    assert [m.name for m in plan.members] == ["cv0", *(f"cv0.25_seed{n}" for n in range(3))]
    assert plan.members[0].scene.disorder is None
    assert plan.members[0].varied == {"disorder.fracture_energy_cv": 0.0, "disorder.seed": None}


def test_no_variability_of_the_fracture_energy_beside_another_that_draws():
    vary = ["disorder.youngs_modulus_cv=0,0.1"]
    found = names(cv="0", seeds="0:2", vary=vary)
    assert found == ["cv0", "cv0_youngs_modulus_cv0.1_seed0", "cv0_youngs_modulus_cv0.1_seed1"]


def test_the_seed_is_that_of_perturbed_nodes_too():
    vary = ["plate.perturbation=0,0.05"]
    plan = make_plan(SCENE, cv="0,0.25", seeds="3:5", vary=vary)
    found = {member.name: member.scene for member in plan.members}
    assert list(found) == [
        "cv0_perturbation0",
        "cv0_perturbation0.05_seed3",
        "cv0_perturbation0.05_seed4",
        *(f"cv0.25_perturbation{p}_seed{n}" for p in ("0", "0.05") for n in (3, 4)),
    ]
    nodes = found["cv0_perturbation0.05_seed4"]
    assert (nodes.disorder, nodes.plate.perturbation_seed) == (None, 4)
    both = found["cv0.25_perturbation0.05_seed4"]
    assert both.disorder is not None
    assert (both.disorder.seed, both.plate.perturbation_seed) == (4, 4)
    alone = make_plan(SCENE, seeds="3:5", settings=["plate.perturbation=0.05"])
    assert [m.scene.plate.perturbation_seed for m in alone.members] == [3, 4]
    held = ["plate.perturbation=0.05", "plate.perturbation_seed=9"]
    kept = make_plan(SCENE, cv="0.25", seeds="3:5", settings=held)
    assert [m.scene.plate.perturbation_seed for m in kept.members] == [9, 9]


def test_values_with_commas_and_keys_of_one_last_word():
    vary = ["striker.position=[0.0,0.0],[1e-3,0.0]", "plate.size=[0.0192,0.0192,0.0016]"]
    assert names(vary=vary) == [
        "position0.0x0.0_size0.0192x0.0192x0.0016",
        "position1e-3x0.0_size0.0192x0.0192x0.0016",
    ]
    vary = ["striker.diameter=0.006,0.007", "plate.diameter=0.01"]
    with pytest.raises(SceneError, match="diameter"):
        names(vary=vary)


def test_settings_are_for_all_members():
    plan = make_plan(SCENE, vary=[SPEEDS], settings=["striker.mass=0.03"])
    assert {member.scene.striker.mass for member in plan.members} == {0.03}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "nothing is varied: give --cv, --seeds or --vary"),
        ({"cv": "0.1,x"}, "--cv 0.1,x: must be numbers of at least 0"),
        ({"cv": "-0.1"}, "--cv -0.1: must be numbers of at least 0"),
        ({"cv": "nan"}, "--cv nan: must be numbers of at least 0"),
        ({"cv": "0.1,0.10"}, "--cv 0.1,0.10: 0.1 is given twice"),
        ({"cv": "2", "seeds": "0:2"}, "fracture_energy_cv = 2.0: must be at most 1.5"),
        ({"cv": "0.1", "seeds": "4:4"}, "--seeds 4:4: must be whole numbers"),
        ({"cv": "0.1", "seeds": "-1"}, "--seeds -1: must be whole numbers"),
        ({"cv": "0.1", "seeds": "0:999999999"}, "must be at most 100000 seeds"),
        (
            {"vary": ["striker.velocity"]},
            "--vary striker.velocity: must have the form section.key=value",
        ),
        ({"vary": ["striker.velocity=1,,2"]}, "a value is missing"),
        ({"vary": ["striker.speed=1,2"]}, "unknown key 'striker.speed'"),
        ({"vary": ["striker.velocity=1", "striker.velocity=2"]}, "the key is varied twice"),
        ({"vary": ["striker.velocity=-1,2"]}, "striker.velocity = -1"),
        ({"vary": ["solver.threads=1,2"]}, "members 'threads1' and 'threads2' are the same run"),
    ],
)
def test_what_cannot_be_is_one_line(options, message):
    with pytest.raises(SceneError) as error:
        make_plan(SCENE, **options)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_the_record_reads_back_and_another_ensemble_is_refused(plan, tmp_path):
    write_plan(plan, tmp_path, threads=2)
    again = read_plan(tmp_path)
    assert [m.name for m in again.members] == [m.name for m in plan.members]
    assert [m.varied for m in again.members] == [m.varied for m in plan.members]
    assert again.members[0].scene.solver.threads == 2
    assert again.hash == plan.hash  # threads change no result
    refuse_other_plan(plan, tmp_path)
    for other, difference in (
        (make_plan(SCENE, vary=["striker.velocity=2,2.5"]), "only there: velocity3"),
        (make_plan(SCENE, vary=["striker.velocity=2,2.5,3,4"]), "only asked for: velocity4"),
        (
            make_plan(SCENE, vary=[SPEEDS], settings=["striker.mass=0.05"]),
            "striker.mass = 0.04 there, 0.05 asked for (velocity2)",
        ),
    ):
        with pytest.raises(SceneError, match="holds another ensemble: ") as error:
            refuse_other_plan(other, tmp_path)
        assert difference in str(error.value)


def test_folders_that_are_refused(plan, tmp_path):
    with pytest.raises(SceneError, match="holds no ensemble"):
        check(plan, tmp_path, resume=True)
    check(plan, tmp_path, resume=False)
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(SceneError, match="is not empty"):
        check(plan, tmp_path, resume=False)
    write_plan(plan, tmp_path, 1)
    with pytest.raises(SceneError, match="--resume continues it"):
        check(plan, tmp_path, resume=False)


# --- running --------------------------------------------------------------------------------------


def test_all_finish_and_what_has_finished_is_not_run_again(conduct, fake):
    code, _ = conduct(fake())
    assert code == 0
    code, conductor = conduct(fake())
    assert code == 0
    assert conductor.tries == {}
    for name in ("velocity2", "velocity2.5", "velocity3"):
        assert runs(conduct.folder, name) == ["begin"]
        assert states(conduct.folder, name) == ["finished"]


def test_a_member_that_fails_is_tried_once_more_and_takes_nobody_with_it(conduct, fake):
    code, conductor = conduct(fake(velocity2=["fail"], **{"velocity2.5": ["fail", "fail"]}))
    assert code == 5
    assert [outcome.name for outcome in conductor.failed] == ["velocity2.5"]
    assert states(conduct.folder, "velocity2") == ["failed", "finished"]
    assert states(conduct.folder, "velocity2.5") == ["failed", "failed"]
    assert states(conduct.folder, "velocity3") == ["finished"]
    last = read_attempts(conduct.folder, "velocity2.5")[-1]
    assert (last.exit_code, last.last_error) == (7, "error: the plate is velocity2.5")
    assert last.reason == last.last_error
    # asked to go on, it is tried twice again at most, and only it
    code, _ = conduct(fake())
    assert code == 0
    assert states(conduct.folder, "velocity2.5") == ["failed", "failed", "finished"]
    assert runs(conduct.folder, "velocity3") == ["begin"]


def test_a_checkpoint_is_gone_on_from_unless_it_was_refused(conduct, fake):
    asked = fake(velocity2=["checkpoint"], velocity3=["checkpoint", "refused"])
    code, _ = conduct(asked)
    assert code == 5
    assert runs(conduct.folder, "velocity2") == ["begin", "resume"]
    assert runs(conduct.folder, "velocity3") == ["begin", "resume"]
    code, _ = conduct(asked)
    assert code == 0
    assert runs(conduct.folder, "velocity3") == ["begin", "resume", "begin"]


def test_a_child_that_is_killed_or_takes_too_long(conduct, fake):
    code, _ = conduct(fake(velocity2=["die"], velocity3=["hang"]), timeout=1.0)
    assert code == 0
    killed, slow = (read_attempts(conduct.folder, name)[0] for name in ("velocity2", "velocity3"))
    assert (killed.state, killed.reason, killed.exit_code) == ("killed", "ended by SIGKILL", -9)
    assert (slow.state, slow.reason) == ("timed out", "took longer than 1 s")
    assert slow.exit_code == -signal.SIGTERM


def test_stopping_ends_children_cleanly_and_begins_none(conduct, fake):
    started = time.monotonic()
    asked = fake(velocity2=["hang"], **{"velocity2.5": ["hang"]})
    ended = []

    def interrupt() -> None:
        hanging = [conduct.folder / MEMBERS / n / "runs" for n in ("velocity2", "velocity2.5")]
        while not all(file.is_file() for file in hanging):
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    code, _ = conduct(asked, ended=ended.append)
    thread.join()
    assert code == 130
    assert time.monotonic() - started < 30
    assert {outcome.state for outcome in ended} == {"stopped"}
    assert not (conduct.folder / MEMBERS / "velocity3").exists()
    code, _ = conduct(fake())
    assert code == 0
    assert states(conduct.folder, "velocity2") == ["stopped", "finished"]


def task(conduct, commands: Commands, name: str = "velocity2", number: int = 1) -> Task:
    return Task(str(conduct.folder), name, number, commands)


def test_an_attempt_that_is_started_twice_runs_once(conduct, fake):
    """As a scheduler does that loses a worker, or the result that a worker had."""
    failing = task(conduct, fake(velocity2=["fail"]))
    assert attempt(failing).state == "failed"
    assert attempt(failing).state == "lost"
    assert runs(conduct.folder, "velocity2") == ["begin"]
    assert states(conduct.folder, "velocity2") == ["failed"]  # the record stands
    again = task(conduct, fake(), number=2)
    assert [attempt(again).state, attempt(again).state] == ["finished", "finished"]
    assert runs(conduct.folder, "velocity2") == ["begin", "begin"]


def test_a_run_folder_that_is_in_use_is_waited_for(conduct, fake, monkeypatch):
    folder = conduct.folder / MEMBERS / "velocity2"
    folder.mkdir(parents=True)
    monkeypatch.setattr(attempts, "PATIENCE", 0.1)
    holder = f"import time; from pathlib import Path\n\
from taichi_ldem.storage.durable import locked\n\
with locked(Path({str(folder)!r})):\n print('held', flush=True); time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", holder], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "held\n"
        outcome = attempt(task(conduct, fake()))
        assert outcome.state == "failed"
        assert f"in use by process {process.pid}" in outcome.reason
    finally:
        process.kill()
        process.communicate()
    assert attempt(task(conduct, fake(), number=2)).state == "finished"


def test_a_worker_without_the_files_says_so(conduct, fake, tmp_path):
    elsewhere = Task(str(tmp_path / "nowhere"), "velocity2", 1, fake())
    outcome = attempt(elsewhere)
    assert outcome.state == "failed"
    assert "workers need the same files" in outcome.reason


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux does it")
def test_a_child_ends_with_its_worker(conduct, fake):
    code = f"from taichi_ldem.ensemble.attempt import *\nattempt(Task({str(conduct.folder)!r}, \
'velocity2', 1, {fake(velocity2=['hang'])!r}), lambda: 0)"
    worker = subprocess.Popen([sys.executable, "-c", code])
    file = conduct.folder / MEMBERS / "velocity2" / "runs"
    until = time.monotonic() + 30
    while not file.is_file() and time.monotonic() < until:
        time.sleep(0.02)
    children = Path(f"/proc/{worker.pid}/task/{worker.pid}/children").read_text().split()
    assert len(children) == 1
    worker.kill()
    worker.wait()
    while Path("/proc", children[0]).exists() and time.monotonic() < until:
        time.sleep(0.02)
    assert not Path("/proc", children[0]).exists()
    assert states(conduct.folder, "velocity2") == ["running"]  # nobody was left to write


def test_workers_by_cores_and_memory(plan, monkeypatch):
    from taichi_ldem.ensemble import pools

    scenes = [member.scene for member in plan.members]
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(pools, "needed_bytes", lambda _: 10)
    monkeypatch.setattr(pools, "available_bytes", lambda: 1000)
    assert local_workers(None, 1, scenes) == 3  # no more than members
    assert local_workers(None, 4, scenes) == 2
    assert local_workers(None, 16, scenes) == 1
    monkeypatch.setattr(pools, "available_bytes", lambda: 25)
    assert local_workers(None, 1, scenes) == 2
    with pytest.raises(SceneError, match=r"--local 3: .* take at most 2"):
        local_workers(3, 1, scenes)


def test_an_attempt_that_raises_takes_nobody_with_it(conduct, fake, monkeypatch):
    from taichi_ldem.ensemble import pools

    def broken(task: Task, stop) -> attempts.Outcome:
        if task.name == "velocity2":
            raise RuntimeError("out of\nluck")
        return attempt(task, stop)

    monkeypatch.setattr(pools, "attempt", broken)
    code, conductor = conduct(fake())
    assert code == 5
    assert [o.reason for o in conductor.failed] == ["RuntimeError: out of luck"]
    assert states(conduct.folder, "velocity2") == ["failed", "failed"]
    assert states(conduct.folder, "velocity3") == ["finished"]


def test_an_ensemble_that_cannot_write_its_table_ends_its_children(plan, tmp_path, fake):
    out = tmp_path / "out"
    asked = fake(velocity2=["hang"], velocity3=["hang"])

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("taichi_ldem.ensemble.conduct.Conductor._take", full)
        with pytest.raises(OSError, match="No space left"):
            run(plan, out, How(local=3), commands=asked)
    assert {states(out, name)[0] for name in ("velocity2", "velocity3")} == {"stopped"}


def test_progress_on_a_terminal(conduct, fake):
    text = io.StringIO()
    console = Console(file=text, force_terminal=True, width=100)
    code, _ = conduct(fake(), console=console)
    assert code == 0
    assert "velocity3: finished" in text.getvalue()
    assert "3 of 3 done, 0 failed" in text.getvalue()


def test_share_of_a_run_from_its_history(tmp_path):
    file = tmp_path / "history.csv"
    assert reached_time(file) == 0.0
    file.write_text("time_s,force\n")
    assert reached_time(file) == 0.0
    file.write_text("time_s,force\n0.0,1\n1e-3,2\n2e-3")
    assert reached_time(file) == 1e-3
    assert [duration(s) for s in (61, 600, 9000)] == ["61 s", "10 min", "2 h 30 min"]


# --- Dask -----------------------------------------------------------------------------------------


def test_members_on_a_dask_cluster(conduct, plan, fake):
    distributed = pytest.importorskip("distributed")
    from taichi_ldem.ensemble.pools import DaskPool

    options = {"processes": False, "n_workers": 1, "threads_per_worker": 2}
    with distributed.LocalCluster(**options, dashboard_address=None) as cluster:
        pool = DaskPool(cluster.scheduler_address, conduct.folder)
        asked = fake(velocity2=["fail"])
        conductor = Conductor(plan, conduct.folder, pool, asked)
        assert "1 workers with 2 places" in pool.describe()
        assert conductor.run() == 0
        pool.close()
    assert states(conduct.folder, "velocity2") == ["failed", "finished"]
    assert runs(conduct.folder, "velocity3") == ["begin"]


def test_no_scheduler_there(tmp_path, capsys):
    pytest.importorskip("distributed")
    words = ["ensemble", str(SCENE), "--vary", SPEEDS, "--out", str(tmp_path / "out")]
    assert main([*words, "--scheduler", "nonsense://x"]) == 2
    assert "--scheduler nonsense://x: " in capsys.readouterr().err


# --- results --------------------------------------------------------------------------------------


def test_statistics_are_scipys():
    values = [3.0, 4.5, 2.5, 6.0]
    found = statistics(values)
    assert found.mean == pytest.approx(np.mean(values), rel=1e-15)
    assert found.standard_deviation == pytest.approx(np.std(values, ddof=1), rel=1e-15)
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert found.interval == pytest.approx(tuple(expected), rel=1e-12)
    assert (found.count, found.smallest, found.largest) == (4, 2.5, 6.0)
    assert statistics([7.0]).interval is None
    two = statistics([7.0, 8.0])  # Student's t of one degree of freedom is 12.7 deviations
    assert (two.interval, two.half_interval) == (None, None)
    assert two.standard_deviation == pytest.approx(math.sqrt(0.5))
    assert statistics([]) is None


def test_table_and_statistics_of_what_there_is(conduct, plan, fake):
    conduct(fake(velocity3=["fail", "fail"]))
    rows = read_rows(plan, conduct.folder)
    lines = write_table(plan, conduct.folder, rows).read_text().splitlines()
    header = lines[0].split(",")
    first, last = (dict(zip(header, lines[n].split(","), strict=True)) for n in (1, 3))
    assert first["striker.velocity"] == "2"
    assert first["first_peak_force_n"] == "101.0"
    assert (first["attempts"], first["state"], first["reason"]) == ("1", "finished", "")
    assert (last["attempts"], last["state"]) == ("2", "failed")
    assert last["reason"] == "error: the plate is velocity3"
    told = json.loads(write_statistics(plan, conduct.folder, rows).read_text())
    assert (told["members"], told["finished"]) == (3, 2)
    assert told["not_finished"]["velocity3"]["state"] == "failed"
    assert [a["exit_code"] for a in told["attempts_not_finished"]] == [7, 7]
    assert told["groups"][0]["statistics"]["first_peak_force_n"]["mean"] == 101.0


def test_envelope_of_records_on_different_times():
    coarse, fine = np.linspace(0.0, 1.0, 6), np.linspace(0.0, 0.9, 10)
    found = envelope([(coarse, 2 * coarse), (fine, 4 * fine), (fine, 0 * fine)])
    assert np.allclose(found.time, fine)
    assert np.allclose(found.high, 4 * fine)
    assert np.allclose(found.low, 0.0)
    assert np.allclose(found.mean, 2 * fine)


def test_groups_of_one_member_stand_side_by_side(plan):
    rows = [Row(member, {}, (), "finished") for member in plan.members]
    panels = make_panels(rows, {member.name: None for member in plan.members})
    assert panels == [("", [(f"velocity {v}", None) for v in ("2", "2.5", "3")])]


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """An ensemble of the paper's test whose runs are made from formulas."""
    folder = tmp_path_factory.mktemp("finished")
    plan = make_plan(PAPER, cv="0,0.25", seeds="0:2")
    write_plan(plan, folder, 1)
    (folder / MEMBERS).mkdir()
    made = synthetic_run(folder / MEMBERS / "cv0")
    numbers = made.read_summary() | {"radial_cracks": 5, "circular_diameter_m": None}
    made.write_summary(numbers | {"radial_diameter_m": 0.05})
    for seed, diameter in ((0, 0.050), (1, 0.054)):
        path = folder / MEMBERS / f"cv0.25_seed{seed}"
        shutil.copytree(made.path, path)
        values = {"radial_cracks": 5 + seed, "radial_diameter_m": diameter}
        type(made)(path).write_summary(numbers | values)
    return folder


@pytest.fixture
def figures(monkeypatch) -> dict[str, Figure]:
    """The figures by file name, caught instead of being drawn."""
    caught: dict[str, Figure] = {}
    monkeypatch.setattr(Figure, "savefig", lambda self, path, **_: caught.update({path.name: self}))
    return caught


def test_plot_makes_tables_and_figures_from_the_folder(finished, figures, capsys):
    assert main(["plot", str(finished)]) == 0
    assert set(figures) == {
        "force_envelope.png",
        "velocity_envelope.png",
        "energy_envelope.png",
        "cracks_at_t2.png",
        "cracks_at_end.png",
    }
    assert "table3.md" in capsys.readouterr().out
    force = figures["force_envelope.png"]
    assert [axes.get_title() for axes in force.axes] == ["CV 25 %"]
    labels = [text.get_text() for text in force.legends[0].get_texts()]
    assert "between the smallest and the largest member" in labels
    assert "homogeneous" in labels
    assert "experiments, $P_1$ ~ 600 N at 1.75 ms" in labels
    titles = [axes.get_title() for axes in figures["cracks_at_t2.png"].axes]
    assert titles[0].startswith("5 radial cracks at")
    assert [title.split("\n")[0] for title in titles[2:]] == ["seed 0", "seed 1"]


def test_table_3_has_the_papers_values_beside(finished, figures):
    report(finished)
    lines = (finished / "table3.md").read_text().splitlines()
    assert any(line.startswith("| CV 25 % | 5 6 | 50.0 54.0 | - - |") for line in lines)
    assert any(line.startswith("| mean | 5.5 (two) | 52.0 (two) | - |") for line in lines)
    # the paper's Table 3
    paper = "| *paper's LDEM, CV 25 %* | 5 6 6 5 | 53.6 54.7 53.4 46.8 | 46 42 42 32 |"
    assert any(line.startswith(paper) for line in lines)
    table = (finished / "table3.csv").read_text().splitlines()
    assert "paper's LDEM,CV 50 %,1,5,0.0463,0.016,,,,,," in table
    assert sum(line.startswith("experiments") for line in table) == 4


def test_table_3_says_what_was_measured_without_a_failure(plan):
    numbers = {"radial_cracks": 5, "radial_diameter_m": 0.05, "failure_time_energy_s": None}
    times = [None, 7e-3, 7.1e-3]
    rows = [
        Row(member, numbers | {"failure_time_energy_s": at}, (), "finished")
        for member, at in zip([plan.members[0]] * 3, times, strict=True)
    ]
    first, mean = markdown(rows, papers=False).splitlines()[2:4]
    assert "| 5* 5 5 | 50.0* 50.0 50.0 |" in first
    assert mean.startswith("| mean | 5.0 ± 0.0 | 50.0 ± 0.0 |")
    assert mean.endswith("| 7.05 (two) | - | - |")


@pytest.mark.slow
def test_two_true_members_are_those_of_the_command_alone(tmp_path):
    """Slow: three runs in processes of their own."""
    words = ["--set", "solver.duration=1e-4", "--set", "output.image_times=[]"]
    speeds = "striker.velocity=4,5"
    out = tmp_path / "ensemble"
    assert main(["ensemble", str(SCENE), "--vary", speeds, "--out", str(out), *words]) == 0
    alone = tmp_path / "alone"
    command = [sys.executable, "-m", "taichi_ldem.cli", "impact", str(SCENE), "--out", str(alone)]
    subprocess.run([*command, *words], check=True, capture_output=True)
    member = out / MEMBERS / "velocity5" / "history.csv"
    assert member.read_bytes() == (alone / "history.csv").read_bytes()


@pytest.mark.slow
def test_a_worker_killed_in_the_middle(tmp_path, capsys):
    """Slow: eight runs, four of them on a Dask cluster of two processes."""
    pytest.importorskip("distributed")
    from studies.cluster import main as study

    words = ["--vary", "striker.velocity=3,4,5,6", "--set", "output.image_times=[]"]
    assert study([str(SCENE), str(tmp_path), *words]) == 0
    told = capsys.readouterr().out
    assert "lost, its worker ended" in told
    assert "differences between Dask and local: none" in told


def test_command_with_fake_members(plan, tmp_path, fake, capsys, monkeypatch):
    """The whole command but the solver: folder held, tables kept up to date, exit code."""
    monkeypatch.setattr("taichi_ldem.ensemble.report.report", lambda folder: [])
    out = tmp_path / "out"
    commands = fake(velocity3=["fail", "fail"])
    assert run(plan, out, How(local=2), commands=commands) == 5
    told = capsys.readouterr()
    assert "3 members, 0 finished already; 2 at a time on this machine" in told.out
    assert "velocity3: attempt 2 failed: error: the plate is velocity3; given up" in told.out
    assert told.err == "failed: velocity3: failed: error: the plate is velocity3\n"
    assert "finished" in (out / "ensemble.csv").read_text()
    assert len(list((out / ATTEMPTS).glob("*.json"))) == 4
    with locked(out), pytest.raises(SceneError, match="in use by process"):
        run(plan, out, resume=True, commands=commands)
    assert run(plan, out, resume=True, commands=commands, quiet=True) == 0
    assert capsys.readouterr().out == ""
