"""Colour scales of the pictures: the quantity by which modules are coloured, and its colours."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.strain import green_strain, mean_gradient
from taichi_ldem.output.render.surfaces import FAILED_SHARE, holding
from taichi_ldem.scene import Scene
from taichi_ldem.storage.fields import Fields, read_fields
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from matplotlib.colors import Colormap, Normalize

FloatArray = NDArray[np.floating[Any]]

Colour = Literal["damage", "velocity", "energy", "fragment"]
"""Quantities by which modules can be coloured."""

# Colours over the share of failed bars: whole, damaged, about to fail.
_DAMAGE_COLOURS = ("#dfe4e8", "#f2c14e", "#d1495b", "#5c0a14")


def speed(fields: Fields) -> FloatArray:
    """(C,) mean speed of a module's corners, m/s."""
    moving: FloatArray = np.linalg.norm(fields.velocity, axis=1)[fields.hexahedra].mean(axis=1)
    return moving


def strain_energy(fields: Fields, stiffness: tuple[float, float, float]) -> FloatArray:
    """(C,) approximate strain energy density of the modules, J/m3; NaN where bars have failed.

    It follows from Green's strain of the mean gradient between the corners (the nodes at the
    centres are not stored) and the lattice's stiffness, as if no bar had softened.

    Args:
        stiffness: C11, C12, C44, Pa.
    """
    strain = green_strain(mean_gradient(fields.points, fields.hexahedra, fields.displacement))
    c11, c12, c44 = stiffness
    xx, yy, zz = (strain[:, n, n] for n in range(3))
    shear = strain[:, 0, 1] ** 2 + strain[:, 0, 2] ** 2 + strain[:, 1, 2] ** 2
    density = c11 / 2 * (xx**2 + yy**2 + zz**2) + c12 * (xx * yy + xx * zz + yy * zz)
    whole = fields.broken_fraction == 0
    return np.where(whole, density + 2 * c44 * shear, np.nan)


@dataclass(frozen=True)
class Scale:
    """The quantity by which modules are coloured and its colours, alike in all pictures of a shot.

    Attributes:
        value: (C,) of the modules, from a step's fields. label: of the colour key.
        ticks: marks of the colour key; None: where Matplotlib puts them.
    """

    value: Callable[[Fields], FloatArray]
    colours: Colormap
    norm: Normalize
    label: str
    ticks: Sequence[float] | None = None

    def rgb(self, values: FloatArray) -> FloatArray:
        """(F, 3) colours."""
        shown: FloatArray = self.colours(self.norm(np.ma.masked_invalid(values)))[:, :3]
        return shown


def damage_scale() -> Scale:
    """The share of a module's failed bars."""
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    note = (
        "broken bars of a module [%]; white or missing: modules with "
        f"{100 * FAILED_SHARE:.0f} % or more of their bars broken, still in the model"
    )
    colours = LinearSegmentedColormap.from_list("broken", _DAMAGE_COLOURS)
    return Scale(
        lambda f: 100.0 * f.broken_fraction, colours, Normalize(0, 100 * FAILED_SHARE), note
    )


def _fragment_scale(folder: RunFolder) -> Scale:
    """The piece that a module belongs to: the largest are told apart by colour, debris is grey."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap, Normalize

    from taichi_ldem.scenarios.fragment_output import fragments_of

    palette = np.delete(colormaps["tab20"](range(20)), (14, 15), axis=0)  # without its greys
    count = len(palette)
    colours = ListedColormap(np.vstack([(0.75, 0.75, 0.75, 1.0), palette]))

    def value(fields: Fields) -> FloatArray:
        number = fragments_of(folder, fields.time)
        return np.where(number > 0, (number - 1) % count + 1.0, 0.0)

    note = (
        f"piece, 1: the largest; colours repeat after {count}; 0: single nodes; "
        f"missing: {100 * FAILED_SHARE:.0f} % or more of its bars broken"
    )
    return Scale(value, colours, Normalize(-0.5, count + 0.5), note, range(0, count + 1, 2))


def scale_of(folder: RunFolder, steps: Sequence[int], colour: Colour) -> Scale:
    """The scale of a quantity over some stored steps of a run."""
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm, Normalize

    if colour == "damage":
        return damage_scale()
    if colour == "fragment":
        return _fragment_scale(folder)
    value = speed if colour == "velocity" else _energy_of(folder.read_scene())
    top = 0.0
    for step in steps:
        fields = read_fields(folder.fields_file, step)
        shown = value(fields)[holding(fields)]
        shown = shown[np.isfinite(shown)]
        if shown.size:  # a quantile: fast loose fragments must not set the scale
            top = max(top, float(np.quantile(shown, 0.95 if colour == "velocity" else 0.999)))
    top = top or 1.0
    missing = f"missing: {100 * FAILED_SHARE:.0f} % or more of its bars broken"
    if colour == "velocity":
        label = f"speed of a module [m/s]; {missing}"
        return Scale(value, colormaps["viridis"], Normalize(0.0, top, clip=True), label)
    label = f"strain energy of a module [kJ/m$^3$]; grey: bars have failed; {missing}"
    colours = colormaps["magma"].with_extremes(bad="0.6")
    norm = LogNorm(1e-6 * top, 1e-3 * top, clip=True)
    return Scale(lambda fields: 1e-3 * value(fields), colours, norm, label)


def _energy_of(scene: Scene) -> Callable[[Fields], FloatArray]:
    from taichi_ldem.model.material import elastic_constants

    m = scene.material
    stiffness = elastic_constants(m.youngs_modulus, m.poisson_ratio, scene.plate.stiffness)
    return lambda fields: strain_energy(fields, stiffness)
