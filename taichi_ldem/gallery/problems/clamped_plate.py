"""Deflection of a clamped round plate under a uniform load."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, near

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

LABELS = {
    "nodes": "clamp's circle as the nodes lie",
    "unbiased": "unbiased edge",
    "coarse": "unbiased edge, three modules",
    "nu36": "nu = 0.36, unbiased edge",
}

SHEAR = 5 / 6
"""Shear coefficient of a solid plate."""


def theory(run: LoadedRun) -> tuple[float, float]:
    """Deflection of the middle by Kirchhoff's and by Mindlin's plate, m."""
    scene, clamp = run.scene, run.scene.clamp
    assert clamp is not None
    assert clamp.inner_diameter is not None
    assert scene.plate.gravity is not None
    material, height = scene.material, scene.plate.size[2]
    radius, nu = clamp.inner_diameter / 2, material.poisson_ratio
    load = -material.density * height * scene.plate.gravity[2]
    rigidity = material.youngs_modulus * height**3 / (12 * (1 - nu**2))
    bent = load * radius**4 / (64 * rigidity)
    shear = material.youngs_modulus / (2 * (1 + nu))
    return bent, bent + load * radius**2 / (4 * SHEAR * shear * height)


def deflection(run: LoadedRun) -> float:
    """Deflection of the middle at the end, m."""
    return -float(run.history["centre_displacement_z_m"][-1])


def _judge(runs: Runs) -> list[Finding]:
    return [
        near(
            "deflection of the middle",
            "um",
            1e6 * deflection(run),
            1e6 * theory(run)[1],
            0.05,
            run=LABELS[name],
        )
        for name, run in runs.items()
    ]


def _draw(figure: Figure, runs: Runs) -> None:
    axes = figure.subplots()
    for name, run in runs.items():
        axes.plot(run.time_ms, -1e6 * run.history["centre_displacement_z_m"], label=LABELS[name])
    bent, sheared = theory(next(iter(runs.values())))
    axes.axhline(1e6 * sheared, color="k", linestyle="--", label="Mindlin")
    axes.axhline(1e6 * bent, color="k", linestyle=":", label="Kirchhoff")
    axes.set(xlabel="time [ms]", ylabel="deflection of the middle [um]")
    axes.legend(fontsize=11)


_UNBIASED = ('clamp.edge="unbiased"',)

PROBLEM = Problem(
    title="Deflection of a clamped plate",
    about=(
        "A plate of PMMA of 3 mm, clamped at a circle of 60 mm, under a uniform load (a gravity of "
        "5000 m/s2), with damping until it rests."
    ),
    source=(
        "Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells (1959), Sections 16 and 20: "
        "w = q a^4 / (64 D) for thin plates, plus q a^2 / (4 k G h) for shear (Mindlin, k = 5/6), "
        "which is the reference. The interval is 5 %."
    ),
    runs=(
        Run("nodes", "clamped_plate.toml", quick=None),
        Run("unbiased", "clamped_plate.toml", _UNBIASED, quick=None),
        Run(
            "coarse",
            "clamped_plate.toml",
            (*_UNBIASED, "plate.modules_through_thickness=3"),
        ),
        Run(
            "nu36",
            "clamped_plate.toml",
            (*_UNBIASED, "material.poisson_ratio=0.36"),
            quick=None,
        ),
    ),
    judge=_judge,
    draw=_draw,
)
