"""Curves of the tension test: stress and force over the strain of the gauge."""

from __future__ import annotations

import math

import numpy as np

from taichi_ldem.analysis import paper
from taichi_ldem.output.curves.chart import RED, Box, Curve, Element, Panel, Point
from taichi_ldem.output.loaded import LoadedRun

_STRAIN = "gauge strain [%]"


def stress_strain(run: LoadedRun) -> tuple[Panel, ...]:
    """Nominal stress over strain, with the paper's measurements where the modulus is theirs."""
    from taichi_ldem.analysis.stress_strain import curve, rows_until_parted

    section = float(run.summary["net_section_m2"])
    found = curve(run.history)
    strain, stress = 100 * found.strain, 1e-6 * found.force / section
    end = rows_until_parted(found.force)
    peak = int(np.argmax(stress[:end]))
    after = slice(peak, end + 1)
    elements: list[Element] = [
        Curve(strain[: peak + 1], stress[: peak + 1], "computed", width=2.2),
        Curve(strain[after], stress[after], "after the peak, until the specimen parts", width=0.8),
    ]
    strength = run.number("strength")
    if strength is not None:
        text = f"{1e-6 * strength:.1f} MPa"
        place = float(strain[peak]), float(stress[peak])
        elements.append(Point(*place, text=text, shift=(-36.0, 14.0)))
    if math.isclose(run.scene.material.youngs_modulus, paper.YOUNGS_MODULUS_PA):
        elements += _measured()
    modulus, ratio = run.number("youngs_modulus"), run.number("poisson_ratio")
    note = ""
    if modulus is not None and ratio is not None:
        note = f"E = {1e-9 * modulus:.3f} GPa, nu = {ratio:.3f}"
    panel = Panel(
        "stress_strain",
        "Stress over strain",
        _STRAIN,
        "nominal stress [MPa]",
        elements,
        y_range=(0.0, None),
        note=note,
        path=(100 * run.history["gauge_strain"], 1e-6 * run.history["grip_force_n"] / section),
    )
    return (panel,)


def _measured() -> list[Element]:
    """Modulus and strength of the paper's tension tests."""
    modulus, strength = paper.YOUNGS_MODULUS_PA, paper.STRENGTH_PA
    scatter, top = paper.STRENGTH_SCATTER, 1e-6 * strength
    line = np.array((0.0, 100 * strength / modulus)), np.array((0.0, top))
    text = f"measured strength, {top:g} MPa ± {100 * scatter:g} %"
    return [
        Curve(*line, f"measured, E = {1e-9 * modulus:g} GPa", RED, 1.2, "dash"),
        Box(text, y=(top * (1 - scatter), top * (1 + scatter))),
    ]


def force_strain(run: LoadedRun) -> tuple[Panel, ...]:
    """The grips' pull over strain, for a run whose net section is not known yet."""
    strain, force = 100 * run.history["gauge_strain"], run.history["grip_force_n"]
    curves = [Curve(strain, force, "computed")]
    title = "Force over strain"
    return (Panel("force_strain", title, _STRAIN, "grip force [N]", curves, path=(strain, force)),)
