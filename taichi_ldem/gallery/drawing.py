"""What the figures of several problems draw: the broken bars of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taichi_ldem.storage.fields import read_broken_bars

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PathCollection

    from taichi_ldem.output.loaded import LoadedRun


def draw_broken(
    axes: Axes, run: LoadedRun, plane: str = "xy", *, timed: bool = False, colour: str = "C0"
) -> PathCollection:
    """Draw a dot for each broken bar, and label the axes, mm.

    Args:
        plane: the two axes of the picture. timed: colour the dots by the time of breaking, us.
        colour: of all dots otherwise.

    Returns:
        The dots, for a colour bar.
    """
    bars = read_broken_bars(run.folder.fields_file)
    right, up = (1e3 * bars.position_m[:, "xyz".index(axis)] for axis in plane)
    colours = 1e6 * bars.time_s if timed else colour
    axes.set(xlabel=f"{plane[0]} [mm]", ylabel=f"{plane[1]} [mm]", aspect="equal")
    return axes.scatter(right, up, c=colours, s=1.5, cmap="viridis" if timed else None)
