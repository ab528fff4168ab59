"""A run that was cut off and resumed is bitwise the run that never stopped."""

import io
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import pytest
from support.command import SCENE, cut_off, ldem
from support.paths import CONFIGS, ROOT

from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.launch import summary_of
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scene import parse_scene_text
from taichi_ldem.storage import checkpoint as cp
from taichi_ldem.storage.compare import differences
from taichi_ldem.storage.durable import MemoryFile
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.provenance import scene_hash

# -- the state, in one process a precision ---------------------------------------------------------

RESTORE = """
import sys
import numpy as np
sys.path.insert(0, "tests")
from support.blocks import DAMAGE, block_scene
from taichi_ldem.solver import backend
from taichi_ldem.storage import checkpoint

CRACK = {"after_failure": "closing", "fracture": "crack", "crack_opening": "viscous"}
precision, damping, clamp = sys.argv[1], float(sys.argv[2]), sys.argv[3]
scene = block_scene(
    16, 16, 3,
    material=DAMAGE | {"poisson_ratio": 0.36} | (CRACK if precision == "f32" else {}),
    disorder={"fracture_energy_cv": 0.3, "youngs_modulus_cv": 0.1, "density_cv": 0.1, "seed": 5},
    plate={"gravity": [1e3, 0.0, -1e4], "velocity": [0.0, 0.1, 0.0]},
    striker={"diameter": 2e-3, "mass": 1e-3, "velocity": 6.0, "gravity": 9.81, "gap": 2e-5,
             "friction": 0.2},
    clamp={"kind": clamp, "inner_diameter": 5.2e-3, "outer_diameter": 7.6e-3, "friction": 0.3},
    floor={"gap": 1e-5, "friction": 0.4},
    solver={"duration": 1.2e-4, "precision": precision, "damping": damping, "threads": 1},
    output={"history_interval": 2e-6},
    notch=[{"normal": "x", "position": 1e-3, "from": [-4e-3, 0], "to": [-2e-3, 1e-3]},
           {"centre": [-5e-4, 5e-4, 2e-4], "diameter": 2e-3, "direction": [1, 1, 0.2],
            "time": 5e-5}],
)
backend.start(scene.solver)
from taichi_ldem.solver.simulation import Simulation

def values(sample):
    return (sample.step, *sample.observed.values(), sample.broken_bars, sample.energy_error,
            sample.energy_error_of_plate, *vars(sample.ledger).values())

def end(simulation):
    sites, bars = simulation.dynamics.new_broken()
    return simulation.displacement(), simulation.dynamics.get_velocity(), sites, bars

simulation = Simulation(scene)
saved, rows = [], []

def between():
    if simulation.step_number in wanted and not any(s[0] == simulation.step_number for s in saved):
        content = checkpoint.encode(checkpoint.Checkpoint(
            scene, simulation.saved_state(), [{"time_s": 0.5, "n": 1, "f": None}], 0.0, 0.0, 1, 2))
        saved.append((simulation.step_number, len(rows), content))

wanted = range(0, 10**6, 64)
broken, force, floor, errors = [], [], [], []
for sample in simulation.samples(between):
    rows.append(values(sample))
    broken.append(sample.broken_bars)
    force.append(sample.observed["striker_force_n"])
    floor.append(sample.observed["floor_force_n"])
    errors.append(sample.energy_error)
whole = end(simulation)
assert broken[-1] > 20 and force[1] == 0 and max(force) > 1, (broken, force)
assert floor[0] == 0 and max(floor) > 1, floor
assert max(errors) < 5e-3
assert simulation.openings.energy > 0

kinds = set()
simulation.reset(scene)  # instead of a second simulation, which would compile all kernels again
simulation.compile()
for step, count, content in saved:
    at = min(count, len(rows) - 1)
    kind = (broken[at] > 0, broken[at] == broken[-1], force[at] > 0)
    if kind in kinds:
        continue
    kinds.add(kind)
    read = checkpoint.decode(content)
    assert read.scene == scene and read.history == [{"time_s": 0.5, "n": 1, "f": None}]
    simulation.restore_state(read.state)
    assert simulation.step_number == step
    again = [values(sample) for sample in simulation.samples()]
    assert again == rows[count:], (step, count)
    for mine, theirs in zip(whole, end(simulation)):
        np.testing.assert_array_equal(mine, theirs)
print(len(kinds))
"""


@pytest.mark.parametrize(
    ("precision", "damping", "clamp"),
    [("f64", "300", "rings"), pytest.param("f32", "0", "bonded", marks=pytest.mark.slow)],
)
def test_a_restored_state_goes_on_bitwise(precision: str, damping: str, clamp: str) -> None:
    """Before, during and after cracking and contact; every part of the state is in play."""
    command = [sys.executable, "-c", RESTORE, precision, damping, clamp]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    assert int(done.stdout) >= 4


# -- whole runs ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "small.toml"
    more = 'fields = ["strain"]\nfragments = true\n'
    file.write_text(SCENE + "field_interval = 1e-5\ncheckpoint_interval = 1e-3\n" + more)
    return file


@pytest.fixture(scope="module")
def whole(scene: Path) -> RunFolder:
    done = ldem("impact", str(scene), "--out", str(scene.parent / "whole"), "--quiet")
    assert done.returncode == 0, done.stderr
    return RunFolder.open(scene.parent / "whole")


@pytest.fixture(scope="module")
def cut(scene: Path, whole: RunFolder) -> Path:
    """A run killed while the plate cracks, with two checkpoints; tests take copies of it."""
    out = scene.parent / "cut"
    for rows in range(25, 0, -4):  # a machine that is faster than the signal gets another try
        shutil.rmtree(out, ignore_errors=True)
        code, _ = cut_off(scene, out, rows, signal.SIGKILL)
        if code == -signal.SIGKILL and (out / cp.PREVIOUS).exists():
            return out
    raise AssertionError("the run was never caught")


@pytest.fixture
def copy(cut: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(cut, tmp_path / "copy"))


@pytest.mark.slow
def test_a_killed_run_is_resumed_bitwise(copy: Path, whole: RunFolder) -> None:
    assert not (copy / "summary.json").exists()
    done = ldem("resume", str(copy))
    assert done.returncode == 0, done.stderr
    assert "warning: " not in done.stderr
    assert "resumed at t = " in done.stdout
    assert differences(whole.path, copy) == []
    again = ldem("resume", str(copy))
    assert (again.returncode, "--extend" in again.stdout) == (0, True)
    assert differences(whole.path, copy) == []


@pytest.mark.slow
def test_pieces_that_touch_go_on_bitwise_after_several_kills(tmp_path: Path) -> None:
    """A cracking plate whose pieces push and rub each other, killed and resumed again and again."""
    scene, whole, out = (tmp_path / name for name in ("scene.toml", "whole", "killed"))
    text = SCENE.replace("poisson_ratio = 0.25", "poisson_ratio = 0.36")
    text = text.replace("velocity = 8.0", "velocity = 20.0")
    more = "checkpoint_interval = 1e-3\n[contact]\nfragments = true\nfriction = 0.3\n"
    scene.write_text(text + more)
    done = ldem("impact", str(scene), "--out", str(whole), "--quiet")
    assert done.returncode == 0, done.stderr
    history = RunFolder.open(whole).read_history()
    assert history["broken_bars"][-1] > 100
    assert history["pieces_friction_j"][30] > 0
    killed_at = []
    for rows in (20, 32, 44, 56):
        code, _ = cut_off(scene, out, rows, signal.SIGKILL, "--resume")
        if code == -signal.SIGKILL and (out / cp.LATEST).exists():
            killed_at.append(len(cp.decode((out / cp.LATEST).read_bytes()).history))
    assert len(killed_at) >= 3
    assert max(killed_at) > 30  # pieces touch there
    done = ldem("impact", str(scene), "--out", str(out), "--quiet", "--resume")
    assert done.returncode == 0, done.stderr
    assert differences(whole, out) == []


@pytest.mark.slow
def test_sigterm_leaves_a_checkpoint_of_its_own(scene: Path, whole: RunFolder) -> None:
    out = scene.parent / "terminated"
    code, errors = cut_off(scene, out, 10, signal.SIGTERM)
    assert code == 143
    (line,) = errors.splitlines()
    assert line.startswith("terminated at t = ")
    assert line.endswith(f"`ldem resume {out}` goes on")
    saved = cp.decode((out / cp.LATEST).read_bytes())
    assert len(saved.history) == len(RunFolder.open(out).read_history()["time_s"])
    record = json.loads((out / "run.json").read_text())
    record["processes"][-1]["cpu"] = "another CPU"
    (out / "run.json").write_text(json.dumps(record))
    done = ldem("resume", str(out), "--quiet")
    assert (done.returncode, done.stdout) == (0, "")
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("warning: ")]
    assert line.startswith(
        "warning: the run began on another machine or version (CPU another CPU, now "
    )
    assert differences(whole.path, out) == []


@pytest.mark.slow
def test_a_finished_run_is_extended_bitwise(scene: Path, whole: RunFolder) -> None:
    out = scene.parent / "extended"
    half = ("--set", "solver.duration=4e-5", "--set", "output.field_interval=1e-5")
    done = ldem("impact", str(scene), "--out", str(out), "--quiet", *half)
    assert done.returncode == 0, done.stderr
    done = ldem("resume", str(out), "--extend", "4e-5", "--quiet")
    assert done.returncode == 0, done.stderr
    assert differences(whole.path, out) == []
    refused = ldem("resume", str(out), "--extend", "-1")
    assert refused.returncode == 2
    assert "--extend -1.0: must be" in refused.stderr


@pytest.mark.slow
def test_a_damaged_checkpoint_is_refused_and_the_older_one_used(
    copy: Path, whole: RunFolder
) -> None:
    latest = copy / cp.LATEST
    content = bytearray(latest.read_bytes())
    content[len(content) // 2] ^= 1
    latest.write_bytes(content)
    done = ldem("resume", str(copy), "--quiet")
    assert done.returncode == 0
    assert done.stderr.startswith(f"refused: {latest}: has a wrong checksum")
    assert differences(whole.path, copy) == []


@pytest.mark.slow
def test_lost_files_come_back_or_are_named(copy: Path, whole: RunFolder) -> None:
    (copy / "history.csv").unlink()
    fields = (copy / "fields.vtkhdf").read_bytes()
    (copy / "fields.vtkhdf").unlink()
    done = ldem("resume", str(copy))
    assert done.returncode == 2
    assert "fields.vtkhdf" in done.stderr
    assert "no checkpoint that can be resumed" in done.stderr
    (copy / "fields.vtkhdf").write_bytes(fields)
    assert ldem("resume", str(copy)).returncode == 0
    assert differences(whole.path, copy) == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('precision = "f64"', 'precision = "f32"', 'solver.precision = "f64" in the checkpoint'),
        ("mass = 0.01", "mass = 0.02", "striker.mass = 0.01 in the checkpoint, 0.02 in scene.toml"),
        ("duration = 8e-05", "duration = 1e-5", "output.field_interval"),
    ],
    ids=["precision", "mass", "duration"],
)
def test_another_scene_is_refused(copy: Path, old: str, new: str, message: str) -> None:
    text = (copy / "scene.toml").read_text()
    assert old in text
    (copy / "scene.toml").write_text(text.replace(old, new))
    before = {p.name: p.read_bytes() for p in copy.iterdir()}
    done = ldem("resume", str(copy))
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    if "duration" not in old:
        assert message in done.stderr
    assert {p.name: p.read_bytes() for p in copy.iterdir() if p.name != "run.lock"} == {
        name: content for name, content in before.items() if name != "run.lock"
    }


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    for folder in (tmp_path / "absent", tmp_path):
        done = ldem("resume", str(folder))
        assert done.returncode == 2
        assert "no run folder" in done.stderr


@pytest.mark.slow
def test_without_an_interval_there_are_no_checkpoints(scene: Path) -> None:
    out = scene.parent / "without"
    words = ("--set", "output.checkpoint_interval=0", "--set", "solver.duration=1e-5")
    frames = ("--set", "output.field_interval=0")
    done = ldem("impact", str(scene), "--out", str(out), "--quiet", *words, *frames)
    assert done.returncode == 0, done.stderr
    assert not list(out.glob("checkpoint*"))


RESUMABLE = {
    "impact": True,
    "tension": True,
    "bend": True,
    "load": True,
    "wave": False,
    "modes": False,
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_says_whether_it_can_be_resumed(name: str) -> None:
    if RESUMABLE[name]:
        assert callable(summary_of(SCENARIOS[name]))
    else:
        with pytest.raises(SceneError, match="cannot be resumed"):
            summary_of(SCENARIOS[name])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "duration"), [("tension_quick.toml", 1.2e-4), ("bend_quick.toml", 1e-4)]
)
def test_other_scenarios_are_resumed_bitwise(scene: str, duration: float, tmp_path: Path) -> None:
    file = CONFIGS / scene
    command = scene.partition("_")[0]
    # the end of the first half is on the grids of the history and of the fields
    settings = (f"output.field_interval={0.5 * duration!r}", "output.image_times=[]")
    common = ["--quiet", *(word for text in settings for word in ("--set", text))]
    for name, share in (("whole", 1.0), ("halves", 0.5)):
        length = ("--set", f"solver.duration={share * duration!r}")
        done = ldem(command, str(file), "--out", str(tmp_path / name), *common, *length)
        assert done.returncode == 0, done.stderr
    done = ldem("resume", str(tmp_path / "halves"), "--extend", repr(0.5 * duration), "--quiet")
    assert done.returncode == 0, done.stderr
    assert differences(tmp_path / "whole", tmp_path / "halves") == []


# -- the file --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def content(cut: Path) -> bytes:
    return (cut / cp.LATEST).read_bytes()


def test_a_checkpoint_survives_its_file(content: bytes) -> None:
    checkpoint = cp.decode(content)
    assert cp.decode(cp.encode(checkpoint)).history == checkpoint.history
    assert checkpoint.history[0]["time_s"] == 0
    assert isinstance(checkpoint.history[0]["broken_bars"], int)


def test_every_damaged_region_is_refused(content: bytes) -> None:
    """One flipped bit in each of 400 regions, and 100 lengths: never a checkpoint."""
    for n in range(400):
        at = n * len(content) // 400
        if cp.HEAD > at > content.index(b"\0"):
            at = cp.HEAD - 1  # the head's padding counts, too
        bad = bytearray(content)
        bad[at] ^= 1 << n % 8
        with pytest.raises(cp.CheckpointError):
            cp.decode(bytes(bad))
    for n in range(100):
        with pytest.raises(cp.CheckpointError):
            cp.decode(content[: n * len(content) // 100])


def _altered(content: bytes, change) -> bytes:
    """The same checkpoint with its HDF5 changed and the checksum made right again."""
    image = MemoryFile()
    with image as file, h5py.File(io.BytesIO(content[cp.HEAD :]), "r") as old:
        for name in old:
            old.copy(name, file)
        file.attrs.update(old.attrs)
        change(file)
    return cp._head(image.content) + image.content


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.attrs.__setitem__("version", "0.0.9"), "was written by version 0.0.9"),
        (lambda f: f.attrs.__setitem__("format", 3), "format 3"),
        (lambda f: f.attrs.__delitem__("scene"), "no checkpoint of this program"),
        (lambda f: f.attrs.__setitem__("scene", "scenario = 3"), "its scene: "),
        (lambda f: f.attrs.__setitem__("rows", -1), "negative counts"),
        (lambda f: f.attrs.__setitem__("rows", 10**9), "history/"),
        (lambda f: f.__delitem__("history"), "history"),
        (lambda f: f.create_dataset("state/x", (10**6, 10**6), "f8", chunks=(1, 1)), "'state/x'"),
        (lambda f: f.create_dataset("state/x", data="text"), "'state/x'"),
    ],
)
def test_a_checkpoint_of_another_making_is_refused(content: bytes, change, message: str) -> None:
    with pytest.raises(cp.CheckpointError, match=message) as error:
        cp.decode(_altered(content, change))
    assert "\n" not in str(error.value)


def test_scenes_are_the_same_but_for_what_changes_no_result(content: bytes) -> None:
    scene = cp.decode(content).scene
    text = cp.scene_to_toml(scene)
    other = parse_scene_text(text.replace("duration = 8e-05", "duration = 9e-05"), "x")
    cp.refuse_other(scene, other)
    notched = text + "\n[[notch]]\nnormal='x'\nposition=0.0\nfrom=[0,0]\nto=[1e-3,1e-3]\n"
    with pytest.raises(cp.CheckpointError, match=r"notch = \[\] in the checkpoint"):
        cp.refuse_other(scene, parse_scene_text(notched, "x"))


@pytest.mark.slow
def test_the_wall_time_of_all_processes_counts(copy: Path) -> None:
    before = cp.decode((copy / cp.LATEST).read_bytes()).wall
    assert before > 0
    assert ldem("resume", str(copy), "--quiet").returncode == 0
    assert RunFolder.open(copy).read_summary()["wall_s"] > before
    assert os.path.getsize(copy / "run.json") > 0


def test_every_output_names_its_scene(whole: RunFolder, content: bytes) -> None:
    from PIL import Image

    scene = parse_scene_text(whole.scene_file.read_text(), "x")
    name = scene_hash(scene)
    assert whole.read_summary()["provenance"]["scene_sha256"] == name
    (process,) = json.loads((whole.path / "run.json").read_text())["processes"]
    assert process["scene_sha256"] == name
    assert " impact " in process["command"]
    with h5py.File(whole.fields_file) as file:
        assert file.attrs["scene_sha256"] == name
        assert json.loads(file.attrs["packages"]) == process["packages"]
    with h5py.File(io.BytesIO(content[cp.HEAD :])) as file:
        assert json.loads(file.attrs["provenance"])["scene_sha256"] == name
    with Image.open(whole.path / "force.png") as picture:
        assert picture.info["Scene-SHA256"] == name
