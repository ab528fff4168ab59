"""Builds the lattice of a scene with its material, or fills a built one again."""

import math
from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import SceneError
from taichi_ldem.model import disorder, outlines
from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.flaws import flaw_of
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.model.material import check, volumetric_modulus
from taichi_ldem.scene import Scene
from taichi_ldem.scene.values import show
from taichi_ldem.solver.dynamics import Dynamics, Features
from taichi_ldem.solver.fields import suits_one_thread

Drawn = dict[str, tuple[float, float]]
"""Mean and coefficient of variation of the random factors that were drawn, by property."""


def build_lattice(scene: Scene) -> Lattice:
    """The lattice of a scene's plate.

    Raises:
        SceneError: a hole that cuts out no module or all, or a file that describes no body.
    """
    plate, mask = scene.plate, outlines.body(scene)
    seed = plate.perturbation_seed
    cell = CELLS[plate.lattice]
    return Lattice(mask, plate.spacing, plate.surface_weights, plate.perturbation, seed, cell)


def notch_bars(scene: Scene, lattice: Lattice, time: float = 0.0) -> npt.NDArray[np.uint16]:
    """Bars that the scene's notches have removed at a time (s), one bit a bar.

    Raises:
        SceneError: a notch that cuts no bar.
    """
    removed = np.zeros(lattice.sites, dtype=np.uint16)
    for notch, cut in zip(scene.notch, notch_cuts(scene, lattice), strict=True):
        if notch.opens_at <= time:
            removed |= cut
    return removed


def notch_cuts(scene: Scene, lattice: Lattice) -> Iterator[npt.NDArray[np.uint16]]:
    """Bars that each of the scene's notches removes, one bit a bar.

    Raises:
        SceneError: a notch that cuts no bar.
    """
    for number, notch in enumerate(scene.notch):
        cut = lattice.bars_through(flaw_of(notch), math.radians(scene.plate.angle))
        if not cut.any():
            forms = ((key, getattr(notch, key)) for key in ("position", "points", "centre"))
            key, place = next(form for form in forms if form[1] is not None)
            raise SceneError(f"notch[{number}].{key} = {show(place)}: the flaw cuts no bar")
        yield cut


def _fill(dynamics: Dynamics, scene: Scene, drawn: disorder.Drawn) -> Drawn:
    """Fill what differs between bars, nodes or modules, and cut the notches."""
    features, density = dynamics.features, scene.material.density
    dynamics.volumetric, dynamics.poisson_ratio = _volumetric(scene), scene.material.poisson_ratio
    if features.strength:
        assert drawn.peak_strain is not None
        dynamics.set_strength(drawn.peak_strain)
    if features.modulus:
        assert drawn.youngs_modulus is not None
        dynamics.set_modulus(drawn.youngs_modulus)
    if features.density:
        assert drawn.density is not None
        dynamics.set_own_density(density, drawn.density)
    if features.gravity:
        assert scene.plate.gravity is not None
        dynamics.set_gravity(scene.plate.gravity)
    if features.notch:
        dynamics.set_removed(notch_bars(scene, dynamics.lattice))
    return drawn.statistics(dynamics.lattice)


def _volumetric(scene: Scene) -> float:
    """lambda - mu of a scene whose modules have an energy of their volume, Pa; 0 otherwise."""
    if scene.plate.stiffness != "volumetric":
        return 0.0
    return volumetric_modulus(scene.material.youngs_modulus, scene.material.poisson_ratio)


def build_dynamics(scene: Scene, in_strips: bool | None = None) -> tuple[Dynamics, Drawn]:
    """The lattice's fields and kernels, filled with the material of a scene.

    Args:
        in_strips: whether the step is driven in strips; None: as suits the backend.

    Returns:
        The dynamics; mean and CV of the factors that were drawn, by property.

    Raises:
        SceneError: K_r < 1, or a notch that cuts no bar.
    """
    bars, lattice = check(scene), build_lattice(scene)
    drawn = disorder.draw(scene, lattice)
    features = Features.of(scene)
    alone = in_strips is None and suits_one_thread(scene)
    dynamics = Dynamics(lattice, bars, scene.material.density, features, in_strips, alone)
    return dynamics, _fill(dynamics, scene, drawn)


def refill_dynamics(dynamics: Dynamics, scene: Scene, lattice: Lattice | None = None) -> Drawn:
    """Put a lattice back to rest, whole, with the numbers of another scene.

    Args:
        lattice: another one of the same modules in place of the scene's.

    Returns:
        Mean and CV of the factors that were drawn, by property.

    Raises:
        ValueError: the scene needs other fields or kernels; nothing has been changed then.
        SceneError: K_r < 1, or a notch that cuts no bar.
    """
    bars = check(scene)
    lattice = build_lattice(scene) if lattice is None else lattice
    drawn = disorder.draw(scene, lattice)
    features = replace(Features.of(scene), perturbed=lattice.offsets is not None)
    if lattice.modules != dynamics.lattice.modules:
        raise ValueError(
            f"plate: {lattice.modules} modules need other fields than {dynamics.lattice.modules}"
        )
    if lattice.cell is not dynamics.cell:
        raise ValueError(f"plate.lattice: {lattice.cell.name} needs other fields and kernels")
    for field in fields(Features):
        mine, other = getattr(dynamics.features, field.name), getattr(features, field.name)
        if mine != other:
            raise ValueError(f"{field.name}: {other} needs other kernels than {mine}")
    dynamics.set_lattice(lattice)
    dynamics.clear_history()
    dynamics.set_bars(bars)
    dynamics.set_density(scene.material.density)
    return _fill(dynamics, scene, drawn)
