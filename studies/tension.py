"""Tension: elastic constants, one flat crack, size, direction and pulling speed.

Every case runs in a process and a folder of its own. Finished cases are not repeated, so the study
can be interrupted and resumed:

    python -m studies.tension configs outputs/tension_study [--only NAME ...]

It writes ``tension.md``, a table for each group of cases, and ``tension.png``.
"""

import json
import math
import subprocess
import sys
from argparse import ArgumentParser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from taichi_ldem.solver.simulation import Simulation

EDGE = 3.2e-3 / 6  # of a module of the paper's plate, m
ENDS = ("grips.length=3e-4", "grips.lateral=free")  # the last nodes of both kinds, sliding freely
WIDER_GRIPS = ("grips.length=3.2e-3",)  # a staircase end has few nodes in its last plane
WEAK_SHARE = 0.3
"""Remaining share of strength and fracture energy in the weak plane of the flat cracks."""
WEAK_STRAIN = 0.005
"""Their eps_p: E G_f / (E eps_p)^2 is then 12.3 mm, 23 modules."""


@dataclass(frozen=True)
class Case:
    """A scene file of ``configs`` with overrides; ``weak``: with a plane weakened by hand."""

    group: str
    name: str
    meaning: str
    overrides: tuple[str, ...]
    scene: str = "tension.toml"
    weak: bool = False


def _prism(length: int, width: int, height: int) -> tuple[str, ...]:
    """A prism of so many of the paper's modules."""
    sides = [n * EDGE for n in (length, width, height)]
    return (f"plate.size={sides}", f"plate.modules_through_thickness={height}")


def _elastic(width: int, height: int, weights: bool) -> Case:
    length = max(24, width + height)
    slower = length / 24  # longer specimens need more time for waves
    return Case(
        "elastic",
        f"elastic-{width}x{height}-{'weighted' if weights else 'full'}",
        f"{width} x {height}",
        (
            *_prism(length, width, height),
            *ENDS,
            f"plate.surface_weights={str(weights).lower()}",
            "material.damage=false",
            "grips.velocity=0.512",  # a strain rate of 40 1/s in the shortest ones
            f"grips.ramp={1e-4 * slower}",
            f"solver.duration={3e-4 * slower}",
            # elastic: a larger step costs no accuracy and saves time
            f"solver.safety={0.9 if width > 16 else 0.5}",
        ),
    )


def _flat(length: int) -> Case:
    return Case(
        "flat",
        f"flat-{length}",
        f"{1e3 * length * EDGE:.1f}",
        (
            *_prism(length, 6, 6),
            *ENDS,
            f"material.failure_strain={WEAK_STRAIN}",
            "grips.velocity=0.2",
            "grips.ramp=5e-5",
            f"solver.duration={1e-3 + 1e-5 * length}",
        ),
        weak=True,
    )


def _size(factor: float, height: int) -> Case:
    sides = [factor * side for side in (63.5e-3, 9.53e-3, 3.2e-3)]
    return Case(
        "size",
        f"size-{height}",
        f"{factor:g} x type V, {height} modules thick",
        (
            f"plate.size={sides}",
            f"plate.modules_through_thickness={height}",
            f"plate.narrow_width={factor * 3.18e-3}",
            f"plate.narrow_length={factor * 9.53e-3}",
            f"plate.fillet_radius={factor * 12.7e-3}",
            f"grips.length={factor * 19.05e-3}",
            f"grips.gauge_length={factor * 7.62e-3}",
            f"grips.velocity={factor}",
            f"grips.ramp={factor * 1e-4}",
            "solver.duration=5e-4",
        ),
        "tension_dumbbell.toml",
    )


def _speed(speed: float) -> Case:
    return Case(
        "speed",
        f"speed-{speed:g}",
        f"{speed:g}",
        (
            f"grips.velocity={speed}",
            f"grips.ramp={1e-4 / speed}",
            f"solver.duration={1e-4 + 1e-3 / speed}",
        ),
        "tension_dumbbell.toml",
    )


WIDTHS = (4, 6, 8, 12, 16, 24)
CASES = (
    *(
        _elastic(width, height, weights)
        for weights in (True, False)
        for width, height in (*((n, n) for n in WIDTHS), (36, 6))
    ),
    *(_flat(n) for n in (6, 12, 24, 48, 96)),
    *(_size(factor, height) for factor, height in ((0.5, 3), (1, 6), (2, 12))),
    Case("direction", "prism-0", "prism, 0", WIDER_GRIPS),
    Case("direction", "prism-45", "prism, 45", (*WIDER_GRIPS, "plate.angle=45")),
    Case("direction", "dumbbell-0", "dumb-bell, 0", (), "tension_dumbbell.toml"),
    Case(
        "direction",
        "dumbbell-45",
        "dumb-bell, 45",
        ("plate.angle=45", "solver.duration=1.5e-3"),
        "tension_dumbbell.toml",
    ),
    *(_speed(v) for v in (0.5, 2.0, 8.0)),
)


def weaken(simulation: "Simulation", share: float = WEAK_SHARE) -> None:
    """Age the bars that cross the plane a quarter of a module above x = 0, for the bilinear law.

    Their peak strain is set to where ``share`` of their strength and, on that triangle of Fig. 2,
    of their fracture energy is left. The plane lies between two planes of nodes, so that a flat
    crack in it costs exactly ``share`` G_f times the section.
    """
    from taichi_ldem.model.material import check

    lattice, dynamics = simulation.dynamics.lattice, simulation.dynamics
    far = (-math.inf, -math.inf), (math.inf, math.inf)
    cut = lattice.bars_crossing(0, 0.25 * lattice.spacing, *far)
    families = check(simulation.scene)
    peak = np.zeros((*dynamics.sites, 14))
    for bar in range(14):
        family = families.longitudinal if bar < 6 else families.diagonal
        crossing = (cut >> bar & 1).astype(bool)
        peak[crossing, bar] = 1 + (1 - share) * (family.ductility - 1)
    dynamics.set_peak(peak)


def run(case: Case, configs: Path, folder: Path, extra: list[str]) -> None:
    """Run a case in a process of its own, unless it is finished already."""
    out = folder / case.name
    if (out / "summary.json").exists():
        return
    settings = [word for text in (*case.overrides, *extra) for word in ("--set", text)]
    module = ["studies.tension", "--weak"] if case.weak else ["taichi_ldem.cli"]
    words = [*module, "tension"] if not case.weak else module
    command = [sys.executable, "-m", *words, str(configs / case.scene), "--out", str(out)]
    print(f"{case.group}: {case.name}", flush=True)
    done = subprocess.run([*command, "--force", "--quiet", *settings], check=False)
    if done.returncode:
        print(f"{case.name}: failed with exit code {done.returncode}", flush=True)


def _run_weak(arguments: list[str]) -> int:
    """The child's side of a case with a weak plane."""
    from taichi_ldem.api import draw_run
    from taichi_ldem.scenarios import runner, tension
    from taichi_ldem.scene import load_scene

    parser = ArgumentParser()
    parser.add_argument("scene", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--force", action="store_true")
    parser.add_argument("--quiet", action="store_true")
    options = parser.parse_args(arguments)
    scene = load_scene(options.scene, options.set)
    return runner.run(
        scene,
        options.out,
        tension.summary,
        force=options.force,
        quiet=options.quiet,
        draw=draw_run,
        instrument=runner.Instrument(prepare=weaken),
    )


# --- tables ---------------------------------------------------------------------------------------


def _numbers(folder: Path) -> dict[str, Any]:
    """Summary of a run with further values for the tables."""
    from taichi_ldem.scene import load_scene
    from taichi_ldem.storage.folder import RunFolder

    run = RunFolder(folder)
    s, history, scene = run.read_summary(), run.read_history(), load_scene(run.scene_file)
    m, section = scene.material, s["net_section_m2"]
    if s["youngs_modulus"] is not None:
        s["modulus_error"] = s["youngs_modulus"] / m.youngs_modulus - 1
    s["width_m"] = math.sqrt(section)
    if "fracture_j" in history and m.fracture_energy is not None:
        start, end = history["fracture_j"][[0, -1]] / section
        weak = WEAK_SHARE * m.fracture_energy if start else m.fracture_energy
        s["dissipated_ratio"] = (end - start) / weak
        s["work_ratio"] = s["work_of_grips_until_parted"] / weak
        s["freed_ratio"] = s["work_ratio"] - s["dissipated_ratio"]
        s["steepest"] = _steepest(history, section)
        s["size_ratio"] = (
            s["width_m"] * s["strength"] ** 2 / (m.youngs_modulus * m.fracture_energy)
            if s["strength"]
            else None
        )
    return s


def _steepest(history: dict[str, Any], section: float) -> float:
    """Largest dissipated energy within 5 us, J/m2: large where a crack runs unstably."""
    time, fracture = history["time_s"], history["fracture_j"] / section
    later = np.interp(time + 5e-6, time, fracture)
    return float((later - fracture).max())


Column = tuple[str, str, float, str]
STRENGTH: tuple[Column, ...] = (
    ("first bar [MPa]", "stress_at_first_broken_bar", 1e-6, ".1f"),
    ("strength [MPa]", "strength", 1e-6, ".1f"),
    ("strain at peak [%]", "strain_at_peak", 100, ".2f"),
    ("dissipated / G_f", "dissipated_ratio", 1, ".2f"),
    ("E [GPa]", "youngs_modulus", 1e-9, ".3f"),
    ("energy error [%]", "energy_error_of_plate", 100, ".2f"),
)
RATE: tuple[Column, ...] = (
    ("strain rate [1/s]", "strain_rate_1_s", 1, ".0f"),
    ("stress rate [GPa/s]", "loading_rate_pa_s", 1e-9, ".0f"),
    ("kinetic / strain energy at peak", "kinetic_over_strain_energy_at_peak", 1, ".1e"),
)
TABLES: dict[str, tuple[str, tuple[Column, ...]]] = {
    "elastic": (
        "modules across y, z",
        (
            ("E [GPa]", "youngs_modulus", 1e-9, ".4f"),
            ("E against input [%]", "modulus_error", 100, "+.2f"),
            ("nu", "poisson_ratio", 1, ".4f"),
        ),
    ),
    "flat": (
        "length [mm]",
        (
            ("strength [MPa]", "strength", 1e-6, ".2f"),
            ("dissipated / plane's energy", "dissipated_ratio", 1, ".4f"),
            ("work of grips / plane's energy", "work_ratio", 1, ".3f"),
            ("set free", "freed_ratio", 1, ".3f"),
            ("largest dissipation in 5 us [J/m2]", "steepest", 1, ".0f"),
            ("energy error [%]", "energy_error_of_plate", 100, ".3f"),
        ),
    ),
    "size": (
        "specimen",
        (("section^1/2 / (E G_f / strength^2)", "size_ratio", 1, ".1f"), *STRENGTH),
    ),
    "direction": ("specimen, angle to the lattice [degrees]", STRENGTH),
    "speed": ("speed [m/s]", (*RATE, *STRENGTH)),
}


def tables(folder: Path) -> str:
    """The finished cases as Markdown tables, one a group."""
    lines = []
    for group, (first, columns) in TABLES.items():
        lines += ["", f"### {group}", ""]
        lines.append(f"| {first} | " + " | ".join(title for title, *_ in columns) + " |")
        lines.append("|---" * (len(columns) + 1) + "|")
        for case in CASES:
            if case.group == group and (folder / case.name / "summary.json").exists():
                s = _numbers(folder / case.name)
                cells = [
                    format(s[key] * scale, form) if s.get(key) is not None else "-"
                    for _, key, scale, form in columns
                ]
                name = case.meaning + (" (full face bars)" if case.name.endswith("full") else "")
                lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines[1:]) + "\n"


# --- figure ---------------------------------------------------------------------------------------


def _stress_strain(axes: "Axes", folder: Path, case: Case, *, grips: bool) -> None:
    """Stress over gauge strain, or over the separation of the grips, until the specimen parts."""
    from taichi_ldem.analysis.stress_strain import curve, rows_until_parted
    from taichi_ldem.storage.folder import RunFolder

    history = RunFolder(folder / case.name).read_history()
    section = json.loads((folder / case.name / "summary.json").read_text())["net_section_m2"]
    c = curve(history)
    x = 1e3 * history["grip_displacement_m"][1:] if grips else 100 * c.strain
    stress = 1e-6 * c.force / section
    end = rows_until_parted(c.force) + 1
    peak = int(np.argmax(stress[:end])) + 1 if not grips else end
    (line,) = axes.plot(x[:peak], stress[:peak], lw=1.8, label=case.meaning)
    # curves after the peak overlap too much by waves and damage
    axes.plot(x[peak:end], stress[peak:end], lw=0.5, alpha=0.5, color=line.get_color())


def _elastic_panel(axes: "Axes", folder: Path) -> None:
    for kind, colour in (("weighted", "C0"), ("full", "C1")):
        found = [
            (n, folder / f"elastic-{n}x{n}-{kind}")
            for n in WIDTHS
            if (folder / f"elastic-{n}x{n}-{kind}" / "summary.json").exists()
        ]
        width = [n for n, _ in found]
        error = [100 * _numbers(run)["modulus_error"] for _, run in found]
        axes.plot(width, error, "o-", color=colour, label=f"{kind} face bars")
    axes.axhspan(-0.5, 0.5, color="0.85", lw=0, label="within 0.5 %")
    axes.set(
        xlabel="modules across y and z", ylabel="E against input [%]", title="elastic, free sides"
    )
    axes.legend()


PANELS = (
    ("flat", "one flat crack in a weak plane: length [mm]", True),
    ("size", "size", False),
    ("direction", "angle to the lattice [degrees]", False),
    ("speed", "speed [m/s]", False),
)


def figure(folder: Path, file: Path) -> None:
    """Draw what is finished: elastic error over width and the stress-strain curves of a group."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    drawing, axes = plt.subplots(3, 2, figsize=(12, 13), layout="constrained")
    _elastic_panel(axes.flat[0], folder)
    for place, (group, title, grips) in zip(axes.flat[1:], PANELS, strict=False):
        for case in CASES:
            if case.group == group and (folder / case.name / "summary.json").exists():
                _stress_strain(place, folder, case, grips=grips)
        x = "separation of the grips [mm]" if grips else "gauge strain [%]"
        place.set(xlabel=x, ylabel="nominal stress [MPa]", title=title)
        place.set_ylim(bottom=0)
        if group != "flat":
            place.axhspan(75 * 0.85, 75 * 1.15, color="C3", alpha=0.1, lw=0, label="75 MPa ± 15 %")
        if place.has_data():
            place.legend(fontsize=9)
    _energy_panel(axes.flat[5], folder)
    for place in axes.flat:
        place.grid(alpha=0.3)
    drawing.savefig(file, dpi=110)
    plt.close(drawing)


def _energy_panel(axes: "Axes", folder: Path) -> None:
    """Dissipated energy over the grips' work for the flat cracks."""
    cases = [c for c in CASES if c.group == "flat" and (folder / c.name / "summary.json").exists()]
    length = [float(c.meaning) for c in cases]
    numbers = [_numbers(folder / c.name) for c in cases]
    for key, label, style in (
        ("work_ratio", "work of the grips until parted", "C7s--"),
        ("dissipated_ratio", "dissipated", "C3o-"),
        ("freed_ratio", "set free: motion and strain", "C1^-"),
    ):
        axes.plot(length, [s[key] for s in numbers], style, label=label)
    axes.axhline(1, color="0.5", lw=0.8)
    axes.set(xlabel="length [mm]", ylabel="over the plane's energy", title="energy of a flat crack")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=9)


def main() -> None:
    """Run what is missing, write ``tension.md`` and ``tension.png``."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("configs", type=Path, help="folder of the scene files: configs")
    parser.add_argument("folder", type=Path, help="where the run folders go")
    parser.add_argument("--only", nargs="*", choices=[c.name for c in CASES], metavar="NAME")
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    extra = [f"solver.threads={options.threads}"] if options.threads else []
    for case in CASES:
        if not options.only or case.name in options.only:
            run(case, options.configs, options.folder, extra)
    (options.folder / "tension.md").write_text(tables(options.folder))
    figure(options.folder, options.folder / "tension.png")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--weak"]:
        sys.exit(_run_weak(sys.argv[2:]))
    main()
