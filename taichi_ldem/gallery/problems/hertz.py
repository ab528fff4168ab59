"""Hertz's contact: a large sphere that is pressed into a block."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.analysis.signals import smooth_force
from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, near
from taichi_ldem.gallery.readings import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

DEPTHS = (5e-6, 10e-6, 18e-6)
"""Depths at which the force is read, m."""

LABELS = {"block": "0.5 mm modules", "coarse": "1 mm modules"}


def theory(run: LoadedRun, depth: Array | float) -> Array:
    """Force on a rigid sphere at a depth in a half-space, N: 4/3 E/(1 - nu^2) R^1/2 d^3/2."""
    material, striker = run.scene.material, run.scene.striker
    assert striker is not None
    modulus = material.youngs_modulus / (1 - material.poisson_ratio**2)
    radius = striker.diameter / 2
    return np.asarray(4 / 3 * modulus * np.sqrt(radius) * np.asarray(depth) ** 1.5)


def _curve(run: LoadedRun) -> tuple[Array, Array]:
    """Depths (m) and forces (N), the force averaged over five rows."""
    history = run.history
    window = 5 * run.scene.output.history_interval
    force = smooth_force(history["time_s"], history["striker_force_n"], window)
    return history["striker_displacement_m"], force


def _judge(runs: Runs) -> list[Finding]:
    found = []
    for name, run in runs.items():
        depth, force = _curve(run)
        radius = 0.5 * run.scene.striker.diameter  # type: ignore[union-attr]
        for at in DEPTHS:
            modules = np.sqrt(radius * at) / run.scene.plate.spacing
            label = f"{LABELS[name]}, contact radius {modules:.1f} modules"
            found.append(
                near(
                    f"force at {1e6 * at:.0f} um",
                    "N",
                    float(np.interp(at, depth, force)),
                    float(theory(run, at)),
                    0.1,
                    run=label,
                )
            )
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    axes = figure.subplots()
    for name, run in runs.items():
        depth, force = _curve(run)
        axes.plot(1e6 * depth, force, label=LABELS[name])
    depth = np.linspace(0, 20e-6, 100)
    axes.plot(1e6 * depth, theory(next(iter(runs.values())), depth), "k--", label="Hertz")
    axes.set(xlabel="depth [um]", ylabel="force [N]")
    axes.legend()


PROBLEM = Problem(
    title="Hertz's contact",
    about=(
        "A rigid sphere of 200 mm radius is pressed slowly into a block of 40 x 40 x 20 mm that "
        "lies on a smooth floor."
    ),
    source=(
        "Hertz 1881 (Johnson, Contact Mechanics, 1985): F = 4/3 E / (1 - nu^2) R^1/2 d^3/2 for a "
        "half-space. The interval of 10 % is what a block of finite size and waves may change."
    ),
    runs=(
        Run("block", "hertz.toml", quick=None),
        Run("coarse", "hertz.toml", ("plate.modules_through_thickness=20",)),
    ),
    judge=_judge,
    draw=_draw,
)
