"""The Brazilian test: a disc that is pressed between two platens splits along its diameter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.drawing import draw_broken
from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, between, near
from taichi_ldem.storage.fields import read_broken_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

LABELS = {
    "bar": "paper's method",
    "crack": "cracks cost G_f",
    "wide": "paper's method, platens of 5 mm",
    "widest": "paper's method, platens of 8 mm",
}


def _platens(half: float, edge: float) -> tuple[str, ...]:
    """Settings for platens of a half width, which hold all beyond a distance from y = 0; m."""
    upper = f"load[0].box=[[{-half!r}, {edge!r}, -0.001], [{half!r}, 0.011, 0.003]]"
    lower = f"load[1].box=[[{-half!r}, -0.011, -0.001], [{half!r}, {-edge!r}, 0.003]]"
    return upper, lower


def _strength(run: LoadedRun) -> float:
    """Splitting strength 2 P / (pi t D) over the material's E eps_p."""
    plate, material = run.scene.plate, run.scene.material
    assert plate.diameter is not None
    assert material.failure_strain is not None
    force = float(np.max(np.abs(run.history["upper_force_n"])))
    split = 2 * force / (math.pi * plate.size[2] * plate.diameter)
    return split / (material.youngs_modulus * material.failure_strain)


def _off_diameter(run: LoadedRun) -> float | None:
    """Median distance of the bars that failed in the middle third from the loaded diameter, mm."""
    place = read_broken_bars(run.folder.fields_file).position_m
    radius = run.scene.plate.size[1] / 2
    middle = np.abs(place[:, 1]) < radius / 3
    return 1e3 * float(np.median(np.abs(place[middle, 0]))) if middle.any() else None


def _judge(runs: Runs) -> list[Finding]:
    found = []
    for name, run in runs.items():
        label = LABELS[name]
        found.append(
            near("splitting strength over E eps_p", "", _strength(run), 1.0, 0.15, run=label)
        )
        spacing = 1e3 * run.scene.plate.spacing
        distance = _off_diameter(run)
        found.append(
            between("crack off the diameter, middle", "mm", distance, 0.0, 2 * spacing, run=label)
        )
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    grid = figure.subplots(1, 1 + len(runs), squeeze=False)[0]
    for axes, (name, run) in zip(grid[1:], runs.items(), strict=True):
        grid[0].plot(run.time_ms, np.abs(run.history["upper_force_n"]), label=LABELS[name])
        draw_broken(axes, run)
        turn = np.linspace(0, 2 * np.pi, 200)
        radius = 1e3 * run.scene.plate.size[1] / 2
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), "0.6")
        axes.set_title(LABELS[name].replace(", ", ",\n"), fontsize=11)
    grid[0].set(xlabel="time [ms]", ylabel="force of a platen [N]")
    figure.legend(loc="outside lower center", ncols=2, fontsize=11)


PROBLEM = Problem(
    title="Brazilian disc",
    about=(
        "A disc of PMMA, 20 mm wide and 2 mm thick, is pressed together by two platens of 2.4 mm, "
        "slowly, until it splits."
    ),
    source=(
        "sigma = 2 P / (pi t D) (Hertz; ASTM D3967): the tension across the loaded diameter when "
        "it splits is the strength. Flat platens of 0.12 D lower it by 2 % (Hondros 1959); "
        "measured ratios of splitting to direct strength scatter by 15 % and more."
    ),
    runs=(
        Run("bar", "brazilian_disc.toml"),
        Run("crack", "brazilian_disc.toml", ('material.fracture="crack"',), quick=None),
        Run("wide", "brazilian_disc.toml", _platens(0.0025, 0.0095), quick=None),
        Run("widest", "brazilian_disc.toml", _platens(0.004, 0.0090), quick=None),
    ),
    judge=_judge,
    draw=_draw,
    why=(
        "**The lattice crushes under narrow platens, so it cannot do this test.** A bar across a "
        "pressure stretches by nu times the strain along it, so a column breaks at 1/nu = 4 times "
        "its tensile strength. A disc that splits presses on platens of 0.12 D with 13 times its "
        "strength. Wider platens show this."
    ),
    size=(14.0, 5.0),
)
