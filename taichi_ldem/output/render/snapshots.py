"""Headless pictures of the deformed, cracked plate from a run folder, drawn by Taichi's GGUI.

Drawing happens in a child process, in a temporary working directory: a Vulkan driver that aborts
takes only the child with it, and GGUI's settings file does not land in the user's directory.  The
plate is the exterior of its modules at true scale, coloured by the share of a module's bars that
have failed (or by speed or strain energy); modules that are cut in two or torn are left out, so
that cracks read as gaps. The striker is laid over it, translucent, with the clamp's circles.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.output.render.bodies import Bodies, bodies_at
from taichi_ldem.scene import Notch, Scene, load_scene
from taichi_ldem.solver.backend import vulkan_device
from taichi_ldem.storage.store import Fields, RunFolder, read_fields, read_times

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

FloatArray = NDArray[np.floating[Any]]

NO_DEVICE = (
    "no pictures: there is no Vulkan device; "
    "a software one comes with `apt install libvulkan1 mesa-vulkan-drivers` (Debian)"
)
TIMEOUT_S = 120.0
TIMEOUT_PER_PICTURE_S = 20.0
_EXIT_NO_DEVICE = 3
_SAME_TIME_S = 5e-6  # what the pictures' captions tell apart

# Share of failed bars from which a module is not drawn.  A plane between two layers of nodes cuts
# four edges and four diagonals of a module, 8 of its 20 bars: that module is cut in two.
GONE = 0.4
# A corner whose bars have all failed may fly off on its own; a module that a corner has left by
# this multiple of half a diagonal is not drawn either, it would be a spike through the picture.
_TORN = 1.5
_SIZE_PX = (1400, 1050)
_SUPERSAMPLING = 2  # GGUI has no anti-aliasing

# Local corners of a module's faces, counter-clockwise from outside, by outward direction (x, y, z).
_FACES = (
    ((-1, 0, 0), (0, 4, 7, 3)),
    ((1, 0, 0), (1, 2, 6, 5)),
    ((0, -1, 0), (0, 1, 5, 4)),
    ((0, 1, 0), (3, 7, 6, 2)),
    ((0, 0, -1), (0, 3, 2, 1)),
    ((0, 0, 1), (4, 5, 6, 7)),
)
Colour = Literal["damage", "velocity", "energy"]
# Colour over the share of failed bars: whole, damaged, about to go.
_COLOURS = ("#dfe4e8", "#f2c14e", "#d1495b", "#5c0a14")
_BEHIND = np.array((0.72, 0.80, 0.88))  # RGB of faces far behind a cut
_WALL = np.array((0.50, 0.44, 0.40))  # and of walls of cracks there
_STRIKER = np.array((0.25, 0.48, 0.75))
_OPACITY = 0.4  # of the striker


# --- the caller's side ----------------------------------------------------------------------------


def render_run(folder: RunFolder, times: list[float] | None = None) -> list[Path]:
    """Draw the plate from below, from above and cut open; one PNG a view and time.

    Args:
        folder: a run, finished or not.
        times: wanted times [s], the nearest stored steps are drawn; None: the scene's image times
            and the last step.

    Returns:
        The pictures written, `crack_<ms>ms_<view>.png`.  Without a Vulkan device, or if drawing
        fails, one line on stderr says so and what exists is returned.

    Raises:
        SceneError: the run folder's fields or scene cannot be read.
    """
    steps = _steps(folder, times)
    pictures = [picture for step in steps for picture in _pictures(folder, step)]
    for picture in pictures:
        picture.unlink(missing_ok=True)
    complaint = _draw_in_child(folder, [number for number, _ in steps], len(pictures))
    if complaint:
        print(complaint, file=sys.stderr)
    return [picture for picture in pictures if picture.is_file()]


@dataclass(frozen=True)
class Shot:
    """How a picture is taken that is none of the three standing ones.

    Attributes:
        view: "below", "above" or "cut": where the eye is and what is cut, unless told otherwise.
        azimuth, elevation: of the eye, degrees from the -y axis and above the plate.
        section: ("x" | "y" | "z", position in m): what lies before this plane is not drawn.
        colour: "damage", "velocity" or "energy".
    """

    view: str = "below"
    azimuth: float | None = None
    elevation: float | None = None
    section: tuple[str, float] | None = None
    colour: Colour = "damage"

    @property
    def name(self) -> str:
        """What is special about it, for a file's name: "above_x0", "below_energy", ..."""
        parts = [self.view]
        parts += [] if self.azimuth is None else [f"az{self.azimuth:g}"]
        parts += [] if self.elevation is None else [f"el{self.elevation:g}"]
        parts += [] if self.section is None else [f"{self.section[0]}{self.section[1]:g}"]
        parts += [] if self.colour == "damage" else [self.colour]
        return "_".join(parts)

    def __post_init__(self) -> None:
        for name, value, known in (
            ("--view", self.view, tuple(_VIEWS)),
            ("--colour", self.colour, get_args(Colour)),
        ):
            if value not in known:
                raise SceneError(f"{name} {value}: must be {', '.join(known[:-1])} or {known[-1]}")


def parse_section(text: str) -> tuple[str, float]:
    """A section plane from "y=0.002"; SceneError where it is none."""
    axis, equals, position = (part.strip() for part in text.partition("="))
    try:
        place = float(position)
    except ValueError:
        place = np.nan
    if axis not in ("x", "y", "z") or not equals or not np.isfinite(place):
        raise SceneError(f"--section {text}: must be x=METRES, y=METRES or z=METRES")
    return axis, place


def render_shot(
    folder: RunFolder, shot: Shot, into: Path, times: Sequence[float] | None = None
) -> list[tuple[float, Path]]:
    """Draw one picture a stored step; all with the same colour scale and the same frame.

    Args:
        into: an existing folder for the pictures, `shot_00012.png`.
        times: as for `render_run`; None: every stored step.

    Returns:
        (time [s], picture) each.

    Raises:
        SceneError: the run cannot be read, or drawing failed; one line.
    """
    if times is None:
        steps = list(enumerate(float(time) for time in read_times(folder.fields_file)))
    else:
        steps = _steps(folder, times)
    numbers = [number for number, _ in steps]
    complaint = _draw_in_child(folder, numbers, len(numbers), json.dumps(asdict(shot)), into)
    drawn = [(time, into / _shot_name(number)) for number, time in steps]
    drawn = [(time, picture) for time, picture in drawn if picture.is_file()]
    if complaint or not drawn:
        raise SceneError(complaint or f"'{folder.path}' holds no fields to draw")
    return drawn


def render_shots_into(
    folder: RunFolder, shot: Shot, times: Sequence[float] | None = None
) -> list[Path]:
    """Draw a shot at some times into the run folder, `shot_<ms>ms_<what>.png`, as `render_run`."""
    if times is None:
        stored = read_times(folder.fields_file)
        times = [*load_scene(folder.scene_file).output.image_times, *map(float, stored[-1:])]
    written = []
    with tempfile.TemporaryDirectory() as scratch:
        for time, picture in render_shot(folder, shot, Path(scratch), times):
            written.append(folder.path / f"shot_{_milliseconds(time)}ms_{shot.name}.png")
            shutil.copyfile(picture, written[-1])
    return written


def _milliseconds(time_s: float) -> str:
    return f"{time_s * 1e3:.4f}".rstrip("0").rstrip(".")


def _shot_name(step: int) -> str:
    return f"shot_{step:05d}.png"


def _steps(folder: RunFolder, times: Sequence[float] | None) -> list[tuple[int, float]]:
    """Stored steps (number, time) nearest to the wanted times, in order, each once."""
    stored = read_times(folder.fields_file)
    if not stored.size:
        return []
    if times is None:
        times = [*load_scene(folder.scene_file).output.image_times, float(stored[-1])]
    _tell_other_times(stored, times)
    nearest = sorted({int(np.abs(stored - time).argmin()) for time in times})
    return [(step, float(stored[step])) for step in nearest]


def _tell_other_times(stored: NDArray[np.float64], times: Sequence[float]) -> None:
    """One line on stderr for each wanted time that is not among the stored ones."""
    for time in times:
        near = float(stored[np.abs(stored - time).argmin()])
        if abs(near - time) > _SAME_TIME_S:
            wanted, found = _milliseconds(time), _milliseconds(near)
            print(
                f"no fields are stored at {wanted} ms: drawn at the nearest time, {found} ms"
                " (output.field_interval and output.image_times say when they are stored)",
                file=sys.stderr,
            )


def _pictures(folder: RunFolder, step: tuple[int, float]) -> list[Path]:
    return [folder.path / f"crack_{_milliseconds(step[1])}ms_{view}.png" for view in _VIEWS]


def _draw_in_child(
    folder: RunFolder, steps: Sequence[int], count: int, shot: str = "", into: Path | None = None
) -> str:
    """Draw in a child process; what went wrong in one line, or nothing."""
    command = [
        sys.executable,
        "-m",
        "taichi_ldem.output.render.snapshots",
        str(folder.path.resolve()),
        shot,
        str((into or folder.path).resolve()),
        *map(str, steps),
    ]
    timeout = TIMEOUT_S + TIMEOUT_PER_PICTURE_S * count
    # The child starts elsewhere: a package found through the working directory must stay found.
    package = str(Path(__file__).resolve().parents[3])
    path = os.pathsep.join(filter(None, (package, os.environ.get("PYTHONPATH"))))
    with tempfile.TemporaryDirectory() as scratch:
        try:
            child = subprocess.run(
                command,
                cwd=scratch,
                env={**os.environ, "PYTHONPATH": path},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                timeout=timeout,
            )
        except subprocess.TimeoutExpired:
            return f"pictures are missing: drawing took more than {timeout:.0f} s"
        except OSError as error:
            return f"no pictures: cannot start a process to draw them: {error.strerror}"
    if child.returncode == _EXIT_NO_DEVICE:
        return NO_DEVICE
    if child.returncode:
        last = (child.stderr.strip().splitlines() or ["nothing was said"])[-1]
        return f"pictures are missing: drawing ended with code {child.returncode}: {last}"
    return ""


# --- geometry -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Surface:
    """Exterior quadrilaterals of the modules that are drawn.

    corners (F, 4, 3), deformed [m], counter-clockwise from outside; normals (F, 3); value (F,), of
    the face's module, what it is coloured by; opened (F,), whether a crack laid the face bare.
    """

    corners: FloatArray
    normals: FloatArray
    value: FloatArray
    opened: NDArray[np.bool_]


def _holding(fields: Fields) -> NDArray[np.bool_]:
    """Modules (C,) that are neither cut in two nor torn."""
    corners = (fields.points + fields.displacement)[fields.hexahedra]
    spread = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    first = fields.points[fields.hexahedra[0]]
    half_diagonal = np.linalg.norm(first[6] - first[0]) / 2
    # NaN, too, is not drawn.
    return (fields.broken_fraction < GONE) & (spread < _TORN * half_diagonal)


def notched(fields: Fields, notches: Sequence[Notch]) -> NDArray[np.bool_]:
    """Modules (C,) that a notch cuts: left out, as a saw would, they show where it is."""
    low = fields.points[fields.hexahedra[:, 0]]
    edge = float(np.linalg.norm(fields.points[fields.hexahedra[0, 1]] - low[0]))
    found = np.zeros(len(low), dtype=bool)
    for notch in notches:
        normal, *axes = notch.axes
        # a plane through nodes lies just beyond them (Lattice.bars_crossing)
        off = (notch.position - low[:, normal]) / edge
        cut = (off > -1e-6) & (off < 1 - 1e-6)
        for axis, (start, stop) in zip(axes, notch.bounds, strict=True):
            middle = low[:, axis] + edge / 2
            cut &= (middle > start) & (middle < stop)
        found |= cut
    return found


def exterior(fields: Fields, part: NDArray[np.bool_], values: FloatArray | None = None) -> Surface:
    """Bare faces of the modules of a part (C,) of the plate, cut and torn ones left out.

    values: (C,), to colour by; None: the share of failed bars.
    """
    base = fields.points[fields.hexahedra[:, 0]]
    # perturbed nodes cancel within every row of modules, whose ends they leave where they are
    edge = (fields.points[fields.hexahedra[:, 1]] - base)[:, 0].mean()
    # One empty layer all around: no module at the rim needs a case of its own.
    site = np.rint((base - base.min(axis=0)) / edge).astype(np.int64) + 1
    drawn = part & _holding(fields)
    taken, filled = np.zeros((2, *(site.max(axis=0) + 2)), dtype=bool)
    taken[tuple(site[part].T)] = True
    filled[tuple(site[drawn].T)] = True

    position = fields.points + fields.displacement
    quads, modules, opened = [], [], []
    for direction, local in _FACES:
        beside = tuple((site + direction).T)
        bare = np.flatnonzero(drawn & ~filled[beside])
        quads.append(position[fields.hexahedra[bare][:, local]])
        modules.append(bare)
        opened.append(taken[beside][bare])
    corners, module = np.concatenate(quads), np.concatenate(modules)
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    shown = fields.broken_fraction if values is None else values
    return Surface(corners, normals, shown[module], np.concatenate(opened))


# --- colours --------------------------------------------------------------------------------------


def speed(fields: Fields) -> FloatArray:
    """(C,) mean speed of a module's corners, m/s."""
    moving: FloatArray = np.linalg.norm(fields.velocity, axis=1)[fields.hexahedra].mean(axis=1)
    return moving


def strain_energy(fields: Fields, stiffness: tuple[float, float, float]) -> FloatArray:
    """(C,) strain energy density of a module, about, J/m3; NaN where bars have failed.

    From the mean gradient between its corners (nodes at the centres are not stored) as Green's
    strain, with the lattice's C11, C12, C44: as if no bar had softened.
    """
    place = fields.points[fields.hexahedra]
    moved = fields.displacement[fields.hexahedra].astype(np.float64)
    edge = np.linalg.norm(place[0, 1] - place[0, 0])
    sides = np.sign(place[0] - place[0].mean(axis=0))  # (8, 3): on which side a corner lies
    # a face's mean displacement less that of the face across: 4 corners each
    gradient = np.einsum("cni,nj->cij", moved, sides) / (4 * edge)
    stretch = gradient + np.eye(3)
    strain = (np.einsum("cki,ckj->cij", stretch, stretch) - np.eye(3)) / 2
    c11, c12, c44 = stiffness
    xx, yy, zz = (strain[:, n, n] for n in range(3))
    shear = strain[:, 0, 1] ** 2 + strain[:, 0, 2] ** 2 + strain[:, 1, 2] ** 2
    density = c11 / 2 * (xx**2 + yy**2 + zz**2) + c12 * (xx * yy + xx * zz + yy * zz)
    whole = fields.broken_fraction == 0
    return np.where(whole, density + 2 * c44 * shear, np.nan)


@dataclass(frozen=True)
class _Scale:
    """What modules are coloured by, over all pictures of a shot alike."""

    value: Callable[[Fields], FloatArray]
    colours: Colormap
    norm: Normalize
    label: str

    def rgb(self, values: FloatArray) -> FloatArray:
        """(F, 3) colours."""
        shown: FloatArray = self.colours(self.norm(np.ma.masked_invalid(values)))[:, :3]
        return shown


def _damage_scale() -> _Scale:
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    note = (
        "broken bars of a module [%]; white or missing: modules with "
        f"{100 * GONE:.0f} % or more of their bars broken, still in the model"
    )
    colours = LinearSegmentedColormap.from_list("broken", _COLOURS)
    return _Scale(lambda f: 100.0 * f.broken_fraction, colours, Normalize(0, 100 * GONE), note)


def _scale(folder: RunFolder, steps: Sequence[int], colour: Colour) -> _Scale:
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm, Normalize

    if colour == "damage":
        return _damage_scale()
    value = speed if colour == "velocity" else _energy_of(load_scene(folder.scene_file))
    top = 0.0
    for step in steps:
        fields = read_fields(folder.fields_file, step)
        shown = value(fields)[_holding(fields)]
        shown = shown[np.isfinite(shown)]
        if shown.size:  # loose fragments may be fast: they do not set the scale
            top = max(top, float(np.quantile(shown, 0.95 if colour == "velocity" else 0.999)))
    top = top or 1.0
    missing = f"missing: {100 * GONE:.0f} % or more of its bars broken"
    if colour == "velocity":
        norm = Normalize(0.0, top, clip=True)
        return _Scale(value, colormaps["viridis"], norm, f"speed of a module [m/s]; {missing}")
    label = f"strain energy of a module [kJ/m$^3$]; grey: bars have failed; {missing}"
    colours = colormaps["magma"].with_extremes(bad="0.6")
    return _Scale(lambda f: 1e-3 * value(f), colours, LogNorm(1e-6 * top, 1e-3 * top, True), label)


def _energy_of(scene: Scene) -> Callable[[Fields], FloatArray]:
    from taichi_ldem.model.material import elastic_constants

    m = scene.material
    stiffness = elastic_constants(m.youngs_modulus, m.poisson_ratio, scene.plate.stiffness)
    return lambda fields: strain_energy(fields, stiffness)


# --- views ----------------------------------------------------------------------------------------


_WIDTH = 0.96  # of every panel, as a share of the figure's
_BOTTOM, _HEIGHT = 0.10, 0.82
_MARGIN = 1.1


@dataclass(frozen=True)
class _Panel:
    """One parallel projection: where it sits in the figure and what it shows."""

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
        return self.height * _SIZE_PX[1] / (_WIDTH * _SIZE_PX[0])


@dataclass(frozen=True)
class _View:
    title: str
    panels: tuple[_Panel, ...]
    section: tuple[int, float] | None = None  # axis and position [m] of a plane that cuts

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


def _single(size: FloatArray, rotation: FloatArray) -> tuple[_Panel]:
    """One panel that holds a plate of `size` (3,) [m]."""
    panel = _Panel(_BOTTOM, _HEIGHT, rotation, 0.0, 0.01)
    width, height = np.abs(rotation[:2]) @ size
    return (replace(panel, span=_MARGIN * max(width, height / panel.aspect)),)


def _rotation(azimuth: float, elevation: float) -> FloatArray:
    """For an eye at the given angles [degrees] from the -y axis and above the plate."""
    sin_a, sin_e = np.sin(np.deg2rad((azimuth, elevation)))
    cos_a, cos_e = np.cos(np.deg2rad((azimuth, elevation)))
    right = (cos_a, sin_a, 0.0)
    up = (-sin_a * sin_e, cos_a * sin_e, cos_e)
    return np.array((right, up, np.cross(right, up)))


def _below(size: FloatArray) -> _View:
    # Looking up with y upwards puts x to the left, as on the photographs of the tension face.
    return _View("from below (tension face)", _single(size, _rotation(180.0, -90.0)))


def _above(size: FloatArray) -> _View:
    return _View("from above (struck face)", _single(size, _rotation(25.0, 40.0)))


def _cut(size: FloatArray) -> _View:
    side = _rotation(0.0, 0.0)
    whole = _MARGIN * size[0]
    enlarged = 10 * size[2]
    if enlarged >= whole:  # a beam rather than a plate
        return _View("cut through y = 0, near half removed", _single(size, side), (1, 0.0))
    upper = _Panel(0.68, 0.23, side, whole, 0.01, "whole width", triad=False)
    lower = _Panel(_BOTTOM, 0.55, side, enlarged, 0.001, "middle, enlarged")
    return _View("cut through y = 0, near half removed", (upper, lower), (1, 0.0))


_VIEWS: dict[str, Callable[[FloatArray], _View]] = {"below": _below, "above": _above, "cut": _cut}
# Where the eye of each is: azimuth, elevation, degrees.
_EYES = {"below": (180.0, -90.0), "above": (25.0, 40.0), "cut": (0.0, 0.0)}


def _view_of(shot: Shot, size: FloatArray) -> _View:
    view = _VIEWS[shot.view](size)
    if shot.azimuth is not None or shot.elevation is not None:
        azimuth, elevation = _EYES[shot.view]
        azimuth = azimuth if shot.azimuth is None else shot.azimuth
        elevation = elevation if shot.elevation is None else shot.elevation
        title = f"azimuth {azimuth:g}°, elevation {elevation:g}°"
        view = _View(title, _single(size, _rotation(azimuth, elevation)), view.section)
    if shot.section is not None:
        axis, position = shot.section
        title = f"{view.title.partition(',')[0] if view.section is None else ''}"
        title = f"{title}  cut at {axis} = {1e3 * position:g} mm".strip()
        view = replace(view, title=title, section=("xyz".index(axis), position))
    return view


# --- the child's side -----------------------------------------------------------------------------


def _clear_texture_coordinates() -> None:
    """Have GGUI start from zeroed vertices.

    Taichi 1.7 leaves the texture coordinates of a mesh as it finds them in memory; where they are
    NaN, the whole mesh is missing from the picture.
    """
    scene = import_module("taichi.ui.scene")
    uncleared = scene.get_vbo_field_v2

    def cleared(vertices: Any) -> Any:
        buffer = uncleared(vertices)
        buffer.fill(0.0)
        return buffer

    scene.get_vbo_field_v2 = cleared  # type: ignore[attr-defined]


class _Painter:
    """An invisible GGUI window that turns triangles into images."""

    def __init__(self) -> None:
        import taichi as ti

        ti.init(arch=ti.cpu, log_level=ti.ERROR)
        _clear_texture_coordinates()
        self._ti = ti
        self._size = round(_HEIGHT * _SIZE_PX[1]), round(_WIDTH * _SIZE_PX[0])
        height, width = (_SUPERSAMPLING * side for side in self._size)
        self._window = ti.ui.Window("plate", (width, height), show_window=False)
        self._fields: tuple[Any, Any] | None = None

    def paint(self, triangles: FloatArray, colours: FloatArray, aspect: float) -> FloatArray:
        """An image (rows, columns, 3) from triangles in the panel's coordinates.

        triangles: (T, 3, 3), x in -1..1 across the panel, y to the same scale, z in -1..1 towards
        the eye; colours: (T, 3) RGB.  aspect: height over width of the image, at most the
        window's.
        """
        places, shades = self._buffers(3 * len(triangles))
        for field, rows in (
            (places, triangles.reshape(-1, 3)),
            (shades, colours.repeat(3, axis=0)),
        ):
            # what is left over makes empty triangles
            padded = np.zeros((field.shape[0], 3), dtype=np.float32)
            padded[: len(rows)] = rows
            field.from_numpy(padded)
        scene, canvas = self._window.get_scene(), self._window.get_canvas()
        scene.set_camera(self._camera())
        # Light and shade are in the colours already; without any light GGUI reads a null buffer.
        scene.ambient_light((1.0, 1.0, 1.0))
        scene.point_light((0.0, 0.0, 3.0), (0.0, 0.0, 0.0))
        canvas.set_background_color((1.0, 1.0, 1.0))
        scene.mesh(places, normals=places, per_vertex_color=shades)
        canvas.scene(scene)
        image = self._window.get_image_buffer_as_numpy()[..., :3].transpose(1, 0, 2)
        n, height, width = _SUPERSAMPLING, *self._size
        image = image.reshape(height, n, width, n, 3).mean(axis=(1, 3))
        spare = (height - round(aspect * width)) // 2
        return image[spare : height - spare]

    def _camera(self) -> Any:
        camera = self._ti.ui.Camera()
        reach = self._size[0] / self._size[1]
        camera.position(0.0, 0.0, 3.0)
        camera.lookat(0.0, 0.0, 0.0)
        camera.up(0.0, 1.0, 0.0)
        camera.projection_mode(self._ti.ui.ProjectionMode.Orthogonal)
        for set_edge, value in (
            (camera.left, -1.0),
            (camera.right, 1.0),
            (camera.bottom, -reach),
            (camera.top, reach),
            (camera.z_near, 1.0),
            (camera.z_far, 5.0),
        ):
            set_edge(value)
        return camera

    def _buffers(self, vertices: int) -> tuple[Any, Any]:
        """Fields of places and colours with room for `vertices`.

        Taichi never frees a field, so the same ones serve all pictures while they are large enough.
        """
        if not self._fields or vertices > self._fields[0].shape[0]:
            room, make = max(3, 4 * vertices // 3), self._ti.Vector.field
            self._fields = (make(3, self._ti.f32, room), make(3, self._ti.f32, room))
        return self._fields


_Told = tuple[RunFolder, Scene, Mapping[str, FloatArray]]
"""A run as it is read once: its folder, scene and history."""


def _told(folder: RunFolder) -> _Told:
    history = folder.read_history() if folder.history_file.is_file() else {}
    return folder, load_scene(folder.scene_file), history


def _fields_at(folder: RunFolder, step: int) -> Fields:
    """Fields of a step, the modules that a notch cuts counted as broken."""
    fields = read_fields(folder.fields_file, step)
    fields.broken_fraction[notched(fields, load_scene(folder.scene_file).notch)] = 1.0
    return fields


def _draw_step(painter: _Painter, run: _Told, step: int) -> None:
    """The three standing views of a step."""
    folder, scene, _ = run
    fields = _fields_at(folder, step)
    size = np.ptp(fields.points, axis=0)
    struck = scene.striker is not None
    scale = _damage_scale()
    for name, picture in zip(_VIEWS, _pictures(folder, (step, fields.time)), strict=True):
        view = _VIEWS[name](size)
        if not struck:
            view = replace(view, title=view.title.partition(" (")[0])  # which face it is
        _draw(painter, fields, view, scale, picture, run)


def _draw_shots(
    painter: _Painter, run: _Told, steps: Sequence[int], shot: Shot, into: Path
) -> None:
    folder = run[0]
    scale = _scale(folder, steps, shot.colour)
    for step in steps:
        fields = _fields_at(folder, step)
        view = _view_of(shot, np.ptp(fields.points, axis=0))
        _draw(painter, fields, view, scale, into / _shot_name(step), run)


def _draw(
    painter: _Painter,
    fields: Fields,
    view: _View,
    scale: _Scale,
    picture: Path,
    run: _Told,
) -> None:
    surface = exterior(fields, view.part(fields), scale.value(fields))
    # seen along the normal, what lies behind a cut would pass for the cut face
    cut = view.section is not None and abs(view.panels[0].rotation[2, view.section[0]]) > 0.99
    folder, scene, history = run
    bodies = bodies_at(scene, history, fields.time)
    images, lines = [], []
    for panel in view.panels:
        images.append(_panel_image(painter, surface, fields, panel, scale, cut, bodies))
        seen = panel.rotation, _centre(fields, panel)
        lines.append((bodies.outline(*seen), bodies.clamp_lines(*seen)))
    caption = f"t = {1e3 * fields.time:.2f} ms    {view.title}    deformation to scale"
    figure = _compose(view, images, lines, scale)
    figure.text(0.5, 0.972, caption, ha="center", va="center", fontsize=20)
    behind = "behind the cut pale blue: faces, brown: walls of cracks" if cut else ""
    beside = ";  ".join(filter(None, (bodies.caption(), behind)))
    figure.text(0.5, 0.936, beside, ha="center", va="center", fontsize=15)
    figure.savefig(picture, metadata=folder.picture_metadata())


def _panel_image(
    painter: _Painter,
    surface: Surface,
    fields: Fields,
    panel: _Panel,
    scale: _Scale,
    cut: bool,
    bodies: Bodies,
) -> FloatArray:
    towards_eye = surface.normals @ panel.rotation.T
    seen = towards_eye[:, 2] > 0
    corners = (surface.corners[seen] - _centre(fields, panel)) @ panel.rotation.T
    colours = scale.rgb(surface.value[seen])
    light = np.array((-0.35, 0.45, 0.82))
    if -0.99 < panel.rotation[2, 2] < 0:  # from below the faces that matter look down
        light[1] *= -1
    colours = colours * _brightness(towards_eye[seen], surface.opened[seen], light)[:, None]
    if cut:
        half = np.ptp(fields.points[:, 2]) / 4
        colours = _fade(colours, corners[..., 2].mean(axis=1), half, surface.opened[seen])
    image = _paint(painter, corners, colours, panel)
    turned = bodies.normals @ panel.rotation.T
    front = turned[:, 2] > 0
    if not front.any():
        return image
    striker = (bodies.faces[front] - _centre(fields, panel)) @ panel.rotation.T
    shade = _STRIKER * _brightness(turned[front], np.zeros(front.sum(), dtype=bool), light)[:, None]
    both = np.concatenate([corners, striker]), np.concatenate([colours, shade])
    return (1 - _OPACITY) * image + _OPACITY * _paint(painter, *both, panel)


def _paint(
    painter: _Painter, corners: FloatArray, colours: FloatArray, panel: _Panel
) -> FloatArray:
    """An image of quadrilaterals (F, 4, 3) [m] in the eye's frame; colours (F, 3)."""
    scale = np.array((panel.span / 2, panel.span / 2, np.abs(corners[..., 2]).max(initial=1e-9)))
    triangles = (corners / scale)[:, ((0, 1, 2), (0, 2, 3))].reshape(-1, 3, 3)
    return painter.paint(triangles, colours.repeat(2, axis=0), panel.aspect)


def _centre(fields: Fields, panel: _Panel) -> FloatArray:
    """What stands in the middle of the panel [m]: the plate's middle, sunk with its deflection."""
    middle: FloatArray = (fields.points.min(axis=0) + fields.points.max(axis=0)) / 2
    shown = np.abs(fields.points[:, 0] - middle[0]) < panel.span / 2
    height = (fields.points[:, 2] + fields.displacement[:, 2])[shown]
    middle[2] = np.nanquantile(height, (0.1, 0.9)).mean()  # loose fragments may be anywhere
    return middle


def _brightness(normals: FloatArray, opened: NDArray[np.bool_], light: FloatArray) -> FloatArray:
    """(F,) of faces; normals (F, 3) in the eye's frame.  A crack's walls lie in shadow."""
    brightness = 0.68 + 0.32 * np.maximum(0.0, normals @ light) / np.linalg.norm(light)
    brightness[opened] *= 0.85  # more, and grey and yellow leave the colour scale
    return np.asarray(brightness)


def _fade(
    colours: FloatArray, depth: FloatArray, half: float, opened: NDArray[np.bool_]
) -> FloatArray:
    """Tint what lies behind the cut, by half at depth -`half`, lest it pass for the cut face."""
    share = np.exp2(np.minimum(0.0, depth) / half)[:, None]
    return colours * share + np.where(opened[:, None], _WALL, _BEHIND) * (1.0 - share)


def _compose(
    view: _View,
    images: Sequence[FloatArray],
    lines: Sequence[tuple[FloatArray, list[FloatArray]]],
    scale: _Scale,
) -> Figure:
    """Put the panels, outlines, scale bars, axes and the colours' meaning on one picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_SIZE_PX[0] / 100, _SIZE_PX[1] / 100), dpi=100)
    FigureCanvasAgg(figure)
    for panel, image, (striker, clamp) in zip(view.panels, images, lines, strict=True):
        place = ((1 - _WIDTH) / 2, panel.bottom, _WIDTH, panel.height)
        axes = figure.add_axes(place, frameon=False, xticks=(), yticks=())
        half = panel.span / 2
        axes.imshow(image, extent=(-half, half, -half * panel.aspect, half * panel.aspect))
        hidden = panel.rotation[2, 2] < -0.1  # behind the plate
        axes.plot(*striker.T, ":" if hidden else "-", color=tuple(_STRIKER), linewidth=1.5)
        for line in clamp:
            axes.plot(*line.T, "--", color="0.35", linewidth=1.5, dashes=(5, 4))
        _annotate(axes, panel)
    _colour_key(figure, scale)
    return figure


def _annotate(axes: Axes, panel: _Panel) -> None:
    """Scale bar at the lower right, directions of x, y, z at the lower left, the panel's label."""
    _draw_scale_bar(axes, panel)
    if panel.triad:
        _draw_triad(axes, panel)


def _draw_scale_bar(axes: Axes, panel: _Panel) -> None:
    half = panel.span / 2
    low, unit = -half * panel.aspect, panel.span / 100
    end = half - unit
    axes.plot((end - panel.scale_bar, end), (low + unit, low + unit), color="black", linewidth=4)
    text = f"{1e3 * panel.scale_bar:g} mm"
    axes.text(end - panel.scale_bar / 2, low + 1.6 * unit, text, ha="center", fontsize=16)
    axes.text(-half, -low, panel.label, ha="left", va="top", fontsize=16)
    axes.set_xlim(-half, half)
    axes.set_ylim(low, -low)


def _draw_triad(axes: Axes, panel: _Panel) -> None:
    unit = panel.span / 100
    half, low = panel.span / 2, -panel.span / 2 * panel.aspect
    arrow = {"arrowstyle": "-|>", "color": "black", "shrinkA": 0, "shrinkB": 0}
    x, y = -half + 6.5 * unit, low + 2.5 * unit
    for name, (right, up) in zip("xyz", panel.rotation[:2].T, strict=True):
        if np.hypot(right, up) > 0.1:
            tip = (x + 4 * unit * right, y + 4 * unit * up)
            axes.annotate("", xy=tip, xytext=(x, y), arrowprops=arrow)
            mark = (x + 5.2 * unit * right, y + 5.2 * unit * up)
            axes.text(*mark, name, ha="center", va="center", fontsize=16)


def _colour_key(figure: Figure, scale: _Scale) -> None:
    from matplotlib.cm import ScalarMappable

    axes = figure.add_axes((0.30, 0.055, 0.40, 0.018))
    colours = ScalarMappable(scale.norm, scale.colours)
    bar = figure.colorbar(colours, cax=axes, orientation="horizontal", format="{x:g}")
    bar.ax.tick_params(labelsize=14)
    bar.set_label(scale.label, fontsize=14)


def main(arguments: Sequence[str]) -> int:
    """The child's side: `python -m taichi_ldem.output.render.snapshots FOLDER SHOT INTO STEP ...`.

    SHOT: a `Shot` as JSON, or nothing for the standing views.
    """
    if not vulkan_device():
        return _EXIT_NO_DEVICE
    path, shot, into, *steps = arguments
    run = _told(RunFolder.open(Path(path)))
    painter = _Painter()
    if shot:
        _draw_shots(painter, run, [int(s) for s in steps], Shot(**json.loads(shot)), Path(into))
        return 0
    for step in steps:
        _draw_step(painter, run, int(step))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
