"""Sections on the material and the model: Figs. 2 and 6 to 9."""

from __future__ import annotations

from collections.abc import Callable
from math import gamma
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.analysis import paper
from taichi_ldem.errors import SceneError
from taichi_ldem.model.disorder import shape_from_cv
from taichi_ldem.model.material import bars_of, failure_strain
from taichi_ldem.reproduction.sections import Context, Row, Section, pictures, scaled
from taichi_ldem.storage.folder import RunFolder, read_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _draw(file: Path, size: tuple[float, float], draw: Callable[[Figure], None]) -> Path:
    from taichi_ldem.output.figures.draw import save

    file.parent.mkdir(parents=True, exist_ok=True)
    return save(file, draw, size=size, dpi=130)


def fig2(context: Context) -> Section:
    """The bilinear law of the bars, with the printed stiffness and strains."""
    scene = context.scene("impact")
    bars = bars_of(scene)
    families = (("longitudinal", bars.longitudinal), ("diagonal", bars.diagonal))

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="strain [%]", ylabel="force [N]")
        for number, (name, f) in enumerate(families):
            peak = f.axial_stiffness * f.peak_strain
            ends = 100 * np.array([-f.peak_strain, 0.0, f.peak_strain, f.limit_strain])
            label = f"{name}: K_r = {f.ductility:.2f}"
            axes.plot(ends, [-peak, 0.0, peak, 0.0], color=f"C{number}", label=label)
            half = (f.peak_strain + f.limit_strain) / 2
            axes.plot([0.0, 100 * half], [0.0, peak / 2], color=f"C{number}", ls=":", lw=1.2)
        axes.set_title("dotted: unloading from half of the softening branch", fontsize=12)
        axes.legend()

    picture = _draw(context.picture("fig2"), (8, 5), draw)
    own = {
        "EA_l [N]": bars.longitudinal.axial_stiffness,
        "EA_d [N]": bars.diagonal.axial_stiffness,
        "eps_p": bars.longitudinal.peak_strain,
        "eps_r": bars.longitudinal.limit_strain,
        "K_r": bars.longitudinal.ductility,
    }
    rows = [
        Row(name, "", value, paper.MODEL_BAR_PROPERTIES[name], digits=2 if "EA" in name else 5)
        for name, value in own.items()
    ]
    why = (
        "Eq. (2) gives EA_d = 1.299 EA_l where 0.5196 EA_l is printed (phi counted twice); "
        "E = 3.30 GPa in the printed EA_l, 3.35 here; the printed strains are not those of Eq. (9)."
    )
    return Section(rows, [(picture, "Bars of the run's scene")], why=why)


def fig6(context: Context) -> Section:
    """Stress over strain of the tension specimen."""
    summary = context.summary("tension")
    scene = context.scene("tension")
    strength, scatter = 1e-6 * paper.STRENGTH_PA, paper.STRENGTH_SCATTER
    low, high = (1 - scatter) * strength, (1 + scatter) * strength
    given = 1e-9 * scene.material.youngs_modulus
    rows = [
        Row("Young's modulus", "GPa", scaled(summary, "youngs_modulus", 1e-9), given),
        Row(
            "strength",
            "MPa",
            scaled(summary, "strength", 1e-6),
            strength,
            (low, high),
            1,
        ),
    ]
    bar = 1e-6 * scene.material.youngs_modulus * failure_strain(scene.material)
    why = (
        f"The paper's columns are its measurements. A bar holds E eps_p = {bar:.1f} MPa; free "
        "faces lower E by the share of a layer of half a module; the fillets are stairs of "
        "modules, and each step is a notch (docs/tension.md); nothing in the law is viscous."
    )
    return Section(rows, pictures(context, "tension", stress_strain="stress over strain"), why=why)


def fig7(context: Context) -> Section:
    """The fracture energy of notched bending, as a slope over several beams."""
    summary = context.summary("bending")
    energy, scatter = paper.FRACTURE_ENERGY_J_M2, paper.FRACTURE_ENERGY_SCATTER_J_M2
    given = read_scene(next(context.folder("bending").glob("*/scene.toml"))).material
    rows = [
        Row("G_f given to the bars", "J/m2", given.fracture_energy, digits=0),
        Row(
            "G_IC, slope of U over B W phi",
            "J/m2",
            summary.get("fracture_energy_slope"),
            None,
            (energy - scatter, energy + scatter),
            0,
        ),
    ]
    why = (
        "The paper measures this test and does not simulate it. A notch's tip is not resolved by "
        "modules of this size, so the crack starts late; the excess falls with the module."
    )
    return Section(rows, pictures(context, "bending", bending="U over B W phi"), why=why)


def fig8(context: Context) -> Section:
    """Size of the lattice, with a picture of the plate at rest."""
    summary, scene = context.summary("impact"), context.scene("impact")
    nodes, degrees = scaled(summary, "nodes", 3e-6), 1e-6 * paper.MODEL_DEGREES_OF_FREEDOM
    rows = [
        Row("bars", "million", scaled(summary, "bars", 1e-6), 1e-6 * paper.MODEL_BARS, digits=2),
        Row("degrees of freedom", "million", nodes, degrees, digits=2),
        Row("module edge", "mm", 1e3 * scene.plate.spacing, 1e3 * paper.MODEL_SPACING_M),
    ]
    from taichi_ldem.output.render.snapshots import render_shot
    from taichi_ldem.output.render.views import Shot

    picture, folder = context.picture("fig8"), RunFolder(context.folder("impact"))
    picture.parent.mkdir(parents=True, exist_ok=True)
    try:
        (_, drawn), *_ = render_shot(folder, Shot(view="above"), picture.parent, [0.0])
    except SceneError as error:
        return Section(rows, why=str(error))
    drawn.replace(picture)
    return Section(
        rows,
        [(picture, "the plate at rest")],
        why="The same lattice, unless the run is a quick one.",
    )


def fig9(context: Context) -> Section:
    """Distributions of the fracture energy in the random specimens."""
    mean = context.scene("impact").material.fracture_energy or 0.0

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="G_f [J/m2]", ylabel="density [m2/J]")
        x = np.linspace(1.0, 3 * mean, 600)
        for cv in paper.DISORDER_CVS:
            k = float(shape_from_cv(cv))
            scale = mean / gamma(1 + 1 / k)
            density = k / scale * (x / scale) ** (k - 1) * np.exp(-((x / scale) ** k))
            axes.plot(x, density, label=f"CV {100 * cv:g} %: shape {k:.2f}")
        axes.legend()

    picture = _draw(context.picture("fig9"), (8, 5), draw)
    why = "Weibull with mean one; Eqs. (15), (16) have their symbols mixed up, see the theory page."
    return Section([], [(picture, "Distributions of the fracture energy")], why=why)
