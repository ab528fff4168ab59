"""Builds the lattice of a scene with its material, or fills a built one again."""

import math
from dataclasses import fields, replace

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import SceneError
from taichi_ldem.model import disorder
from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.lattice import Lattice, cut_out, disc, dumbbell_half_width, prism
from taichi_ldem.model.material import check, volumetric_modulus
from taichi_ldem.scene import Plate, Scene
from taichi_ldem.solver.dynamics import Dynamics, Features

Drawn = dict[str, tuple[float, float]]
"""Mean and coefficient of variation of the random factors that were drawn, by property."""


def build_lattice(scene: Scene) -> Lattice:
    """The lattice of a scene's plate."""
    plate = scene.plate
    mask = prism(*plate.modules)
    if plate.diameter is not None:
        mask = disc(*plate.modules, plate.diameter / plate.spacing)
    elif not plate.is_prism:
        mask = specimen_mask(plate)
    seed = plate.perturbation_seed
    cell = CELLS[plate.lattice]
    return Lattice(mask, plate.spacing, plate.surface_weights, plate.perturbation, seed, cell)


def specimen_mask(plate: Plate) -> npt.NDArray[np.bool_]:
    """(nz, ny, nx) mask of a dumb-bell, or of a prism that is cut at an angle to the lattice."""
    edge = plate.spacing
    length, width = (side / edge for side in plate.size[:2])

    def half_width(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if plate.narrow_width and plate.narrow_length and plate.fillet_radius:
            narrow = (plate.narrow_width, plate.narrow_length, plate.fillet_radius)
            return dumbbell_half_width(x, width, *(value / edge for value in narrow))
        return np.full_like(x, width / 2)

    return cut_out(*plate.modules, length, half_width, math.radians(plate.angle))


def notch_bars(scene: Scene, lattice: Lattice) -> npt.NDArray[np.uint16]:
    """Bars that the scene's notches remove, one bit a bar.

    Raises:
        SceneError: a notch that cuts no bar.
    """
    removed = np.zeros(lattice.sites, dtype=np.uint16)
    for number, notch in enumerate(scene.notch):
        (a, b), (c, d) = notch.bounds
        cut = lattice.bars_crossing(
            notch.axes[0], notch.position, (a, c), (b, d), math.radians(scene.plate.angle)
        )
        if not cut.any():
            raise SceneError(f"notch[{number}].position = {notch.position}: the plane cuts no bar")
        removed |= cut
    return removed


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
    dynamics = Dynamics(lattice, bars, scene.material.density, features, in_strips)
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
