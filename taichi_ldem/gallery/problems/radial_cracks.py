"""The number of radial cracks that a fast striker makes in a thin plate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.drawing import draw_broken
from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, between

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPEEDS = (22.2, 40.0, 56.7, 90.0)
"""Speeds of the striker, m/s; the first and third are those of the photographs."""

COUNTED = {22.2: 4, 56.7: 8}
"""Cracks in these photographs."""

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


def _judge(runs: Runs) -> list[Finding]:
    counts = _counts(runs)
    found = [
        between(
            f"radial cracks at {speed:g} m/s",
            "",
            counts[speed],
            COUNTED[speed] - SCATTER,
            COUNTED[speed] + SCATTER,
        )
        for speed in counts
        if speed in COUNTED
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
    axes.set_yticks([4, 5, 6, 7, 8], ["4", "5", "6", "7", "8"])
    axes.set_xticks([20, 30, 50, 100], ["20", "30", "50", "100"])
    axes.minorticks_off()
    for column, speed in enumerate(counts):
        panel = figure.add_subplot(grid[1, column])
        draw_broken(panel, runs[_name(speed)])
        panel.set(xlim=(-40, 40), ylim=(-40, 40), ylabel="")
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
    runs=tuple(
        Run(
            _name(speed),
            "radial_cracks.toml",
            (f"striker.velocity={speed!r}",),
            ("plate.modules_through_thickness=2",) if speed == 56.7 else None,
        )
        for speed in SPEEDS
    ),
    judge=_judge,
    draw=_draw,
    size=(10.0, 7.0),
    why=(
        "**Above 50 m/s the striker punches a hole before the plate bends**, so fewer cracks start "
        "and they stay short: at 90 m/s all damage is in the hole. The lattice's bars under the "
        "nose fail where a real plate is pressed together. Sound bars near failed ones fail too "
        "easily there, which is also what is wrong in [the falling-weight "
        "test](impact.md#from-material-data-alone)."
    ),
)
