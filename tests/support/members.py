"""Ensembles whose members are small scripts."""

from pathlib import Path

from support.paths import CONFIGS, SCENES

from taichi_ldem.ensemble.attempt import Commands, Task, read_attempts
from taichi_ldem.ensemble.plan import (
    MEMBERS,
)

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


def runs(folder: Path, name: str) -> list[str]:
    return (folder / MEMBERS / name / "runs").read_text().split()


def states(folder: Path, name: str) -> list[str]:
    return [outcome.state for outcome in read_attempts(folder, name)]


def task(conduct, commands: Commands, name: str = "velocity2", number: int = 1) -> Task:
    return Task(str(conduct.folder), name, number, commands)
