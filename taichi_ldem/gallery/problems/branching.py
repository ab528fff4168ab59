"""Branching of a crack in a plate of glass under a sudden traction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.drawing import draw_broken
from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, between
from taichi_ldem.gallery.readings import Array, advance, speed_over_rayleigh
from taichi_ldem.storage.fields import read_broken_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

LABELS = {
    "crack": "cracks cost G_f",
    "crack_fine": "cracks cost G_f, 0.17 mm",
    "crack_weak": "cracks cost G_f, 25 MPa",
    "crack_strong": "cracks cost G_f, 50 MPa",
    "crack_damped": "cracks cost G_f, damped by 5e4 /s",
    "bar": "paper's method",
    "bar_pulled": "paper's method, 3 MPa",
}

APART = 1.5e-3
"""Distance between two parts of the crack, m, from which it counts as branched: six modules."""

_BAR = ('material.fracture="bar"', "material.failure_strain=3.7e-4")
_PULLED = ("load[0].traction=3e6", "load[1].traction=3e6")

LASTS = 5e-3
"""Length over which both parts go on at least, m: a crack that wanders or frays has bumps of up to
3 mm, and arms are longer than 10 mm."""


def _spread(run: LoadedRun) -> tuple[Array, Array]:
    """Places along the plate, in steps of two modules, and the width of what failed there, m."""
    bars = read_broken_bars(run.folder.fields_file)
    step = 2 * run.scene.plate.spacing
    slots = np.floor(bars.position_m[:, 0] / step).astype(int)
    used = np.unique(slots)
    across = bars.position_m[:, 1]
    width = np.array([np.ptp(across[slots == n]) for n in used])
    return (used + 0.5) * step, width


def branch(run: LoadedRun) -> float | None:
    """Distance from the notch's tip at which the crack branches, m; None where it does not.

    That is where the first part begins, ``LASTS`` long at least, in which the failed bars are
    spread over more than ``APART`` everywhere. Later an arm may end, or leave the plate.
    """
    place, width = _spread(run)
    apart = np.concatenate([[False], (width > APART) & (place > 0), [False]])
    begins, ends = np.flatnonzero(apart[1:] != apart[:-1]).reshape(-1, 2).T
    long = place[ends - 1] - place[begins] >= LASTS
    return float(place[begins[long][0]]) if long.any() else None


def _speed(run: LoadedRun) -> float | None:
    """Speed of the crack before it branches, over that of Rayleigh waves."""
    at = branch(run) or 0.02
    crack = advance(run, tip=(0.0, 0.0), reach=4e-3)
    return speed_over_rayleigh(run, crack, 0.4 * at, at)


def _judge(runs: Runs) -> list[Finding]:
    found = []
    for name, run in runs.items():
        at = branch(run)
        from_tip = None if at is None else 1e3 * at
        label = LABELS[name]
        found.append(between("branches after", "mm", from_tip, 5.0, 30.0, run=label))
        found.append(between("speed before, over c_R", "", _speed(run), 0.3, 0.65, run=label))
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    columns = min(2, len(runs))
    rows = -(-len(runs) // columns)
    figure.set_size_inches(6.0 * columns, 0.8 + 3.0 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(runs) :]:
        axes.set_visible(False)
    for axes, (name, run) in zip(grid, runs.items(), strict=False):
        points = draw_broken(axes, run, timed=True)
        axes.set(xlim=(-10, 50), ylim=(-20, 20))
        axes.set_title(LABELS[name], fontsize=12)
        figure.colorbar(points, ax=axes, label="time [us]")


PROBLEM = Problem(
    title="Branching in a glass plate",
    about=(
        "A plate of soda-lime glass, 100 x 40 mm, with a notch to its middle, is pulled by a "
        "traction of 2 MPa that acts at once on both long edges. The plate is two modules thick."
    ),
    source=(
        "Bobaru and Zhang, Int. J. Fracture 196 (2015) 59, whose crack branches under this "
        "traction; Ha and Bobaru, Int. J. Fracture 162 (2010) 229 and Borden et al., Comput. "
        "Methods Appl. Mech. Eng. 217 (2012) 77 have the same problem with other numbers: the "
        "crack branches 5 to 30 mm behind the notch, and runs at 0.3 to 0.65 c_R before."
    ),
    runs=(
        Run("crack", "branching.toml"),
        Run(
            "crack_fine",
            "branching.toml",
            ("plate.modules_through_thickness=3",),
            quick=None,
        ),
        # one thing varied each, to find what the speed and the place depend on
        Run("crack_weak", "branching.toml", ("material.failure_strain=3.5e-4",), quick=None),
        Run("crack_strong", "branching.toml", ("material.failure_strain=7e-4",), quick=None),
        Run("crack_damped", "branching.toml", ("solver.damping=5e4",), quick=None),
        # bars of this size soften up to a strength of 27 MPa
        Run(
            "bar",
            "branching.toml",
            _BAR,
            quick=None,
        ),
        Run("bar_pulled", "branching.toml", (*_BAR, *_PULLED), quick=None),
    ),
    judge=_judge,
    draw=_draw,
    why=(
        "**Speed and place depend on the strength, and on the module size.** With 36 MPa the crack "
        "branches after 5 mm with modules of 0.25 mm, and after 15 mm with 0.17 mm. With 25 MPa "
        "it runs nearly straight for 30 mm and is twice as fast; with 50 MPa it first leaves its "
        "plane by 6 mm. With damping it wanders before it branches, and its speed, a mean along "
        "x, is 1 % too low. **By the paper's method the crack does not branch**: it costs several "
        "times G_f ([tension](tension.md#what-a-crack-costs)), so too little is left for a second "
        "one. With a traction of 3 MPa, which stores 2.25 times as much, it runs faster and still "
        "does not."
    ),
)
