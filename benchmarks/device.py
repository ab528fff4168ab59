"""What a GPU does with the step: one command for the day there is one.

    python benchmarks/device.py --arch cuda                    # everything
    python benchmarks/device.py --arch vulkan --small          # that it runs and agrees
    python benchmarks/device.py --arch cuda --part agree step  # some parts

Parts, each in processes of its own:

- fields: fields above 4 GiB, alone and side by side, hold what was written into them.
- copy: bandwidth that a copy of two large fields reaches.
- agree: a small plate under a striker, between rings, that cracks, against the CPU: the same until
  the first bar softens, within bands afterwards.
- step: the full step of the paper's plate (sampling as in a run), and its share of the copy.
- large: the same for a plate of 200 million bars.
- run: the paper's whole test, 10 ms.

Results: outputs/device/device.md.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(HERE), str(ROOT)]
OUT = ROOT / "outputs/device"
PARTS = ("fields", "copy", "agree", "step", "large", "run")
PAPER, LARGE, SMALL = 174, 1535, 15
"""Modules along a side: of the paper's plate, of 200 million bars, of a plate for a first look."""

CRACKING = {
    "plate.size": "[0.0096, 0.0096, 0.0016]",
    "plate.modules_through_thickness": "3",
    "striker.diameter": "0.003",
    "striker.mass": "0.01",
    "striker.velocity": "8.0",
    "clamp.inner_diameter": "0.006",
    "clamp.outer_diameter": "0.009",
    "solver.duration": "8e-5",
    "output.history_interval": "1e-6",
    "output.checkpoint_interval": "0",
}
"""A plate that cracks within 900 steps; it is tests/test_impact.py's."""

WHOLE = {"f64": 1e-9, "f32": 1e-4}
"""Largest difference before the first bar softens, over a column's largest value."""

BANDS = {"striker_velocity_m_s": 0.02, "fracture_j": 0.15, "broken_bars": 0.15}
"""The same at the end: cracking amplifies every rounding error."""


def deviations(mine: dict[str, Any], theirs: dict[str, Any], precision: str) -> list[str]:
    """Where a history leaves another's tolerances, a line each."""
    import numpy as np

    whole = (theirs["fracture_j"] == 0) & (mine["fracture_j"] == 0)
    found = []
    for name in ("striker_force_n", "ring_force_n", "strain_j", "kinetic_plate_j"):
        a, b = mine[name][whole], theirs[name][whole]
        worst = np.abs(a - b).max() / np.abs(b).max()
        if not worst <= WHOLE[precision]:
            found.append(f"{name}: off by {worst:.1e} before any bar has softened")
    for name, band in BANDS.items():
        a, b = mine[name][-1], theirs[name][-1]
        if not abs(a - b) <= band * abs(b):
            found.append(f"{name}: {a:.4g} at the end, {b:.4g} on the CPU")
    if theirs["broken_bars"][-1] < 100:
        found.append("nothing has cracked")
    return found


def cracking(arch: str, precision: str, out: Path) -> dict[str, Any]:
    """History of the small plate on a backend."""
    from taichi_ldem.storage.folder import RunFolder

    run_scene("impact.toml", arch, precision, out, CRACKING)
    return RunFolder.open(out).read_history()


def run_scene(
    scene: str, arch: str, precision: str, out: Path, settings: dict[str, str]
) -> dict[str, Any]:
    """Run a scene into a folder; its summary."""
    words = ["--arch", arch, "--precision", precision, "--out", str(out), "--force", "--quiet"]
    words += [w for key, value in settings.items() for w in ("--set", f"{key}={value}")]
    _output(
        [sys.executable, "-m", "taichi_ldem.cli", "impact", str(ROOT / "configs" / scene), *words]
    )
    found: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return found


def large_fields(arch: str, small: bool) -> list[str]:
    """Write and read fields above 4 GiB: alone, and two in one tree whose second lies beyond."""
    ti = _started(arch)
    length = 2**20 if small else 2**29 + 2**20
    real = ti.f32 if small else ti.f64
    first, second = ti.field(real, length), ti.field(real, length)

    @ti.kernel
    def fill(field: ti.template(), sign: int):
        for n in range(length):
            field[n] = sign * (n % 8191)

    @ti.kernel
    def wrong(field: ti.template(), sign: int) -> int:
        count = 0
        for n in range(length):
            if field[n] != sign * (n % 8191):
                count += 1
        return count

    fill(first, 1)
    fill(second, -1)
    lines = []
    size = length * (4 if small else 8) / 2**30
    for name, field, sign in (("first", first, 1), ("second", second, -1)):
        lines.append(f"{name} field of {size:.3g} GiB: {wrong(field, sign)} wrong elements")
    return lines


def copy_bandwidth(arch: str, small: bool) -> float:
    """GB/s, read and written, of the best of ten copies."""
    import time

    ti = _started(arch)
    length = 2**22 if small else 2**27
    one, two = ti.field(ti.f32, length), ti.field(ti.f32, length)

    @ti.kernel
    def copy():
        for n in range(length):
            two[n] = one[n]

    copy()
    ti.sync()
    best = float("inf")
    for _ in range(10):
        begun = time.perf_counter()
        for _ in range(10):
            copy()
        ti.sync()
        best = min(best, (time.perf_counter() - begun) / 10)
    return 8 * length / best / 1e9


def _started(arch: str) -> Any:
    from taichi_ldem.scene import Solver
    from taichi_ldem.solver import backend

    backend.start(Solver(duration=1.0, arch=arch))
    import taichi as ti

    return ti


def _output(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode}: {(done.stderr or done.stdout)[-1500:]}")
    return done.stdout


def step_line(arch: str, precision: str, modules: int, seconds: float, copy: float) -> str:
    """One timing of the full step, in words."""
    command = [sys.executable, str(HERE / "step.py"), str(ROOT / "configs/impact.toml")]
    command += ["--arch", arch, "--precision", precision, "--modules", str(modules)]
    found = json.loads(_output([*command, "--seconds", str(seconds)]).splitlines()[-1])
    rate = found["step_bytes"] / found["ms"] / 1e6
    share = f", {100 * rate / copy:.0f} % of a copy" if copy else ""
    return (
        f"{found['bars']:,} bars {precision}: {found['ms']:.4f} ms/step, "
        f"{found['mbar_s']:.0f} Mbar/s, {found['step_bytes'] / 1e6:.1f} MB/step, "
        f"{rate:.0f} GB/s{share}; setup {found['setup_s']:.1f} s; "
        f"fields {found['field_bytes'] / 1e9:.2f} GB"
    )


def part(name: str, options: argparse.Namespace, copy: float) -> tuple[list[str], bool]:
    """Measure a part; lines of text, and whether all is well."""
    arch, small = options.arch, options.small
    if name in ("fields", "copy"):
        own = [sys.executable, __file__, "--arch", arch, "--inside", name]
        lines = _output(own + ["--small"] * small).strip().splitlines()
        return lines, name == "copy" or all(": 0 wrong" in line for line in lines)
    lines, well = [], True
    for precision in options.precision:
        if name == "agree":
            cpu = cracking("cpu", precision, OUT / f"cpu-{precision}")
            device = cracking(arch, precision, OUT / f"{arch}-{precision}")
            found = deviations(device, cpu, precision)
            well &= not found
            lines += [f"{precision}: {text}" for text in found or ["agrees with the CPU"]]
        elif name == "run":
            scene, settings = "impact.toml", {"output.checkpoint_interval": "0"}
            if small:
                scene, settings = "impact_small.toml", settings | {"solver.duration": "2e-5"}
            summary = run_scene(scene, arch, precision, OUT / f"run-{precision}", settings)
            told = {k: summary[k] for k in ("wall_s", "compile_s", "steps", "bars_per_s")}
            told |= {k: summary.get(k) for k in ("first_peak_force_n", "energy_error")}
            lines.append(f"{precision}: {json.dumps(told)}")
        else:
            modules = SMALL if small else {"step": PAPER, "large": LARGE}[name]
            lines.append(step_line(arch, precision, modules, options.seconds, copy))
    return lines, well


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arch", default="cuda", help="cuda, vulkan or cpu")
    parser.add_argument("--small", action="store_true", help="small plates and fields")
    parser.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--precision", nargs="+", choices=("f64", "f32"), default=["f64", "f32"])
    parser.add_argument("--seconds", type=float, default=2.0, help="of one timing of the step")
    parser.add_argument("--inside", choices=("fields", "copy"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside == "fields":
        print("\n".join(large_fields(options.arch, options.small)))
        return 0
    if options.inside == "copy":
        print(f"{copy_bandwidth(options.arch, options.small):.1f} GB/s read and written")
        return 0
    OUT.mkdir(parents=True, exist_ok=True)
    text, failed, copy = f"# {options.arch}\n", 0, 0.0
    for name in options.part:
        try:
            lines, well = part(name, options, copy)
        except RuntimeError as error:
            lines, well = [f"failed: {error}"], False
        if name == "copy" and well:
            copy = float(lines[-1].split()[0])
        failed += not well
        text += f"\n{name}\n" + "".join(f"- {line}\n" for line in lines)
        print(f"{name}:", *lines, sep="\n  ", flush=True)
    (OUT / "device.md").write_text(text)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
