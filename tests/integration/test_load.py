"""A plate under all kinds of loads, from the command line: threads, a kill, energy."""

import json
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from support.command import COMMAND, SCENE, WITHOUT_VULKAN, ldem

from taichi_ldem.storage import checkpoint as cp
from taichi_ldem.storage.compare import differences
from taichi_ldem.storage.folder import RunFolder

pytestmark = pytest.mark.slow

LOADS = """
checkpoint_interval = 1e-3
[floor]
gap = 1e-5
friction = 0.3
[[notch]]
normal = "x"
position = 0.0
from = [-0.0048, 0.0]
to = [-0.003, 0.0016]
[start]
rotation = [0.0, 0.0, 40.0]
strain = [2e-4, 0.0, 0.0]
[[probe]]
point = [0.0, 0.0, 0.0]
quantities = ["displacement", "velocity", "strain", "stress"]
[[load]]
face = "+x"
traction = 2e7
direction = [1.0, 0.2, 0.0]
course = "half-sine"
duration = 3e-5
[[load]]
face = "-x"
velocity = 4.0
direction = "-x"
course = "table"
table = "pulse.csv"
[[load]]
name = "patch"
face = "-z"
outer_diameter = 0.003
force = 20.0
direction = "z"
course = "ramp"
ramp = 1e-5
[[load]]
box = [[-0.001, 0.0047, 0.0], [0.001, 0.0049, 0.002]]
displacement = 2e-5
direction = "y"
lateral = "held"
course = "ramp"
ramp = 4e-5
"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "loaded.toml"
    (file.parent / "pulse.csv").write_text("time_s,factor\n0,0\n1e-5,1\n5e-5,0.2\n")
    file.write_text(SCENE.replace('"impact"', '"load"') + LOADS)
    return file


@pytest.fixture(scope="module")
def whole(scene: Path) -> RunFolder:
    out = scene.parent / "whole"
    done = ldem("load", str(scene), "--out", str(out), "--quiet", "--threads", "1")
    assert done.returncode == 0, done.stderr
    return RunFolder.open(out)


def test_the_balance_closes_and_the_summary_names_every_load(whole: RunFolder) -> None:
    found = json.loads(whole.summary_file.read_text())
    assert found["broken_bars"] > 20
    assert found["energy_error"] < 0.01
    assert found["energy_error_of_plate"] < 0.01
    for name in ("load1", "load2", "patch", "load4"):
        assert found[f"{name}_peak_force_n"] > 1, name
    assert found["patch_peak_force_n"] == pytest.approx(20.0, rel=1e-9)
    assert found["cracked_area_m2"] > 0
    assert found["crack_from_x_m"] < found["crack_to_x_m"]
    assert (whole.path / "loads.png").is_file()


def test_the_run_folder_is_enough_to_run_it_again_with_two_threads(
    whole: RunFolder, tmp_path: Path
) -> None:
    shutil.copy(whole.path / "scene.toml", tmp_path / "scene.toml")
    again = ("--out", str(tmp_path / "two"), "--threads", "2", "--quiet")
    done = ldem("load", str(tmp_path / "scene.toml"), *again)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "two/history.csv").read_bytes() == whole.history_file.read_bytes()


def test_a_killed_run_of_loads_is_resumed_bitwise(scene: Path, whole: RunFolder) -> None:
    out = scene.parent / "cut"
    for rows in range(40, 0, -4):  # a machine that is faster than the signal gets another try
        shutil.rmtree(out, ignore_errors=True)
        words = ["load", str(scene), "--out", str(out), "--quiet", "--threads", "1"]
        process = subprocess.Popen([*COMMAND, *words], env=WITHOUT_VULKAN)
        history, deadline = out / "history.csv", time.monotonic() + 100
        while time.monotonic() < deadline:
            if history.exists() and history.read_bytes().count(b"\n") > rows:
                break
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        if process.wait() == -signal.SIGKILL and (out / cp.PREVIOUS).exists():
            break
    assert not (out / "summary.json").exists()
    done = ldem("resume", str(out))
    assert done.returncode == 0, done.stderr
    assert differences(whole.path, out) == []
    assert (out / "summary.json").exists()
