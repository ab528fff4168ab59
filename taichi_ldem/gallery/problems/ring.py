"""A ring that expands breaks into pieces: their number."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.gallery.problem import Finding, Problem, Run, Runs, between

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taichi_ldem.output.loaded import LoadedRun

RATES = (1000.0, 1700.0, 3000.0)
"""Rates of strain at the start, 1/s. Below 580 per second the ring rings and does not break."""

SMALLEST = 0.2
"""Share of the mean piece's mass from which a piece counts: the rest is dust of the cracks."""


def _name(model: str, rate: float) -> str:
    return f"{model}_{rate:g}"


def _perimeter(run: LoadedRun) -> float:
    scene = run.scene
    inner = scene.hole[0].diameter
    assert inner is not None
    return math.pi * 0.5 * (scene.plate.size[0] + inner)


def _material(run: LoadedRun) -> tuple[float, float, float, float]:
    """E (Pa), density (kg/m3), G_f (J/m2) and strength (Pa)."""
    material = run.scene.material
    assert material.fracture_energy is not None
    assert material.failure_strain is not None
    modulus = material.youngs_modulus
    return modulus, material.density, material.fracture_energy, modulus * material.failure_strain


def _at_failure(run: LoadedRun, rate: float) -> float:
    """Rate of strain that is left when the ring comes to its strength, 1/s.

    The ring slows itself down: v^2 = v_0^2 - c^2 eps_p^2 for its radial speed v = rate R.
    """
    modulus, density, _, strength = _material(run)
    slowed = math.sqrt(modulus / density) * strength / modulus * 2 * math.pi / _perimeter(run)
    return math.sqrt(max(rate**2 - slowed**2, 0.0))


def grady(run: LoadedRun, rate: float) -> float:
    """Number of pieces whose kinetic energy of expansion pays for their cracks (Grady 1982)."""
    _, density, energy, _ = _material(run)
    rate = _at_failure(run, rate)
    size = (24 * energy / (density * rate**2)) ** (1 / 3)
    return float(_perimeter(run) / size)


def zhou(run: LoadedRun, rate: float) -> float:
    """Number of pieces by the fit to cohesive rings of Zhou, Molinari and Ramesh 2006."""
    modulus, density, energy, strength = _material(run)
    speed = math.sqrt(modulus / density)
    scaled = _at_failure(run, rate) / (speed * strength**3 / (modulus**2 * energy))
    length = modulus * energy / strength**2
    size = length * 4.5 / (1 + 0.77 * scaled**0.25 + 5.4 * scaled**0.75)
    return float(_perimeter(run) / size)


def pieces(run: LoadedRun) -> int:
    """Number of pieces at the end that are no dust."""
    from taichi_ldem.storage.fragments import read_fragments

    table = read_fragments(run.folder.fragments_file)
    masses = np.sort(table["mass_kg"][table["time_s"] == table["time_s"].max()])[::-1]
    typical = masses[: max(1, len(masses) // 4)].mean()
    return int((masses > SMALLEST * typical).sum())


def _judge(runs: Runs) -> list[Finding]:
    found = []
    for model, label in (("bar", "paper's method"), ("crack", "cracks cost G_f")):
        for rate in RATES:
            run = runs.get(_name(model, rate))
            if run is None:
                continue
            low, high = grady(run, rate), 1.3 * zhou(run, rate)
            where = f"{label}, {rate:g} /s"
            found.append(between("pieces", "", pieces(run), round(low), round(high), run=where))
    return found


def _draw(figure: Figure, runs: Runs) -> None:
    axes = figure.subplots()
    for model, label in (("bar", "paper's method"), ("crack", "cracks cost G_f")):
        known = [rate for rate in RATES if _name(model, rate) in runs]
        counts = [pieces(runs[_name(model, rate)]) for rate in known]
        if not known:
            continue
        axes.loglog(known, counts, "o-", label=label)
    any_run = next(iter(runs.values()))
    rates = np.geomspace(620, 4000, 60)
    axes.loglog(rates, [grady(any_run, rate) for rate in rates], "k--", label="Grady 1982")
    axes.loglog(rates, [zhou(any_run, rate) for rate in rates], "k:", label="Zhou et al. 2006")
    axes.set(xlabel="rate of strain [1/s]", ylabel="pieces")
    axes.legend()


PROBLEM = Problem(
    title="Fragments of an expanding ring",
    about=(
        "A ring of PMMA, 102 mm in mean diameter with a section of 2 x 2 mm, expands at a rate of "
        "strain of 1000 to 3000 per second at first, until it breaks."
    ),
    source=(
        "Grady, J. Appl. Phys. 53 (1982) 322 takes the kinetic energy of expansion alone, so it "
        "gives the fewest pieces; the fit of Zhou, Molinari and Ramesh, Appl. Phys. Lett. 88 "
        "(2006) 261918 to rings of cohesive elements without flaws gives the most. The number "
        "should lie between the two, with 30 % above the second for the fit's scatter."
    ),
    runs=tuple(
        Run(
            _name(model, rate),
            "ring.toml",
            (f'material.fracture="{model}"', f"start.expansion={rate!r}"),
            () if model == "bar" and rate == 1000.0 else None,
        )
        for model in ("bar", "crack")
        for rate in RATES
    ),
    judge=_judge,
    draw=_draw,
)
