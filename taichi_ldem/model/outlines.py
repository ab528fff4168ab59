"""The body that a scene's plate is: which modules of the prism it has."""

import math

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import SceneError
from taichi_ldem.model.flaws import turned
from taichi_ldem.model.lattice import cut_out, disc, dumbbell_half_width, prism
from taichi_ldem.scene import Hole, Plate, Scene

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]


def body(scene: Scene) -> Mask:
    """(nz, ny, nx) the modules of a scene's plate.

    Raises:
        SceneError: a hole that cuts out no module or all, or a file that describes no body.
    """
    plate, mask = scene.plate, outline(scene.plate)
    for number, hole in enumerate(scene.hole):
        cut = hole_mask(plate, hole)
        if not (mask & cut).any():
            raise SceneError(f"hole[{number}]: cuts out no module")
        mask = mask & ~cut
        if not mask.any():
            within = f"which is {' x '.join(f'{side:g}' for side in plate.size)} in metres"
            raise SceneError(f"hole[{number}]: leaves nothing of the plate, {within}")
    return mask


def outline(plate: Plate) -> Mask:
    """(nz, ny, nx) the modules of a plate without its holes."""
    if plate.diameter is not None:
        return disc(*plate.modules, plate.diameter / plate.spacing)
    if plate.file is not None:
        from taichi_ldem.model import masks  # rarely used

        return masks.read(plate)
    return prism(*plate.modules) if plate.is_prism else specimen_mask(plate)


def specimen_mask(plate: Plate) -> Mask:
    """(nz, ny, nx) mask of a dumb-bell, or of a prism that is cut at an angle to the lattice."""
    edge = plate.spacing
    length, width = (side / edge for side in plate.size[:2])

    def half_width(x: Floats) -> Floats:
        if plate.narrow_width and plate.narrow_length and plate.fillet_radius:
            narrow = (plate.narrow_width, plate.narrow_length, plate.fillet_radius)
            return dumbbell_half_width(x, width, *(value / edge for value in narrow))
        return np.full_like(x, width / 2)

    return cut_out(*plate.modules, length, half_width, math.radians(plate.angle))


def hole_mask(plate: Plate, hole: Hole) -> Mask:
    """(1, ny, nx) the modules whose centre lies within a hole."""
    nx, ny, _ = plate.modules
    x, y = ((np.arange(n) + 0.5 - n / 2) * plate.spacing for n in (nx, ny))
    places = np.stack([*np.meshgrid(x, y), np.zeros((ny, nx))], axis=-1)
    if plate.angle:
        places = turned(places, math.radians(plate.angle))
    slack = 1e-9 * plate.spacing  # centres that rounding alone would put outside
    return _within(hole, places, slack)[None]


def hole_covers(hole: Hole, x: float, y: float) -> bool:
    """Whether a place of the plate, m, lies within a hole."""
    return bool(_within(hole, np.array([x, y, 0.0]), 0.0))


def _within(hole: Hole, places: npt.NDArray[np.float64], slack: float) -> Mask:
    """(...) which places (..., 3), m, are within a hole or less than ``slack`` outside of it."""
    places = turned(places - np.array([*hole.centre, 0.0]), math.radians(hole.angle))
    along, across = np.abs(places[..., 0]), np.abs(places[..., 1])
    if hole.size is None:
        assert hole.diameter is not None
        inside = np.hypot(along, across) <= hole.diameter / 2 + slack
    elif hole.shape == "rectangle":
        inside = (along <= hole.size[0] / 2 + slack) & (across <= hole.size[1] / 2 + slack)
    else:
        length, width = hole.size
        beyond = np.maximum(along - (length - width) / 2, 0.0)
        inside = np.hypot(beyond, across) <= width / 2 + slack
    return np.asarray(inside)


def hole_area(hole: Hole) -> float:
    """Area of a hole, m2."""
    if hole.size is None:
        assert hole.diameter is not None
        return math.pi * hole.diameter**2 / 4
    length, width = hole.size
    corners = 0.0 if hole.shape == "rectangle" else (4 - math.pi) * width**2 / 4
    return length * width - corners


def hole_outline(plate: Plate, hole: Hole) -> Floats:
    """(n, 2) corners of a hole's outline in the plane of the lattice, m."""
    around = np.linspace(0.0, 2 * math.pi, 121)
    if hole.size is None:
        assert hole.diameter is not None
        ends = hole.diameter / 2 * np.stack([np.cos(around), np.sin(around)], axis=1)
    elif hole.shape == "rectangle":
        ends = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]) * np.array(hole.size) / 2
    else:
        length, width = hole.size
        ends = width / 2 * np.stack([np.cos(around), np.sin(around)], axis=1)
        ends[:, 0] += np.sign(ends[:, 0]) * (length - width) / 2
    places = turned(np.pad(ends, ((0, 0), (0, 1))), -math.radians(hole.angle))
    return turned(places + np.array([*hole.centre, 0.0]), -math.radians(plate.angle))[:, :2]
