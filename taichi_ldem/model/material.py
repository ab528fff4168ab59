"""A scene's material as bars: the paper's formulas, and whether the lattice is fine enough."""

from taichi_ldem.scene import Scene
from taichi_ldem.scene.checks import LARGE_SIDE, bars_of, refuse_coarse
from taichi_ldem.scene.equations import (
    DIAGONAL_LENGTH,
    FAMILY_NAMES,
    BarFamily,
    Bars,
    axial_stiffness,
    bar_families,
    characteristic_length,
    delta,
    elastic_constants,
    failure_strain,
    fracture_areas,
    phi,
    volumetric_modulus,
)

__all__ = [
    "DIAGONAL_LENGTH",
    "FAMILY_NAMES",
    "LARGE_SIDE",
    "BarFamily",
    "Bars",
    "axial_stiffness",
    "bar_families",
    "bars_of",
    "characteristic_length",
    "check",
    "delta",
    "elastic_constants",
    "failure_strain",
    "fracture_areas",
    "phi",
    "volumetric_modulus",
]


def check(scene: Scene, name: str = "") -> Bars:
    """The scene's bar families, refused where a bar cannot dissipate G_f A^f without a jump.

    Args:
        name: of the scene's file, which opens the message.

    Raises:
        SceneError: with damage on, K_r < 1 for a family (Eq. (13)): the message names the largest
            admissible module edge and the number of modules that gives it, or the limit strain.
    """
    return refuse_coarse(scene, name)
