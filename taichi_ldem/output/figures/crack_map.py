"""The map of broken bars, with the outlines of specimen, clamp, supports and striker."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.model.flaws import rim, turned
from taichi_ldem.model.lattice import dumbbell_half_width
from taichi_ldem.model.outlines import hole_outline
from taichi_ldem.output.loaded import LoadedRun, Series
from taichi_ldem.scene import Plate, Scene
from taichi_ldem.storage.fields import read_broken_bars, read_fields, read_times

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

_MS, _MM = 1e3, 1e3


def draw_crack_map(figure: Figure, run: LoadedRun) -> None:
    """The share of broken bars over the plate, seen from below; of a beam, from the side."""
    from matplotlib.colors import PowerNorm

    plate = run.scene.plate
    across, deep = (2, 1) if run.is_beam else (1, 2)  # axes: upwards and into the picture
    half_x, half_y = (_MM * plate.actual_size[axis] / 2 for axis in (0, across))
    middle = half_y if run.is_beam else 0.0
    if not run.is_beam:
        figure.set_figheight(min(7.8, 7.0 * half_y / half_x + 4.0))
    bars = read_broken_bars(run.folder.fields_file)
    place = _MM * bars.position_m[:, [0, across]] - (0.0, middle)
    modules = plate.modules[0], plate.modules[across]
    share = _broken_share(place, modules, (half_x, half_y)) / plate.modules[deep]
    if not plate.is_prism or (run.scene.hole and not run.is_beam):
        share[~_columns(run, modules, (half_x, half_y))] = np.nan

    axes = figure.add_subplot(xlabel="x [mm]", ylabel=f"{'xyz'[across]} [mm]", aspect="equal")
    axes.grid(False)
    image = axes.imshow(
        share.T,
        extent=(-half_x, half_x, middle - half_y, middle + half_y),
        origin="lower",
        cmap="Greys",
        norm=PowerNorm(0.5, 0.0, 0.5),  # a single broken bar must show, too
        interpolation="nearest",
    )
    bar = figure.colorbar(
        image,
        ax=axes,
        extend="max",
        shrink=0.8,
        orientation="horizontal" if run.is_beam else "vertical",
    )
    bar.set_label("share of bars broken, mean through the thickness")
    if run.is_beam:
        figure.set_size_inches(9.0, 5.6)
        _draw_supports(axes, run.scene)
    else:
        draw_outlines(axes, run.scene)
        # Looking up with y upwards, x points to the left.
        axes.set_xlim(1.03 * half_x, -1.03 * half_x)
        axes.set_ylim(-1.03 * half_y, 1.03 * half_y)
    times = read_times(run.folder.fields_file)
    end = max(run.history["time_s"].max(initial=0.0), times.max(initial=0.0))
    side = "the side" if run.is_beam else "below"
    axes.set_title(
        f"Broken bars seen from {side}: {len(bars.bar):,} at t = {_MS * end:.2f} ms", fontsize=14
    )


def _columns(
    run: LoadedRun, modules: tuple[int, int], half: tuple[float, float]
) -> NDArray[np.bool_]:
    """Mask (nx, ny) of the columns that hold modules."""
    fields = read_fields(run.folder.fields_file, 0)
    x, y = _MM * fields.points[fields.hexahedra].mean(axis=1)[:, :2].T
    limits = ((-half[0], half[0]), (-half[1], half[1]))
    return np.asarray(np.histogram2d(x, y, bins=modules, range=limits)[0] > 0)


def _broken_share(
    position: Series, modules: tuple[int, int], half: tuple[float, float]
) -> NDArray[np.float64]:
    """Broken bars over the bars of a module, summed through the thickness; (nx, ny).

    A bar on the border of two columns counts half in each, which keeps the map symmetric.

    Args:
        position: (n, 2) of the bars, mm. half: of the plate's sides, mm.
    """
    nudge = 1e-6 * min(half)
    counts = np.zeros(modules)
    for shift in ((-nudge, -nudge), (-nudge, nudge), (nudge, -nudge), (nudge, nudge)):
        # bars on the rim stay on the plate
        x, y = np.clip(position + shift, np.negative(half), half).T
        limits = ((-half[0], half[0]), (-half[1], half[1]))
        counts += np.histogram2d(x, y, bins=modules, range=limits)[0] / 4
    return counts / 14


def draw_outlines(axes: Axes, scene: Scene, *, legend: bool = True) -> None:
    """Draw the specimen's edge, its holes and notches, and the clamp's inner circle, mm."""
    from matplotlib.patches import Circle, Polygon, Rectangle

    plate, clamp = scene.plate, scene.clamp
    if plate.diameter is not None:
        outline: Patch = Circle((0.0, 0.0), _MM * plate.diameter / 2)
    elif not plate.is_prism:
        outline = Polygon(_MM * _outline(plate))
    else:
        x, y = (_MM * side for side in plate.actual_size[:2])
        outline = Rectangle((-x / 2, -y / 2), x, y)
    outline.set(fill=False, edgecolor="black", linewidth=1.5)
    axes.add_patch(outline)
    for hole in scene.hole:
        corners = _MM * hole_outline(plate, hole)
        # white over the columns of bars at the hole's edge, which a map smears into it
        axes.add_patch(Polygon(corners, facecolor="white", edgecolor="black", linewidth=1.5))
    _draw_notches(axes, scene, outline)
    if clamp is not None and clamp.kind != "free" and clamp.inner_diameter is not None:
        angle = np.linspace(0.0, 2.0 * np.pi, 361)
        radius = _MM * clamp.inner_diameter / 2
        label = f"clamp, inner diameter {2 * radius:g} mm"
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), ":", color="0.3", label=label)
    if legend and axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), fontsize=12)


def _draw_notches(axes: Axes, scene: Scene, outline: Patch, upwards: int = 1) -> None:
    """Draw the notches as they are seen along y or z, inside an outline.

    Args:
        upwards: axis of the picture: 1 for y, 2 for z.
    """
    for number, notch in enumerate(scene.notch):
        places = turned(rim(notch), -math.radians(scene.plate.angle))[:, [0, upwards]]
        closed = _MM * np.concatenate([places, places[:1]])
        label = "" if number else ("notch" if len(scene.notch) == 1 else "notches")
        (line,) = axes.plot(*closed.T, color="C1", linewidth=2.5, label=label or None)
        line.set_clip_path(outline)


def _outline(plate: Plate) -> Series:
    """Corners (n, 2) of a tension specimen's ideal outline, without the steps of its modules, m."""
    x = np.linspace(-plate.size[0] / 2, plate.size[0] / 2, 401)
    y = np.full_like(x, plate.size[1] / 2)
    if plate.narrow_width and plate.narrow_length and plate.fillet_radius:
        narrow = (plate.narrow_width, plate.narrow_length, plate.fillet_radius)
        y = dumbbell_half_width(x, plate.size[1], *narrow)
    corners = np.stack([np.concatenate([x, x[::-1]]), np.concatenate([y, -y[::-1]])], axis=1)
    angle = math.radians(plate.angle)
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.asarray(corners @ [[cosine, sine], [-sine, cosine]])


def _draw_supports(axes: Axes, scene: Scene) -> None:
    """A beam's edge and notch, and the rigid bodies at the start, from the side."""
    from matplotlib.patches import Circle, Rectangle

    supports = scene.supports
    assert supports is not None
    length, _, height = (_MM * side for side in scene.plate.actual_size)
    edge: dict[str, Any] = {"fill": False, "edgecolor": "black", "linewidth": 1.5}
    outline = axes.add_patch(Rectangle((-length / 2, 0.0), length, height, **edge))
    body: dict[str, Any] = {"facecolor": "C0", "alpha": 0.3, "linewidth": 0}
    radius = _MM * supports.diameter / 2
    for side in (-1, 1):
        axes.add_patch(Circle((side * _MM * supports.across / 2, -radius), radius, **body))
    top = height
    for striker in scene.strikers:
        radius = _MM * striker.diameter / 2
        place = _MM * striker.position[0], height + _MM * striker.gap + radius
        axes.add_patch(Circle(place, radius, **body))
        top = max(top, place[1] + radius)
    _draw_notches(axes, scene, outline, 2)
    if scene.notch:
        axes.legend(loc="upper right", fontsize=12)
    axes.set_xlim(-0.52 * length, 0.52 * length)
    axes.set_ylim(-1.05 * _MM * supports.diameter, top + 0.1 * height)
