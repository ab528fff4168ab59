"""The page of a run: the scene, the events, the cost and how to repeat it, in one HTML file.

The page opens from disk without a network: Plotly's JavaScript (which its Python package holds),
pictures and numbers are inside, about 6 MB. Curves are interactive, since a thousand samples want
zooming and reading. Everything comes from the folder.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichi_ldem.analysis.quantities import named
from taichi_ldem.errors import DamagedFile
from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.curves.times import events_of
from taichi_ldem.output.loaded import LoadedRun, Series
from taichi_ldem.output.report import images, plots, tables
from taichi_ldem.output.report.page import Page, Picture, Table
from taichi_ldem.output.report.write import template, write_page
from taichi_ldem.reading import read_text
from taichi_ldem.scenarios.describe import implied, left_out, warnings
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scene import DISORDERED, Scene
from taichi_ldem.storage.arrays import reading
from taichi_ldem.storage.checkpoint import LATEST
from taichi_ldem.storage.folder import RunFolder

PICTURES = 12
"""Times at which the plate is drawn, at most."""
_MOST_ROWS = 4000


def write_report(folder: Path, out: Path | None = None, *, pictures: int = PICTURES) -> Path:
    """Write the page of a run folder.

    Args:
        out: the page; None: ``report.html`` in the folder.
        pictures: times at which the plate is drawn, at most; 0: no snapshots.

    Raises:
        SceneError: the folder holds no run, or the optional packages are missing.
        OSError: the page cannot be written.
    """
    template()  # a missing package ends the command before the pictures are drawn
    run = LoadedRun.read(_open(folder), most_rows=_MOST_ROWS)
    with run.drawing("the page"):
        page = run_page(run, pictures)
    if out is None:
        out = folder / "report.html"
        run.folder.claim([out.name])
    return write_page(page, out)


def _open(path: Path) -> RunFolder:
    folder = RunFolder(path)
    if folder.scene_file.exists() and folder.read_scene().scenario == "modes":
        return folder  # has no history
    return RunFolder.open(path)


def run_page(run: LoadedRun, pictures: int) -> Page:
    """The page of a run, with pictures at so many times at most."""
    scene, summary, folder = run.scene, run.summary, run.folder
    snapshots, note = images.snapshots(run, pictures)
    processes = _processes(folder)
    figures = plots.figures(run)
    return Page(
        title=SCENARIOS[scene.scenario].title,
        name=folder.path.resolve().name,
        lead=lead(run),
        cards=tables.cards(scene, summary),
        asked=[
            Table(list(implied(scene).items()), caption="What the inputs imply"),
            tables.keys(scene),
        ],
        notes=[*warnings(scene), *filter(None, [run.fault])],
        left_out=left_out(scene),
        scene=read_text(folder.scene_file),
        times=[float(t) for t in run.history.get("time_s", ())],
        readings=_readings(run.history),
        events=events_of(summary),
        figures=figures,
        snapshots=snapshots,
        snapshot_note=note,
        happened=tables.happened(run),
        images=_images(run, {figure.name for figure in figures}),
        cost=[tables.cost(summary)],
        repeat=[tables.provenance(processes[-1] if processes else {})],
        commands=[str(process.get("command", "")) for process in processes],
    )


def _images(run: LoadedRun, shown: set[str]) -> list[Picture]:
    """The run's figures that are not among the interactive ones."""
    found = []
    for name in SCENARIOS[run.scene.scenario].figures:
        file = run.folder.path / f"{name}.png"
        if name not in shown and file.is_file():
            found.append(Picture(FIGURES[name].title, images.embedded(file)))
    return found


def lead(run: LoadedRun) -> str:
    """A sentence on the specimen, and how far an unfinished run has come."""
    scene = run.scene
    x, y, z = (1e3 * side for side in scene.plate.actual_size)
    nx, ny, nz = scene.plate.modules
    text = f"{x:.1f} x {y:.1f} x {z:.2f} mm as {nx} x {ny} x {nz} modules"
    for number, striker in enumerate(scene.strikers):
        by = "an indenter" if striker.mass is None else f"{striker.mass:g} kg"
        text += f"{' and' if number else ', struck'} by {by} at {striker.speed:g} m/s"
    if any(scene.plate.velocity or ()):
        text += f", thrown at {math.hypot(*scene.plate.velocity or ()):g} m/s"
    text += _random(scene, run.folder)
    if not run.summary and run.rows:
        end = run.history["time_s"][-1]
        text += f". Not finished: until {1e3 * end:.3f} of {1e3 * scene.solver.duration:.3f} ms"
    return text + "."


def _random(scene: Scene, folder: RunFolder) -> str:
    """The random properties, as asked for and as drawn."""
    from taichi_ldem.model.disorder import cv_from_shape, shape_of

    disorder = scene.disorder
    parts = []
    drawn = _drawn(folder)
    shapes = {name: shape_of(disorder, name) for name in DISORDERED}
    for place, (name, shape) in enumerate((n, s) for n, s in shapes.items() if s is not None):
        text = f"{name.replace('_', ' ')} with a CV of {100 * cv_from_shape(shape):.3g} %"
        if place < len(drawn):
            mean, cv = drawn[place]
            text += f" (drawn: {100 * cv:.3g} %, mean {mean:.4g} times the given one)"
        parts.append(text)
    if disorder is None or not parts:
        return ""
    length = disorder.correlation_length
    over = f"correlated over {1e3 * length:.3g} mm" if length else "every bar on its own"
    return f". Random {', '.join(parts)}, {over}, seed {disorder.seed}"


def _drawn(folder: RunFolder) -> list[tuple[float, float]]:
    """Mean and CV of the random factors, from the last checkpoint; empty where it has none."""
    try:
        with reading(folder.path / LATEST) as file:
            return [(float(mean), float(cv)) for mean, cv in file.take("state/clock/drawn", (2,))]
    except DamagedFile:
        return []


def _processes(folder: RunFolder) -> list[dict[str, Any]]:
    """The provenance of each process that wrote the folder; empty without one."""
    return [process for process in folder.processes() if isinstance(process, dict)]


def _readings(history: Mapping[str, Series]) -> list[dict[str, Any]]:
    """The values that are shown at the time of the slider: all columns, forces first."""
    columns = sorted(history, key=lambda name: not name.endswith("_n"))
    return [
        {
            "label": named(name).label,
            "unit": named(name).unit,
            "values": [_rounded(named(name).factor * value) for value in history[name]],
        }
        for name in columns
        if name != "time_s"
    ]


def _rounded(value: float) -> float | None:
    """Four digits; a whole number keeps all of them."""
    if not math.isfinite(value):
        return None
    return float(f"{value:.4g}") if value % 1 else float(value)
