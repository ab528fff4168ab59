"""A free beam that is struck: its momentum, and the frequency at which it rings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, near

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

LABELS = {"six": "six modules", "three": "three modules"}


def frequency(run: LoadedRun) -> float:
    """First bending frequency of a free bar by ASTM E1876, Hz.

    E = 0.9465 (m f^2 / b) (L^3 / t^3) T1, where T1 corrects for shear and rotation.
    """
    material = run.scene.material
    length, width, height = run.scene.plate.actual_size
    nu, ratio = material.poisson_ratio, height / length
    mass = material.density * length * width * height
    correction = (
        1
        + 6.585 * (1 + 0.0752 * nu + 0.8109 * nu**2) * ratio**2
        - 0.868 * ratio**4
        - 8.340
        * (1 + 0.2023 * nu + 2.173 * nu**2)
        * ratio**4
        / (1 + 6.338 * (1 + 0.1408 * nu + 1.536 * nu**2) * ratio**2)
    )
    return float(
        np.sqrt(
            material.youngs_modulus * width * height**3 / (0.9465 * mass * length**3 * correction)
        )
    )


def _bending(run: LoadedRun) -> tuple[np.ndarray, np.ndarray]:
    """Times after the strike, s, and the middle's displacement to the ends', m."""
    time = run.history["time_s"]
    bent = run.history["middle_displacement_z_m"] - run.history["end_displacement_z_m"]
    free = np.flatnonzero(run.history["striker_force_n"] != 0)
    start = free[-1] + 1 if len(free) else 0
    return time[start:], bent[start:]


def rings(run: LoadedRun) -> float:
    """Frequency of the largest peak of the bending's spectrum, Hz, interpolated."""
    time, bent = _bending(run)
    step = time[1] - time[0]
    window = np.hanning(len(bent)) * (bent - bent.mean())
    power = np.abs(np.fft.rfft(window, 16 * len(bent)))
    frequencies = np.fft.rfftfreq(16 * len(bent), step)
    return float(frequencies[int(np.argmax(power))])


def _judge(runs: Runs) -> list[Finding]:
    found = []
    for name, run in runs.items():
        label, striker = LABELS[name], run.scene.striker
        assert striker is not None
        mass = run.scene.material.density * float(np.prod(run.scene.plate.actual_size))
        speed = run.history["striker_velocity_m_s"]
        given = striker.mass * (striker.speed - speed[-1])
        # the first bending mode moves no momentum; higher ones none either
        mean = -float(np.mean(run.history["beam_velocity_z_m_s"][len(speed) // 2 :]))
        found.append(
            near(
                "momentum of the beam over the striker's loss",
                "",
                mass * mean / given,
                1.0,
                0.02,
                run=label,
            )
        )
        found.append(
            near("first bending frequency", "Hz", rings(run), frequency(run), 0.03, run=label)
        )
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    axes = figure.subplots()
    for name, run in runs.items():
        time, bent = _bending(run)
        axes.plot(1e3 * time, 1e6 * bent, label=LABELS[name])
    axes.set(xlabel="time [ms]", ylabel="middle to end [um]")
    figure.legend(loc="outside lower center", ncols=2, fontsize=12)


PROBLEM = Problem(
    title="Impact on a free beam",
    about="A beam of PMMA of 120 x 6 x 6 mm, free in space, is struck in its middle at 1 m/s.",
    source=(
        "momentum is conserved; the first bending frequency of a free bar is that of ASTM E1876, "
        "whose T1 holds shear and rotatory inertia. The interval is 3 %."
    ),
    runs=(
        Run("six", "free_beam.toml", quick=None),
        Run("three", "free_beam.toml", ("plate.modules_through_thickness=3",)),
    ),
    judge=_judge,
    draw=_draw,
)
