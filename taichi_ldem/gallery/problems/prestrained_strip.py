"""A crack in a strip that was stretched before: its speed against what the strip stores."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, between
from taichi_ldem.gallery.readings import Advance, advance, speed_over_rayleigh

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

OFFERED = (1.2, 1.6, 2.2, 3.2, 4.5)
"""G / G_f that the strips store."""

HEIGHT = 0.019
"""Height between the clamps, m."""

MODELS = {"crack": "cracks cost G_f", "bar": "paper's method"}

STRENGTH = {"crack": 0.06, "bar": 0.0175}
"""Strains at failure away from the crack: high enough for the strip to stay whole. By the paper's
method it is that of Eq. (9), as bars could not soften with a much higher one."""


def _strain(offered: float) -> float:
    """Strain at which a strip stores so much, G = E' eps^2 H / 2 with PMMA's constants."""
    modulus = 3.35e9 / (1 - 0.25**2)
    return math.sqrt(2 * offered * 1034.0 / (modulus * HEIGHT))


def _crack(run: LoadedRun) -> Advance:
    return advance(run, tip=(run.scene.notch[0].bounds[0][1], 0.0), reach=0.25 * HEIGHT)


def speed(run: LoadedRun) -> float | None:
    """Mean speed in the middle of the strip over that of Rayleigh waves."""
    return speed_over_rayleigh(run, _crack(run), 0.03, 0.07)


def _judge(runs: Runs) -> list[Finding]:
    found = []
    for model, label in MODELS.items():
        for offered in OFFERED:
            run = runs.get(f"{model}_{offered:g}")
            if run is None:
                continue
            expected = 1 - 1 / offered
            found.append(
                between(
                    f"speed over c_R at {offered:g} G_f",
                    "",
                    speed(run),
                    round(expected - 0.15, 2),
                    round(expected + 0.15, 2),
                    run=label,
                )
            )
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    axes = figure.subplots()
    for model, label in MODELS.items():
        known = [offered for offered in OFFERED if f"{model}_{offered:g}" in runs]
        if not known:
            continue
        speeds = [speed(runs[f"{model}_{offered:g}"]) or math.nan for offered in known]
        axes.plot(known, speeds, "o-", label=label)
    offered = np.linspace(1, max(OFFERED), 100)
    axes.plot(offered, 1 - 1 / offered, "k--", label="$c_R (1 - G_f / G)$")
    axes.set(xlabel="stored energy over G_f", ylabel="speed over c_R", ylim=(0, 1.1))
    axes.legend()


PROBLEM = Problem(
    title="A crack in a stretched strip",
    about=(
        "A strip of PMMA, 120 x 20 mm, is stretched across and clamped along its long edges. A "
        "notch opens at one end, and a crack runs through. Its speed is measured between 30 and 70 "
        "mm from the notch."
    ),
    source=(
        "Freund, Dynamic Fracture Mechanics (1990): v = c_R (1 - G_f / G), here with an interval "
        "of 0.15 c_R. It holds before waves come back from the clamps; later the crack in a strip "
        "gets faster (Goldman, Livne, Fineberg, Phys. Rev. Lett. 104, 114301 (2010))."
    ),
    runs=tuple(
        Run(
            f"{model}_{offered:g}",
            "prestrained_strip.toml",
            (
                f'material.fracture="{model}"',
                f"material.failure_strain={STRENGTH[model]!r}",
                f"start.strain=[0.0, {_strain(offered)!r}, 0.0]",
            ),
            () if model == "crack" and offered == 2.2 else None,
        )
        for model in MODELS
        for offered in OFFERED
    ),
    judge=_judge,
    draw=_draw,
    why=(
        "**A crack along the lattice's axis costs more than G_f**, which the misses at small G "
        "show: 1.2 to 1.4 G_f with cracks that cost G_f, and about three times G_f by the paper's "
        "method ([tension](tension.md#what-a-crack-costs)). With 1.2 G_f in place of G_f, Freund's "
        "equation gives 0.25 c_R at 1.6 G_f and 0.45 c_R at 2.2 G_f. From 3 G_f on the speed stays "
        "below 0.58 c_R, as cracks branch; in PMMA they do so at 0.4 c_R and do not get faster "
        "than about 0.6 c_R. By the paper's method the strip fails all over at 4.5 G_f."
    ),
)
