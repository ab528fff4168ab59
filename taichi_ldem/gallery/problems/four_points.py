"""Four-point bending of a beam without a notch: stiffness and strength."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.analysis.signals import smooth_force
from taichi_ldem.gallery.drawing import draw_broken
from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, between, near
from taichi_ldem.gallery.readings import Array
from taichi_ldem.storage.fields import read_broken_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

LABELS = {"bar": "paper's method", "crack": "cracks cost G_f"}


def _arms(run: LoadedRun) -> tuple[float, float]:
    """Distance from a support to the load next to it, and half of the span, m."""
    scene = run.scene
    assert scene.supports is not None
    half = scene.supports.across / 2
    return half - abs(scene.strikers[0].position[0]), half


def _force(run: LoadedRun) -> Array:
    """Force of both strikers together, N, averaged over 25 rows."""
    force = run.history["striker_force_n"] + run.history["striker2_force_n"]
    return smooth_force(run.history["time_s"], force, 25 * run.scene.output.history_interval)


def _strength(run: LoadedRun) -> float:
    """Bending strength 3 P a / (B W^2) over the material's E eps_p."""
    arm, _ = _arms(run)
    _, width, height = run.scene.plate.actual_size
    material = run.scene.material
    assert material.failure_strain is not None
    bent = 3 * float(_force(run).max()) * arm / (width * height**2)
    return bent / (material.youngs_modulus * material.failure_strain)


def _stiffness(run: LoadedRun) -> float:
    """Force over the strikers' way over that of a slender beam with shear.

    P / 2 at a from each support bends the beam under a load by P a^2 (3 l - 4 a) / (12 E I), with
    l the span, and shears it by 6 P a / (10 G A).
    """
    arm, half = _arms(run)
    _, width, height = run.scene.plate.actual_size
    material = run.scene.material
    inertia = width * height**3 / 12
    shear = material.youngs_modulus / (2 * (1 + material.poisson_ratio))
    soft = arm**2 * (6 * half - 4 * arm) / (12 * material.youngs_modulus * inertia)
    soft += 6 * arm / (10 * shear * width * height)
    way, force = run.history["striker_displacement_m"], _force(run)
    whole = np.flatnonzero(run.history["broken_bars"] == 0)
    part = slice(len(whole) // 3, 9 * len(whole) // 10)
    return float(np.polyfit(way[part], force[part], 1)[0] * soft)


def _place(run: LoadedRun) -> float | None:
    """Distance of the crack from the middle of the beam over that of the loads."""
    bars = read_broken_bars(run.folder.fields_file)
    if not len(bars.time_s):
        return None
    first = bars.position_m[bars.time_s <= bars.time_s.min() + 1e-5]
    return float(np.median(np.abs(first[:, 0])) / abs(run.scene.strikers[0].position[0]))


def _judge(runs: Runs) -> list[Finding]:
    found = []
    for name, run in runs.items():
        label = LABELS[name]
        found.append(near("stiffness over beam theory", "", _stiffness(run), 1.0, 0.05, run=label))
        found.append(
            between("bending strength over E eps_p", "", _strength(run), 0.95, 1.3, run=label)
        )
        found.append(between("crack's place over the loads'", "", _place(run), 0.0, 1.2, run=label))
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    force, path = figure.subplots(1, 2)
    for number, (name, run) in enumerate(runs.items()):
        way, colour = 1e3 * run.history["striker_displacement_m"], f"C{number}"
        force.plot(way, _force(run), color=colour, label=LABELS[name])
        draw_broken(path, run, "xz", colour=colour)
    force.set(xlabel="way of the strikers [mm]", ylabel="force of both [N]")
    path.set(xlim=(-30, 30), ylim=(0, 6), aspect="auto")
    figure.legend(loc="outside lower center", ncols=2, fontsize=11)


PROBLEM = Problem(
    title="Four-point bending",
    about=(
        "A beam of 60 x 3 x 6 mm on supports 50 mm apart is pressed by two cylinders 25 mm apart "
        "until it breaks. Between them the bending moment is constant."
    ),
    source=(
        "beam theory with shear (Timoshenko): stiffness, and 3 P a / (B W^2) = E eps_p when the "
        "lower face comes to the strength. Bending strength of a material that softens is higher "
        "than its tensile one, by up to 30 % where E G_f / strength^2 is of the beam's height "
        "(Bazant and Planas 1998). The crack starts between the loads."
    ),
    runs=(
        Run("bar", "four_points.toml", quick=("plate.size=[0.060, 0.0012, 0.006]",)),
        Run("crack", "four_points.toml", ('material.fracture="crack"',), quick=None),
    ),
    judge=_judge,
    draw=_draw,
    size=(10.0, 5.0),
)
