"""Views of the plate: where the eye is, what is cut off, and the panels of a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.output.render.scales import Colour
from taichi_ldem.storage.store import Fields

FloatArray = NDArray[np.floating[Any]]

SIZE_PX = (1400, 1050)
"""Width and height of a picture, pixels."""
WIDTH = 0.96
"""Width of every panel, as a share of the picture's."""
BOTTOM, HEIGHT = 0.10, 0.82
"""Lower edge and height of a picture's only panel, as shares of the picture's height."""
_MARGIN = 1.1


@dataclass(frozen=True)
class Panel:
    """One parallel projection: its place in the figure and what it shows."""

    bottom: float  # lower edge and height, shares of the figure's height
    height: float
    rotation: FloatArray  # (3, 3); rows: the picture's right, its up, direction towards the eye
    span: float  # [m] across
    scale_bar: float  # [m]
    label: str = ""
    triad: bool = True  # whether it has the directions of x, y, z

    @property
    def aspect(self) -> float:
        """Height over width."""
        return self.height * SIZE_PX[1] / (WIDTH * SIZE_PX[0])


@dataclass(frozen=True)
class View:
    """A picture: its title, its panels, and the plane that cuts the plate.

    Attributes:
        section: axis and position (m) of the plane; None: the plate is whole.
    """

    title: str
    panels: tuple[Panel, ...]
    section: tuple[int, float] | None = None

    @property
    def faces_its_cut(self) -> bool:
        """Whether the eye looks along the cut's normal, where depth does not show."""
        if self.section is None:
            return False
        return bool(abs(self.panels[0].rotation[2, self.section[0]]) > 0.99)

    def part(self, fields: Fields) -> NDArray[np.bool_]:
        """Modules (C,) that are not before the section plane."""
        if self.section is None:
            return np.ones(len(fields.hexahedra), dtype=bool)
        axis, position = self.section
        centres = fields.points[fields.hexahedra].mean(axis=1)[:, axis]
        towards = self.panels[0].rotation[2, axis]
        # With an odd number of modules across, the row in the middle stays whole.
        edge = 1e-6 * float(np.ptp(fields.points[:, axis]))
        return centres < position + edge if towards > 0 else centres > position - edge


def _single(size: FloatArray, rotation: FloatArray) -> tuple[Panel]:
    """One panel that holds a plate of `size` (3,) [m]."""
    panel = Panel(BOTTOM, HEIGHT, rotation, 0.0, 0.01)
    width, height = np.abs(rotation[:2]) @ size
    return (replace(panel, span=_MARGIN * max(width, height / panel.aspect)),)


def rotation_of(azimuth: float, elevation: float) -> FloatArray:
    """For an eye at the given angles [degrees] from the -y axis and above the plate."""
    sin_a, sin_e = np.sin(np.deg2rad((azimuth, elevation)))
    cos_a, cos_e = np.cos(np.deg2rad((azimuth, elevation)))
    right = (cos_a, sin_a, 0.0)
    up = (-sin_a * sin_e, cos_a * sin_e, cos_e)
    return np.array((right, up, np.cross(right, up)))


def _below(size: FloatArray) -> View:
    # Looking up with y upwards puts x to the left, as on the photographs of the tension face.
    return View("from below (tension face)", _single(size, rotation_of(180.0, -90.0)))


def _above(size: FloatArray) -> View:
    return View("from above (struck face)", _single(size, rotation_of(25.0, 40.0)))


def _cut(size: FloatArray) -> View:
    side = rotation_of(0.0, 0.0)
    whole = _MARGIN * size[0]
    enlarged = 10 * size[2]
    if enlarged >= whole:  # a beam rather than a plate
        return View("cut through y = 0, near half removed", _single(size, side), (1, 0.0))
    upper = Panel(0.68, 0.23, side, whole, 0.01, "whole width", triad=False)
    lower = Panel(BOTTOM, 0.55, side, enlarged, 0.001, "middle, enlarged")
    return View("cut through y = 0, near half removed", (upper, lower), (1, 0.0))


VIEWS: dict[str, Callable[[FloatArray], View]] = {"below": _below, "above": _above, "cut": _cut}
"""The three standing views by name, each for a plate of a size (3,), m."""
# Where the eye of each is: azimuth, elevation, degrees.
_EYES = {"below": (180.0, -90.0), "above": (25.0, 40.0), "cut": (0.0, 0.0)}


@dataclass(frozen=True)
class Shot:
    """A picture with a view, camera, section or colour of its own.

    Attributes:
        view: "below", "above" or "cut"; the other attributes replace parts of it.
        azimuth, elevation: of the eye, degrees from the -y axis and above the plate.
        section: ("x" | "y" | "z", position in m) of a plane; the part before it is not drawn.
        colour: the quantity by which modules are coloured.

    Raises:
        SceneError: there is no such view or colour.
    """

    view: str = "below"
    azimuth: float | None = None
    elevation: float | None = None
    section: tuple[str, float] | None = None
    colour: Colour = "damage"

    @property
    def name(self) -> str:
        """The attributes that are given, for a file's name: "above_x0", "below_energy", ..."""
        parts = [self.view]
        parts += [] if self.azimuth is None else [f"az{self.azimuth:g}"]
        parts += [] if self.elevation is None else [f"el{self.elevation:g}"]
        parts += [] if self.section is None else [f"{self.section[0]}{self.section[1]:g}"]
        parts += [] if self.colour == "damage" else [self.colour]
        return "_".join(parts)

    def __post_init__(self) -> None:
        for name, value, known in (
            ("--view", self.view, tuple(VIEWS)),
            ("--colour", self.colour, get_args(Colour)),
        ):
            if value not in known:
                raise SceneError(f"{name} {value}: must be {', '.join(known[:-1])} or {known[-1]}")


def parse_section(text: str) -> tuple[str, float]:
    """A section plane from text such as "y=0.002"; SceneError for any other text."""
    axis, equals, position = (part.strip() for part in text.partition("="))
    try:
        place = float(position)
    except ValueError:
        place = np.nan
    if axis not in ("x", "y", "z") or not equals or not np.isfinite(place):
        raise SceneError(f"--section {text}: must be x=METRES, y=METRES or z=METRES")
    return axis, place


def view_of(shot: Shot, size: FloatArray) -> View:
    """The view of a shot of a plate of a size (3,), m."""
    view = VIEWS[shot.view](size)
    if shot.azimuth is not None or shot.elevation is not None:
        azimuth, elevation = _EYES[shot.view]
        azimuth = azimuth if shot.azimuth is None else shot.azimuth
        elevation = elevation if shot.elevation is None else shot.elevation
        title = f"azimuth {azimuth:g}°, elevation {elevation:g}°"
        view = View(title, _single(size, rotation_of(azimuth, elevation)), view.section)
    if shot.section is not None:
        axis, position = shot.section
        title = f"{view.title.partition(',')[0] if view.section is None else ''}"
        title = f"{title}  cut at {axis} = {1e3 * position:g} mm".strip()
        view = replace(view, title=title, section=("xyz".index(axis), position))
    return view
