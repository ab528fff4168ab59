"""The image of one panel: visible faces, their light, solid bodies in front of the plate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.output.render.bodies import Bodies
from taichi_ldem.output.render.scales import Scale
from taichi_ldem.output.render.surfaces import Surface
from taichi_ldem.output.render.views import Panel
from taichi_ldem.storage.fields import Fields

if TYPE_CHECKING:
    from taichi_ldem.output.render.painter import Painter

FloatArray = NDArray[np.floating[Any]]

BODY_RGB = np.array((0.25, 0.48, 0.75))
_OPACITY = 0.4  # of solid bodies
_BEHIND_RGB = np.array((0.72, 0.80, 0.88))  # faces far behind a cut
_WALL_RGB = np.array((0.50, 0.44, 0.40))  # walls of cracks there


def panel_image(
    painter: Painter,
    surface: Surface,
    panel: Panel,
    middle: FloatArray,
    scale: Scale,
    bodies: Bodies,
    fade: float | None,
) -> FloatArray:
    """An image (rows, columns, 3) of the plate with solid bodies over it, RGB.

    Args:
        middle: (3,) place in the middle of the panel, m.
        fade: depth behind a cut at which half of the colour is left, m; None: nothing fades.
    """
    towards_eye = surface.normals @ panel.rotation.T
    seen = towards_eye[:, 2] > 0
    corners = (surface.corners[seen] - middle) @ panel.rotation.T
    colours = scale.rgb(surface.value[seen])
    light = np.array((-0.35, 0.45, 0.82))
    if -0.99 < panel.rotation[2, 2] < 0:  # seen from below, the faces of interest look down
        light[1] *= -1
    colours = colours * _brightness(towards_eye[seen], surface.opened[seen], light)[:, None]
    if fade is not None:
        colours = _fade(colours, corners[..., 2].mean(axis=1), fade, surface.opened[seen])
    image = _paint(painter, corners, colours, panel)
    turned = bodies.normals @ panel.rotation.T
    front = turned[:, 2] > 0
    if not front.any():
        return image
    solids = (bodies.faces[front] - middle) @ panel.rotation.T
    closed = np.zeros(front.sum(), dtype=bool)
    shade = BODY_RGB * _brightness(turned[front], closed, light)[:, None]
    both = np.concatenate([corners, solids]), np.concatenate([colours, shade])
    return (1 - _OPACITY) * image + _OPACITY * _paint(painter, *both, panel)


def _paint(painter: Painter, corners: FloatArray, colours: FloatArray, panel: Panel) -> FloatArray:
    """An image of quadrilaterals (F, 4, 3) [m] in the eye's frame; colours (F, 3)."""
    scale = np.array((panel.span / 2, panel.span / 2, np.abs(corners[..., 2]).max(initial=1e-9)))
    triangles = (corners / scale)[:, ((0, 1, 2), (0, 2, 3))].reshape(-1, 3, 3)
    return painter.paint(triangles, colours.repeat(2, axis=0), panel.aspect)


def centre(fields: Fields, panel: Panel) -> FloatArray:
    """(3,) place in the middle of the panel, m: the plate's middle, lowered by its deflection."""
    middle: FloatArray = (fields.points.min(axis=0) + fields.points.max(axis=0)) / 2
    shown = np.abs(fields.points[:, 0] - middle[0]) < panel.span / 2
    height = (fields.points[:, 2] + fields.displacement[:, 2])[shown]
    middle[2] = np.nanquantile(height, (0.1, 0.9)).mean()  # loose fragments may be anywhere
    return middle


def _brightness(normals: FloatArray, opened: NDArray[np.bool_], light: FloatArray) -> FloatArray:
    """(F,) brightness of faces, normals (F, 3) in the eye's frame; cracks' walls are darker."""
    brightness = 0.68 + 0.32 * np.maximum(0.0, normals @ light) / np.linalg.norm(light)
    brightness[opened] *= 0.85  # with more, grey and yellow would leave the colour scale
    return np.asarray(brightness)


def _fade(
    colours: FloatArray, depth: FloatArray, half: float, opened: NDArray[np.bool_]
) -> FloatArray:
    """Tint the faces behind a cut, by half at depth -`half`, to distinguish them from the cut."""
    share = np.exp2(np.minimum(0.0, depth) / half)[:, None]
    return colours * share + np.where(opened[:, None], _WALL_RGB, _BEHIND_RGB) * (1.0 - share)
