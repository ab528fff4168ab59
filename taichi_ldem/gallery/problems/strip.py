"""A crack that runs through a strip that is pulled apart: its cost, its speed, its path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, between, near
from taichi_ldem.gallery.readings import advance, speed_over_rayleigh
from taichi_ldem.studies.toughness.strip import ALL_OVER, WINDOW, geometry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.gallery.readings import Advance
    from taichi_ldem.output.loaded import LoadedRun

LABELS = {
    "bar": "paper's method",
    "bar_fine": "paper's method, half the modules' size",
    "crack": "cracks cost G_f",
    "crack_fine": "cracks cost G_f, half the modules' size",
}

_FINE = (
    "plate.size=[0.016, 0.040, 0.0008]",
    "notch.to=[-0.01, 0.0008]",
    "grips.length=3.3e-4",
)
_CRACK = ('material.fracture="crack"',)


def _crack(run: LoadedRun) -> tuple[Advance, float]:
    """The crack along y from the notch's tip, and the ligament, m."""
    tip, plane, ligament = geometry(run.scene)
    reach = ALL_OVER * run.scene.plate.size[0]
    return advance(run, tip=(plane, tip), direction=(0.0, 1.0), reach=reach), ligament


def _cost(run: LoadedRun, crack: Advance, at: float) -> float | None:
    """What the strip offers when the crack is at a distance (m), over G_f.

    The strip's free height is that between the grips, G = E' delta^2 / 2 H (Rivlin and Thomas).
    """
    time = crack.arrival(at)
    material, grips = run.scene.material, run.scene.grips
    if time is None or grips is None or material.fracture_energy is None:
        return None
    delta = float(np.interp(time, run.history["time_s"], run.history["grip_displacement_m"]))
    spacing = run.scene.plate.spacing
    held = np.floor(grips.length / spacing * 2 + 1e-6) / 2 * spacing
    height = run.scene.plate.actual_size[0] - 2 * held
    modulus = material.youngs_modulus / (1 - material.poisson_ratio**2)
    return float(modulus * delta**2 / (2 * height) / material.fracture_energy)


def _judge(runs: Runs) -> list[Finding]:
    found, speeds = [], {}
    for name, run in runs.items():
        label = LABELS[name]
        crack, ligament = _crack(run)
        start, end = (share * ligament for share in WINDOW)
        cost = _cost(run, crack, start)
        found.append(near("cost when it runs, G / G_f", "", cost, 1.0, 0.25, run=label))
        speeds[name] = speed_over_rayleigh(run, crack, start, end)
        found.append(between("speed over c_R", "", speeds[name], 0.4, 1.0, run=label))
        _, across = crack.between(start, end).path(2 * run.scene.plate.spacing)
        spread = float(np.ptp(across)) / run.scene.plate.spacing if len(across) else None
        found.append(between("path's spread", "modules", spread, 0.0, 2.0, run=label))
    for name in ("bar", "crack"):
        coarse, fine = speeds.get(name), speeds.get(f"{name}_fine")
        if f"{name}_fine" in runs:
            change = None if not coarse or not fine else 100 * (fine / coarse - 1)
            label = LABELS[name]
            found.append(
                between(
                    "change of the speed at half the modules' size", "%", change, -20, 20, run=label
                )
            )
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    front, path = figure.subplots(1, 2)
    for name, run in runs.items():
        crack, _ = _crack(run)
        front.plot(1e3 * crack.time, 1e3 * crack.front, label=LABELS[name])
        path.plot(*(1e3 * part for part in crack.path(2 * run.scene.plate.spacing)))
    front.set(xlabel="time [ms]", ylabel="crack's front from the notch [mm]")
    path.set(xlabel="along the strip [mm]", ylabel="across [mm]", ylim=(-4, 4))
    figure.legend(loc="outside lower center", ncols=2, fontsize=11)


PROBLEM = Problem(
    title="A crack in a strip",
    about=(
        "A strip of PMMA with a notch is clamped along its long edges and pulled apart slowly, "
        "until a crack runs along it. Far ahead of the crack it stores what the crack costs."
    ),
    source=(
        "cost: G_f, which the scene gives (Rivlin and Thomas 1953); the interval of 25 % is the "
        "scatter of measured fracture energies. Speed: cracks in PMMA and glass run at 0.4 c_R and "
        "more once unstable and never above c_R (Ravi-Chandar 2004; Freund 1990). Path: mode I is "
        "straight. The speed should change by less than 20 % on refinement."
    ),
    runs=(
        Run("bar", "strip.toml"),
        Run("bar_fine", "strip.toml", _FINE, quick=None),
        Run("crack", "strip.toml", _CRACK, quick=None),
        Run("crack_fine", "strip.toml", (*_FINE, *_CRACK), quick=None),
    ),
    judge=_judge,
    draw=_draw,
    size=(10.0, 5.0),
    why=(
        "**By the paper's method a crack costs two to three times G_f**, because the bar at its "
        "tip fails by its own strain, which the module size smears out; it then runs slower and "
        "wanders ([why, and how much](tension.md#what-a-crack-costs)). Broken bars are noted at "
        "samples, 1 us apart. A crack that costs G_f takes 20 of them through the window at either "
        "module size, so its two speeds are equal to 5 %, not to all digits."
    ),
)
