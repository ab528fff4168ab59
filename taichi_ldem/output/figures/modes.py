"""The figure of mode shapes, as the paper's Fig. 10: one panel for each mode's mid-plane."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.output.figures.draw import write_figure

if TYPE_CHECKING:
    from taichi_ldem.scenarios.modes import Mode

COLUMNS = 6


def plot_modes(
    file: Path,
    modes: "Sequence[Mode]",
    planes: Sequence[tuple[Any, Any, Any]],
    circles: Sequence[float],
) -> None:
    """Draw the largest component of each mode's motion; nodal lines are black.

    Args:
        planes: grid lines x, y (m) and motion (ny, nx, 3) of the mid-plane, for each mode.
        circles: radii of the clamp's circles, m.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    columns = min(COLUMNS, len(modes))
    rows = math.ceil(len(modes) / columns)
    x, y, _ = planes[0]
    tall = max(0.35, min(1.0, np.ptp(y) / np.ptp(x)))
    drawing = plt.figure(
        figsize=(2.1 * columns + 1.2, (2.1 * tall + 0.45) * rows + 0.7), layout="constrained"
    )
    axes = drawing.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for panel in axes.flat[len(modes) :]:
        panel.set_axis_off()
    for mode, plane, panel in zip(modes, planes, axes.flat, strict=False):
        image = _panel(panel, mode, plane, circles)
    for panel in axes[:, 0]:
        panel.set_ylabel("y [mm]", fontsize=8)
    for panel in axes[-1]:
        panel.set_xlabel("x [mm]", fontsize=8)
    bar = drawing.colorbar(image, ax=axes, shrink=0.6, aspect=30, ticks=[-1, 0, 1])
    bar.set_label("motion of the mid-plane over its largest", fontsize=8)
    drawing.suptitle(
        "Modes: number, (nodal diameters, nodal circles), frequency in kHz\n"
        "black: nodal lines; grey: the clamp's circles",
        fontsize=11,
    )
    write_figure(file, drawing, dpi=110)
    plt.close(drawing)


def _panel(panel: Any, mode: "Mode", plane: tuple[Any, Any, Any], circles: Sequence[float]) -> Any:
    from scipy.ndimage import maximum_filter

    x, y, motion = (1e3 * plane[0], 1e3 * plane[1], plane[2])
    component = int(np.argmax(np.sum(motion**2, axis=(0, 1))))
    value = motion[..., component] / np.abs(motion).max()
    image = panel.pcolormesh(x, y, value, cmap="RdBu_r", vmin=-1, vmax=1, shading="nearest")
    if np.ptp(value) > 0.1 and min(value.shape) > 1:
        # under the clamp there is no motion, and rounding there has no nodal lines
        near = maximum_filter(np.abs(value), size=5)
        panel.contour(
            x, y, np.where(near < 0.02, np.nan, value), levels=[0.0], colors="k", linewidths=0.6
        )
    angle = np.linspace(0, 2 * np.pi, 181)
    for radius in circles:
        panel.plot(1e3 * radius * np.cos(angle), 1e3 * radius * np.sin(angle), color="0.35", lw=0.5)
    along = "" if component == 2 else f", u_{'xy'[component]}"
    panel.set_title(f"{mode.number}  {mode.name}{along}  {1e-3 * mode.frequency:.2f}", fontsize=8)
    panel.set_aspect("equal")
    panel.tick_params(labelsize=6)
    return image
