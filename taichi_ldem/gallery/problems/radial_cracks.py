"""The number of radial cracks that a fast striker makes in a thin plate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.drawing import draw_broken
from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, between

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

SPEEDS = (22.2, 40.0, 56.7, 90.0)
"""Speeds of the striker, m/s; the first and third are those of the photographs."""

FAST = 56.7
COUNTED = {22.2: 4, FAST: 8}
"""Cracks in these photographs."""

_LAYERS = "plate.modules_through_thickness={}"
_COARSE = _LAYERS.format(2)
VARIED: dict[str, tuple[str, tuple[str, ...]]] = {
    "coarse": ("0.5 mm", (_COARSE,)),
    "wide": ("0.5 mm, a striker of 8 mm", (_COARSE, "striker.diameter=0.008")),
    "strong": ("0.5 mm, strength of 106 MPa", (_COARSE, "material.failure_strain=0.0316")),
    "rough": ("0.5 mm, friction of 0.3", (_COARSE, "striker.friction=0.3")),
    "gone": ("0.5 mm, failed bars carry nothing", (_COARSE, 'material.after_failure="gone"')),
    "bar": ("paper's method, 0.33 mm", (_LAYERS.format(3), 'material.fracture="bar"')),
}
"""Runs at 56.7 m/s with coarser modules, to find the reason of the miss: in words, and keys. All
but the last differ from the first by one key."""

SCATTER = 1
"""Cracks by which plates of one kind differ."""


def _name(speed: float) -> str:
    return f"v{speed:g}"


def _counts(runs: Runs) -> dict[float, int]:
    """Radial cracks by the striker's speed."""
    found = {speed: runs.get(_name(speed)) for speed in SPEEDS}
    return {
        speed: int(run.number("radial_cracks") or 0)
        for speed, run in found.items()
        if run is not None
    }


def _counted(run: LoadedRun, speed: float, label: str = "") -> Finding:
    """The radial cracks of a run next to those of a photograph."""
    count, text = COUNTED[speed], f"radial cracks at {speed:g} m/s"
    found = int(run.number("radial_cracks") or 0)
    return between(text, "", found, count - SCATTER, count + SCATTER, run=label)


def _judge(runs: Runs) -> list[Finding]:
    counts = _counts(runs)
    found = [_counted(runs[_name(speed)], speed) for speed in counts if speed in COUNTED]
    found += [
        _counted(runs[name], FAST, words) for name, (words, _) in VARIED.items() if name in runs
    ]
    cracked = {speed: count for speed, count in counts.items() if count}
    if len(counts) > 2:
        slope = None
        if len(cracked) > 2:
            speeds, numbers = np.log(list(cracked)), np.log(list(cracked.values()))
            slope = float(np.polyfit(speeds, numbers, 1)[0])
        found.append(between("exponent of n over the speed", "", slope, 0.4, 0.6))
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    counts = _counts(runs)
    grid = figure.add_gridspec(2, max(2, len(counts)), height_ratios=(1.0, 1.0))
    axes = figure.add_subplot(grid[0, :])
    axes.loglog(list(counts), list(counts.values()), "o", label="computed")
    speeds = np.array([20.0, 100.0])
    axes.loglog(speeds, 4 * np.sqrt(speeds / 22.2), "k--", label="4 (v / 22.2 m/s)$^{1/2}$")
    axes.loglog(list(COUNTED), list(COUNTED.values()), "ks", fillstyle="none", label="photographs")
    axes.set(xlabel="speed of the striker [m/s]", ylabel="radial cracks")
    axes.legend()
    axes.set_ylim(2.7, 9.5)
    axes.set_yticks([3, 4, 5, 6, 7, 8], ["3", "4", "5", "6", "7", "8"])
    axes.set_xticks([20, 30, 50, 100], ["20", "30", "50", "100"])
    axes.minorticks_off()
    for column, speed in enumerate(counts):
        panel = figure.add_subplot(grid[1, column])
        draw_broken(panel, runs[_name(speed)])
        panel.set(xlim=(-20, 20), ylim=(-20, 20), ylabel="" if column else "y [mm]")
        panel.set_title(f"{speed:g} m/s", fontsize=11)


PROBLEM = Problem(
    title="Radial cracks of a thin plate",
    about=(
        "A bullet of steel, 4 mm wide, hits a plate of PMMA of 1 mm with 22 to 90 m/s. The plate "
        "is free at its edge, and the run ends before much comes back from there."
    ),
    source=(
        "Vandenberghe, Vermorel, Villermaux, Phys. Rev. Lett. 110, 174302 (2013): photographs with "
        "four cracks at 22.2 m/s and eight at 56.7 m/s, with a scatter of about one; the number "
        "doubles where the speed is four times as high. The mass of their bullets is not in the "
        "sources that were read; here it is that of a cylinder of 10 mm."
    ),
    runs=(
        *(
            Run(
                _name(speed),
                "radial_cracks.toml",
                (f"striker.velocity={speed!r}",),
                (_COARSE,) if speed == FAST else None,
            )
            for speed in SPEEDS
        ),
        *(
            Run(
                name,
                "radial_cracks.toml",
                (f"striker.velocity={FAST!r}", *settings),
                quick=None,
            )
            for name, (_, settings) in VARIED.items()
        ),
    ),
    judge=_judge,
    draw=_draw,
    size=(10.0, 7.0),
    why=(
        "**The striker punches a hole before the plate bends**, so fewer cracks start, and they "
        "stay short: at 90 m/s they hardly leave the hole. What is varied at 56.7 m/s shows that "
        "it is the pressing under the nose that is wrong. A striker of twice the width presses on "
        "four times the area and makes eight cracks in place of three. With modules of 0.25 mm in "
        "place of 0.5 mm there are four, and with a strength higher by 41 % four. Friction changes "
        "nothing. Where failed bars do not carry pressure, the striker goes through at once and "
        "one crack starts. Sound bars near failed ones fail too easily under pressure, which is "
        "also what is wrong in [the falling-weight test](impact.md#from-material-data-alone). "
        "The paper's method makes seven short cracks with modules of 0.33 mm; those of 0.5 mm are "
        "too coarse for its bars to soften. Poisson's ratio is 1/4 here, so that all models of the "
        "stiffness agree."
    ),
)
