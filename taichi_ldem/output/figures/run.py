"""Figures of a run, drawn from its folder by Matplotlib: those that its scenario's entry names."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.curves.times import times_of
from taichi_ldem.output.figures import wave
from taichi_ldem.output.figures.crack_map import draw_crack_map, draw_outlines
from taichi_ldem.output.figures.cracks import growth, overlay
from taichi_ldem.output.figures.draw import draw_elements, draw_panels, name_times, save
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.storage.fields import read_broken_bars
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_run(folder: RunFolder) -> list[Path]:
    """Draw the figures of a run's scenario into the run folder, one PNG each.

    A figure that the run has no data for is left out.

    Returns:
        The pictures written.

    Raises:
        SceneError: a file of the run cannot be read.
    """
    run = LoadedRun.read(folder)
    folder.claim(SCENARIOS[run.scene.scenario].writes)
    written = []
    for name in SCENARIOS[run.scene.scenario].figures:
        if FIGURES[name].needs(run):
            file, size = folder.path / f"{name}.png", FIGURES[name].size
            metadata = folder.picture_metadata()
            with run.drawing(f"the figure {name}"):
                written.append(save(file, _drawing(name, run), size=size, metadata=metadata))
    return written


def _drawing(name: str, run: LoadedRun) -> Callable[[Figure], None]:
    panels = FIGURES[name].panels
    if panels is not None:
        return partial(draw_panels, panels=panels(run))
    return partial(_drawn_here, name=name, run=run)


def _drawn_here(figure: Figure, name: str, run: LoadedRun) -> None:
    """A figure that panels cannot describe; those from fields say where these are damaged."""
    _DRAWN_HERE[name](figure, run)
    if name in _OF_FIELDS and run.fault:
        figure.text(0.01, 0.99, run.fault, ha="left", va="top", color="red", fontsize=11)


def _draw_cracks(figure: Figure, run: LoadedRun) -> None:
    assert run.cracks is not None
    clamp = run.scene.clamp
    inner = clamp.inner_diameter if clamp is not None and run.scene.held else None
    outlines = partial(draw_outlines, scene=run.scene, legend=False)
    overlay(figure, run.cracks, outlines, 0.55 * (inner or 0.0))


def _draw_crack_growth(figure: Figure, run: LoadedRun) -> None:
    from taichi_ldem.analysis.cracks import broken_area

    assert run.cracks is not None
    bars = read_broken_bars(run.folder.fields_file)
    area = broken_area(bars, run.scene, run.history["time_s"])
    for number, axes in enumerate(growth(figure, run.cracks, area)):
        axes.set_xlim(0.0, float(run.time_ms[-1]))
        times = times_of(run, "energy")
        draw_elements(axes, [times])
        if number == 0:
            name_times(axes, times)


_DRAWN_HERE: dict[str, Callable[..., None]] = {
    "crack_map": draw_crack_map,
    "cracks": _draw_cracks,
    "crack_growth": _draw_crack_growth,
    "pulse": wave.draw_pulse,
    "dispersion": wave.draw_dispersion,
    "anisotropy": lambda figure, run: wave.draw_anisotropy(figure, run.scene),
}
"""Figures that panels cannot describe."""

_OF_FIELDS = ("crack_map", "cracks", "crack_growth")
"""Those of them that are made from the fields."""
