"""The command line in a process of its own, and a small plate that cracks within seconds."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

SCENE = """
scenario = "impact"

[plate]
size = [0.0096, 0.0096, 0.0016]
modules_through_thickness = 3

[material]
youngs_modulus = 3.35e9
poisson_ratio = 0.25
density = 1190.0
fracture_energy = 1034.0
failure_factor = 31.45

[striker]
diameter = 0.003
mass = 0.01
velocity = 8.0

[clamp]
kind = "rings"
inner_diameter = 0.006
outer_diameter = 0.009

[solver]
duration = 8e-5

[output]
history_interval = 1e-6
"""
COMMAND = [sys.executable, "-m", "taichi_ldem.cli"]


# no snapshots: they take longer than these runs and have tests of their own
WITHOUT_VULKAN = os.environ | {"VK_ICD_FILENAMES": "/none", "VK_DRIVER_FILES": "/none"}


def ldem(*words: str) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=WITHOUT_VULKAN)


def cut_off(
    scene: Path, out: Path, rows: int, number: signal.Signals, *words: str
) -> tuple[int, str]:
    """Start a run, send a signal after so many rows; its exit code and what it said."""
    process = subprocess.Popen(
        [*COMMAND, "impact", str(scene), "--out", str(out), "--quiet", *words],
        stderr=subprocess.PIPE,
        text=True,
        env=WITHOUT_VULKAN,
    )
    history = out / "history.csv"
    deadline = time.monotonic() + 100
    while time.monotonic() < deadline:
        if history.exists() and history.read_bytes().count(b"\n") > rows:
            break
        time.sleep(0.002)
    process.send_signal(number)
    _, errors = process.communicate(timeout=100)
    return process.returncode, errors
