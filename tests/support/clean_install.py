"""Builds sdist and wheel, installs the wheel where nothing else is, and runs a scene from there.

    python tests/support/clean_install.py [PYTHON ...] [--lowest]

Each PYTHON is an interpreter; default: the oldest and the newest supported one that is found. With
``--lowest`` every dependency has the lowest version that pyproject.toml admits.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
SUPPORTED = ("3.10", "3.11", "3.12", "3.13")
# small and quick: it cracks, and is resumed once
SETTINGS = ("solver.duration=2e-4", "output.image_times=[]", "output.checkpoint_interval=1")


def run(command: Sequence[object], **more: object) -> str:
    """Output of a command; RuntimeError with its last words where it fails."""
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, **more)  # type: ignore[call-overload]
    if done.returncode:
        words = " ".join(map(str, command))
        raise RuntimeError(
            f"{words}: {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
        )
    return str(done.stdout)


def interpreters() -> list[str]:
    """The oldest and the newest supported Python of this machine."""
    found = []
    for version in SUPPORTED:
        path = shutil.which(f"python{version}")
        if path and subprocess.run([path, "-V"], capture_output=True).returncode == 0:
            found.append(path)
    found = found or [sys.executable]
    return list(dict.fromkeys([found[0], found[-1]]))


def lowest() -> list[str]:
    """Lower bounds of the dependencies as exact versions, with their markers."""
    text = (ROOT / "pyproject.toml").read_text()
    listed = text[text.index("\ndependencies = [") :]
    lines = re.findall(r'^    "(.+)",$', listed[: listed.index("\n]")], flags=re.M)
    return [line.replace(">=", "==", 1) for line in lines]


def build(where: Path) -> Path:
    """Wheel and sdist of the source tree, the wheel made from the sdist; the wheel."""
    run([sys.executable, "-m", "build", "--outdir", where, ROOT])
    (wheel,) = where.glob("*.whl")
    (sdist,) = where.glob("*.tar.gz")
    inside = zipfile.ZipFile(wheel).namelist()
    assert "taichi_ldem/py.typed" in inside
    assert not [name for name in inside if name.startswith(("tests", "configs", "outputs"))]
    with tarfile.open(sdist) as archive:
        names = [name.partition("/")[2] for name in archive.getnames()]
    assert {"pyproject.toml", "README.md", "LICENSE", "taichi_ldem/cli/app.py"} <= set(names)
    return wheel


def try_out(python: str, wheel: Path, where: Path, low: bool) -> str:
    """Install the wheel into a new environment and use its console script; what came out."""
    venv = where / "venv"
    # a PYTHONPATH would let pip find the package where it is not
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    run([python, "-m", "venv", venv], env=clean)
    (where / "constraints.txt").write_text("\n".join(lowest() if low else ()))
    pip = [venv / "bin" / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    run([*pip, "-c", where / "constraints.txt", wheel], cwd=where, env=clean)
    ldem = venv / "bin" / "ldem"
    scene = shutil.copy(ROOT / "configs" / "impact_small.toml", where)
    words = [word for text in SETTINGS for word in ("--set", text)]
    run([ldem, "impact", scene, "--out", where / "run", *words], cwd=where, env=clean)
    run([ldem, "resume", where / "run", "--extend", "1e-4"], cwd=where, env=clean)
    summary = json.loads((where / "run" / "summary.json").read_text())
    assert summary["steps"] * summary["time_step_s"] > 2.9e-4
    about = summary["provenance"]
    assert about["git"] is None
    return f"Python {about['python']}, {about['packages']}: {summary['steps']} steps"


def main() -> int:
    """Try all interpreters; 0 where every one works."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("pythons", nargs="*")
    parser.add_argument("--lowest", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        wheel = build(Path(name) / "dist")
        for number, python in enumerate(given.pythons or interpreters()):
            where = Path(name) / str(number)
            where.mkdir()
            print(try_out(python, wheel, where, given.lowest), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
