"""One self-contained HTML page of a run or an ensemble: asked, happened, cost, how to repeat it.

The page opens from disk without a network: plotly's JavaScript (which lies in its Python package),
pictures and numbers are all inside, some 6 MB. Plotly rather than drawn vectors because curves of a
thousand samples want zooming, reading off and switching off; its Python half checks every figure.
Everything comes from the folder; nothing is computed but what the figures need.
"""

from __future__ import annotations

import base64
import csv
import io
import json
import math
import os
import shlex
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis import paper
from taichi_ldem.analysis.quantities import MEASURED_AT_END, at_end, named, unit_of
from taichi_ldem.analysis.signals import SMOOTHING_WINDOW, low_pass, smooth_force
from taichi_ldem.ensemble.plan import MEMBERS
from taichi_ldem.ensemble.results import FEWEST
from taichi_ldem.ensemble.table3 import AT_T2
from taichi_ldem.ensemble.table3 import label as group_label
from taichi_ldem.errors import SceneError
from taichi_ldem.output.figures.run import RING_SIGN
from taichi_ldem.output.render.surfaces import FAILED_SHARE
from taichi_ldem.scenarios.describe import implied, left_out, warnings
from taichi_ldem.scene import DISORDERED, Scene, load_scene
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.store import RunFolder, read_fields, read_times

if TYPE_CHECKING:
    from taichi_ldem.analysis.cracks import Cracks

Series = NDArray[np.float64]
Trace = dict[str, Any]

PICTURES = 12
"""Times at which the plate is drawn, at most."""
_WIDTH_PX = 800
_MOST_ROWS = 4000
_MS, _MM = 1e3, 1e3

# Label, unit and factor of the history's columns, in the order in which they are read out.
_COLUMNS: dict[str, tuple[str, str, float]] = {
    "striker_force_n": ("striker force", "N", 1.0),
    "ring_force_n": ("ring force", "N", 1.0),
    "support_force_n": ("support force", "N", 1.0),
    "grip_force_n": ("grip force", "N", 1.0),
    "striker_displacement_m": ("striker displacement", "mm", _MM),
    "grip_displacement_m": ("grip displacement", "mm", _MM),
    "striker_velocity_m_s": ("striker velocity", "m/s", 1.0),
    "gauge_strain": ("gauge strain", "%", 100.0),
    "gauge_lateral_strain": ("lateral strain", "%", 100.0),
    "strain_j": ("strain energy", "J", 1.0),
    "fracture_j": ("fracture energy", "J", 1.0),
    "kinetic_plate_j": ("kinetic energy of the plate", "J", 1.0),
    "contact_j": ("lost in contact", "J", 1.0),
    "damping_j": ("lost by damping", "J", 1.0),
    "external_j": ("work of gravity or grips", "J", 1.0),
    "broken_bars": ("broken bars", "", 1.0),
    "energy_error": ("energy error", "%", 100.0),
}
_TITLES = {
    "impact": "Falling-weight impact",
    "tension": "Tension test",
    "bend": "Three-point bending",
    "wave": "Travelling pulse",
    "modes": "Free oscillations",
}
# Figures of `ldem plot` that say what no interactive one here says, and what they show.
_FIGURES = {
    "cracks": "Measured cracks: radial at t2 (energy), circular at the end, from below",
    "crack_growth": "Growth of the cracks",
    "crack_map": "Crack map in the reference configuration",
    "stress_strain": "Stress over strain",
    "force_displacement": "Force over displacement",
    "pulse": "Snapshots of the pulse",
    "dispersion": "Phase speed over wavelength",
    "anisotropy": "Phase speed over direction",
    "modes": "Mode shapes",
}
_BLUE, _GREY, _RED, _GREEN, _ORANGE, _VIOLET = (
    "#1f77b4",
    "#b0b0b0",
    "#d62728",
    "#2ca02c",
    "#ff7f0e",
    "#9467bd",
)


def write_report(folder: Path, out: Path | None = None, *, pictures: int = PICTURES) -> Path:
    """Write the page of a run or an ensemble folder.

    Args:
        out: the page; None: ``report.html`` in the folder.
        pictures: times at which the plate is drawn, at most; 0: no snapshots.

    Raises:
        SceneError: the folder is neither, or the optional packages are missing.
        OSError: the page cannot be written.
    """
    template = _template()
    path = folder / "report.html" if out is None else out
    if (folder / "ensemble.csv").is_file():
        page = _ensemble_page(folder.resolve(), path)
    else:
        page = _run_page(_open(folder), pictures)
    text = template.render(page=page, plotly=_plotly() if page.figures else "")
    write_whole(path, text.encode())
    return path


def _template() -> Any:
    try:
        import jinja2
        import plotly  # noqa: F401
    except ImportError:
        raise SceneError("a report needs `pip install 'taichi-ldem[report]'`") from None
    source = resources.files("taichi_ldem.output.report").joinpath("report.html.j2")
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(source.read_text(encoding="utf-8"))


def _plotly() -> str:
    source = resources.files("plotly").joinpath("package_data/plotly.min.js")
    return source.read_text(encoding="utf-8")


# --- the page -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Link:
    """A cell that leads to a file beside the page."""

    text: str
    href: str


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        header: of the columns; empty for a table of names and values.
    """

    rows: Sequence[tuple[str | Link, ...]]
    header: tuple[str, ...] = ()
    caption: str = ""

    @property
    def bare(self) -> Table:
        """Without its caption, which stands elsewhere."""
        return replace(self, caption="")


@dataclass(frozen=True)
class Figure:
    """An interactive figure.

    Attributes:
        json: of plotly.
        marker: how the time shows: "line" (a line at the time), "point" (the trace of that number
            is moved along the one before), "map" (what has not happened yet is pale).
        along: x and y of the path that a point follows.
    """

    name: str
    json: str
    marker: str = "line"
    along: tuple[list[float], list[float]] = ((), ())  # type: ignore[assignment]
    point: int = 0


@dataclass(frozen=True)
class Picture:
    """An embedded image: what it shows, and its bytes as a data address."""

    caption: str
    data: str


@dataclass(frozen=True)
class Snapshots:
    """Pictures of one view over time.

    Attributes:
        times: s.
        note: what a reader must know about them.
    """

    view: str
    times: list[float]
    pictures: list[Picture]
    note: str = ""


@dataclass(frozen=True)
class Page:
    """What the template shows."""

    title: str
    name: str
    lead: str
    cards: list[tuple[str, str]] = field(default_factory=list)
    asked: list[Table] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    scene: str = ""
    times: list[float] = field(default_factory=list)
    readings: list[dict[str, Any]] = field(default_factory=list)
    events: list[tuple[str, float | None]] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    snapshots: list[Snapshots] = field(default_factory=list)
    snapshot_note: str = ""
    happened: list[Table] = field(default_factory=list)
    images: list[Picture] = field(default_factory=list)
    cost: list[Table] = field(default_factory=list)
    repeat: list[Table] = field(default_factory=list)
    commands: list[str] = field(default_factory=list)

    def script(self) -> str:
        """What the page's JavaScript reads, as JSON that may stand in a script element."""
        told = {
            "times": self.times,
            "readings": self.readings,
            "figures": [
                {
                    "name": f.name,
                    "plot": json.loads(f.json),
                    "marker": f.marker,
                    "along": f.along,
                    "point": f.point,
                }
                for f in self.figures
            ],
            "snapshots": [
                {"view": s.view, "times": s.times, "note": s.note} for s in self.snapshots
            ],
        }
        return json.dumps(told, allow_nan=False).replace("</", "<\\/")


def _open(path: Path) -> RunFolder:
    folder = RunFolder(path)
    if folder.scene_file.is_file() and load_scene(folder.scene_file).scenario == "modes":
        return folder  # has no history
    return RunFolder.open(path)


def _run_page(folder: RunFolder, pictures: int) -> Page:
    scene, summary = load_scene(folder.scene_file), folder.read_summary()
    history = _thinned(folder.read_history() if folder.history_file.is_file() else {})
    name = folder.path.resolve().name
    finished = bool(summary)
    lead = _lead(scene, history, finished, folder)
    cracks = _cracks(folder, scene)
    snapshots, snapshot_note = _snapshots(folder, scene, pictures)
    processes = _processes(folder)
    figures = _figures(scene, history, summary, cracks)
    shown = {figure.name for figure in figures}
    return Page(
        title=_TITLES[scene.scenario],
        name=name,
        lead=lead,
        cards=_cards(scene, summary),
        asked=[
            Table(list(implied(scene).items()), caption="What the inputs imply"),
            Table(_keys(scene), ("key", "value", "unit"), "Scene, defaults included"),
        ],
        notes=warnings(scene),
        left_out=left_out(scene),
        scene=folder.scene_file.read_text(encoding="utf-8"),
        times=[float(t) for t in history.get("time_s", ())],
        readings=_readings(history),
        events=_events(summary),
        figures=figures,
        snapshots=snapshots,
        snapshot_note=snapshot_note,
        happened=_happened(scene, summary, folder),
        images=[
            Picture(caption, _embedded(file))
            for stem, caption in _FIGURES.items()
            if (file := folder.path / f"{stem}.png").is_file() and stem not in shown
        ],
        cost=[Table(_cost(summary), caption="Time, memory, error")],
        repeat=[Table(_provenance(processes[-1]) if processes else [], caption="What wrote it")],
        commands=[str(p.get("command", "")) for p in processes],
    )


def _random(scene: Scene, folder: RunFolder) -> str:
    """Which properties are random, as asked for and as drawn."""
    from taichi_ldem.model.disorder import cv_from_shape, shape_of

    disorder = scene.disorder
    parts = []
    drawn = _drawn(folder)
    shapes = {name: shape_of(disorder, name) for name in DISORDERED}
    for number, (name, shape) in enumerate((n, s) for n, s in shapes.items() if s is not None):
        text = f"{name.replace('_', ' ')} with a CV of {100 * cv_from_shape(shape):.3g} %"
        if number < len(drawn):
            mean, cv = drawn[number]
            text += f" (drawn: {100 * cv:.3g} %, mean {mean:.4g} of the asked)"
        parts.append(text)
    if disorder is None or not parts:
        return ""
    length = disorder.correlation_length
    over = f"correlated over {_MM * length:.3g} mm" if length else "every bar on its own"
    return f". Random {', '.join(parts)}, {over}, seed {disorder.seed}"


def _drawn(folder: RunFolder) -> list[tuple[float, float]]:
    """Mean and CV of the random factors from the last checkpoint; empty without one."""
    import h5py

    try:
        with h5py.File(folder.path / "checkpoint.h5", "r") as file:
            return [(float(mean), float(cv)) for mean, cv in file["state/clock/drawn"][()]]
    except (OSError, KeyError, ValueError):
        return []


def _lead(scene: Scene, history: Mapping[str, Series], finished: bool, folder: RunFolder) -> str:
    x, y, z = (1e3 * side for side in scene.plate.actual_size)
    nx, ny, nz = scene.plate.modules
    text = f"{x:.1f} x {y:.1f} x {z:.2f} mm as {nx} x {ny} x {nz} modules"
    if scene.striker is not None:
        text += f", struck by {scene.striker.mass:g} kg at {scene.striker.velocity:g} m/s"
    text += _random(scene, folder)
    if not finished and "time_s" in history and len(history["time_s"]):
        end = history["time_s"][-1]
        text += f". Not finished: until {1e3 * end:.3f} of {1e3 * scene.solver.duration:.3f} ms"
    return text + "."


def _thinned(history: dict[str, Series]) -> dict[str, Series]:
    rows = len(history.get("time_s", ()))
    every = max(1, -(-rows // _MOST_ROWS))
    return {name: values[::every] for name, values in history.items()}


def _cracks(folder: RunFolder, scene: Scene) -> Cracks | None:
    if scene.scenario != "impact" or not folder.fields_file.is_file():
        return None
    from taichi_ldem.scenarios.measure import measure_run

    return measure_run(folder)


def _processes(folder: RunFolder) -> list[dict[str, Any]]:
    try:
        told = json.loads(folder.provenance_file.read_text(encoding="utf-8"))["processes"]
        return [process for process in told if isinstance(process, dict)]
    except (OSError, ValueError, KeyError, TypeError):
        return []


# --- tables ---------------------------------------------------------------------------------------

# Those without a value are shown, too, where a finished impact could have had one.
_CARDS = (
    "first_peak_force_n",
    "second_peak_force_n",
    "failure_time_s",
    "failure_time_velocity_s",
    "failure_time_energy_s",
    "radial_cracks",
    "radial_diameter_m",
    "circular_diameter_m",
    "youngs_modulus",
    "poisson_ratio",
    "strength",
    "peak_force_n",
    "peak_work_j",
    "fracture_j",
)


def _cards(scene: Scene, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    if scene.scenario == "modes":
        frequencies = summary.get("frequencies_hz", [])
        return [(f"mode {n + 1}", f"{f / 1e3:.3f} kHz") for n, f in enumerate(frequencies[:6])]
    cards = []
    for key in _CARDS:
        if _number(summary, key) is not None:
            cards.append((_card_label(key, summary), named(key).told(summary[key])))
        elif key in summary and scene.material.damage:
            within = f" within {named(key).told(scene.solver.duration)}" if "time" in key else ""
            cards.append((_card_label(key, summary), f"none{within}"))
    key = "energy_error_of_plate"
    key = key if _number(summary, key) is not None else "energy_error"
    if _number(summary, key) is not None:
        cards.append((named(key).label, named(key).told(summary[key])))
    return cards


def _card_label(key: str, summary: Mapping[str, Any]) -> str:
    label = named(key).label
    if key in AT_T2 and summary.get(key):
        return f"{label}, {MEASURED_AT_END if at_end(summary) else 'at t2 (energy)'}"
    return label


def _number(summary: Mapping[str, Any], key: str) -> float | None:
    value = summary.get(key)
    return float(value) if isinstance(value, (int, float)) else None


def _keys(scene: Scene) -> list[tuple[str, ...]]:
    from taichi_ldem.storage.provenance import canonical

    return [(key, _plain(value), unit_of(key)) for key, value in canonical(scene).items()]


def _plain(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, list):
        return ", ".join(_plain(item) for item in value) or "none"
    if isinstance(value, dict):
        return ", ".join(f"{key} = {_plain(item)}" for key, item in value.items())
    return str(value).lower() if isinstance(value, bool) else str(value)


def _happened(scene: Scene, summary: Mapping[str, Any], folder: RunFolder) -> list[Table]:
    tables = []
    if scene.scenario == "impact" and paper.is_papers_test(scene):
        tables.append(_beside_the_paper(summary))
    if scene.scenario == "modes":
        tables.append(_csv_table(folder.path / "modes.csv", "Natural frequencies"))
    skip = {"provenance", "frequencies_hz", "residuals", "names", "groups", *_COST}
    rows = [
        (named(key).label, named(key).shown(value), named(key).unit, key)
        for key, value in summary.items()
        if key not in skip and len(str(value)) < 200
    ]
    header = ("", "value", "unit", "key in summary.json, which has all digits in SI units")
    return [*tables, Table(rows, header, "All numbers")]


def _beside_the_paper(summary: Mapping[str, Any]) -> Table:
    own, tests = paper.TABLE_3[0.0], paper.EXPERIMENTS

    def told(key: str, factor: float, form: str) -> str:
        value = _number(summary, key)
        return "none" if value is None else form.format(factor * value)

    def spread(values: Sequence[float], factor: float = 1.0) -> str:
        return ", ".join(f"{factor * value:g}" for value in values)

    low, high = (f"{n:g}" for n in paper.P2_N)
    first, last = (f"{1e3 * t:g}" for t in paper.T2_S)
    p1, t1 = f"about {paper.P1_N:g} N", f"about {1e3 * paper.T1_S:g} ms"
    rows = [
        ("first peak P1", told("first_peak_force_n", 1, "{:.0f} N"), p1, p1),
        ("its time t1", told("first_peak_time_s", 1e3, "{:.2f} ms"), t1, t1),
        ("second peak P2", told("second_peak_force_n", 1, "{:.0f} N"), "", f"{low} to {high} N"),
        (
            "failure t2 (force)",
            told("failure_time_s", 1e3, "{:.2f} ms"),
            f"about {1e3 * paper.T2_LDEM_S:g} ms",
            f"{first} to {last} ms",
        ),
        (
            "radial cracks",
            told("radial_cracks", 1, "{:.0f}"),
            spread(own.radial_cracks),
            spread(tests.radial_cracks),
        ),
        (
            "d_r",
            told("radial_diameter_m", 1e3, "{:.1f} mm"),
            f"{spread(own.radial_diameter, 1e3)} mm",
            f"{spread(tests.radial_diameter, 1e3)} mm",
        ),
        (
            "d_c",
            told("circular_diameter_m", 1e3, "{:.1f} mm"),
            f"{spread(own.circular_diameter, 1e3)} mm",
            f"{spread(tests.circular_diameter, 1e3)} mm",
        ),
    ]
    header = ("", "this run", "paper's LDEM", "experiments")
    return Table([tuple(row) for row in rows], header, "Beside the paper")


_COST = (
    "wall_s",
    "compile_s",
    "steps",
    "time_step_s",
    "critical_time_step_s",
    "bars",
    "nodes",
    "bars_per_s",
    "peak_memory_bytes",
    "energy_error",
    "energy_error_of_plate",
)


def _cost(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [
        (named(key).label, named(key).shown(summary[key]), named(key).unit)
        for key in _COST
        if _number(summary, key) is not None
    ]
    return rows or [("", "not finished: no summary yet", "")]


def _provenance(process: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for key, label in (
        ("scene_sha256", "SHA-256 of the scene"),
        ("version", "taichi_ldem"),
        ("git", "commit"),
        ("python", "Python"),
        ("packages", "packages"),
        ("platform", "platform"),
        ("cpu", "CPU"),
    ):
        value = process.get(key)
        if value:
            rows.append((label, _plain(value).replace(" = ", " ")))
    return rows


def _csv_table(file: Path, caption: str) -> Table:
    if not file.is_file():
        return Table([], caption=caption)
    rows = list(csv.reader(io.StringIO(file.read_text(encoding="utf-8"))))
    body = [tuple(_short(cell) for cell in row) for row in rows[1:]]
    return Table(body, tuple(rows[0]) if rows else (), caption)


def _short(cell: str) -> str:
    try:
        number = float(cell)
    except ValueError:
        return cell
    return cell if number == round(number) and abs(number) < 1e6 else f"{number:.5g}"


# --- what moves with the time ---------------------------------------------------------------------


def _readings(history: Mapping[str, Series]) -> list[dict[str, Any]]:
    """Values that are read out beside the time."""
    return [
        {
            "label": label,
            "unit": unit,
            "values": [_digits(factor * v) for v in history[name]],
        }
        for name, (label, unit, factor) in _COLUMNS.items()
        if name in history
    ]


def _digits(value: float) -> float | None:
    if not math.isfinite(value):
        return None
    return float(f"{value:.4g}") if value % 1 else float(value)


def _events(summary: Mapping[str, Any]) -> list[tuple[str, float | None]]:
    """Names and times to jump to; None: it did not happen."""
    told = (
        ("damage_onset_time_s", "onset of damage"),
        ("first_peak_time_s", "t1"),
        ("second_peak_time_s", "P2"),
        ("failure_time_s", "t2 (force)"),
        ("failure_time_velocity_s", "t2 (velocity)"),
        ("failure_time_energy_s", "t2 (energy)"),
        ("peak_time_s", "peak"),
    )
    return [(label, _number(summary, key)) for key, label in told if key in summary]


def _line(
    x: Iterable[float], y: Iterable[float], name: str, color: str, width: float = 2.0, **more: Any
) -> Trace:
    # seven digits: what a screen shows many times over
    values = np.asarray(y, dtype=np.float32)
    line = {"color": color, "width": width} | more.pop("line", {})
    return {
        "type": "scatter",
        "mode": "lines",
        "x": np.asarray(x, dtype=np.float32),
        "y": values,
        "name": name,
        "line": line,
    } | more


def _figure(
    name: str, traces: list[Trace], x: str, y: str, *, more: Mapping[str, Any] | None = None
) -> str:
    """A figure as JSON, checked by plotly."""
    from plotly import graph_objects

    layout: dict[str, Any] = {
        "title": {"text": name, "x": 0.02, "font": {"size": 15}},
        "template": "plotly_white",
        "margin": {"l": 65, "r": 15, "t": 40, "b": 45},
        "xaxis": {"title": {"text": x}},
        "yaxis": {"title": {"text": y}, "zerolinecolor": "#888888", "zerolinewidth": 1},
        "legend": {"orientation": "h", "y": -0.2, "x": 0},
        "height": 360,
        "hovermode": "closest",
    }
    for key, value in (more or {}).items():
        layout[key] = {**layout.get(key, {}), **value} if isinstance(value, dict) else value
    return str(graph_objects.Figure(data=traces, layout=layout).to_json())


def _figures(
    scene: Scene, history: Mapping[str, Series], summary: Mapping[str, Any], cracks: Cracks | None
) -> list[Figure]:
    if len(history.get("time_s", ())) < 2:
        return []
    time = _MS * history["time_s"]
    figures = []
    if "striker_force_n" in history:
        figures.append(_force(scene, history, summary))
    if "grip_force_n" in history:
        figures.append(_along("Force over strain", history, "gauge_strain", "grip_force_n"))
    elif "support_force_n" in history:
        name = "Force over displacement"
        figures.append(_along(name, history, "striker_displacement_m", "striker_force_n"))
    if "striker_velocity_m_s" in history:
        velocity = _line(time, history["striker_velocity_m_s"], "striker", _BLUE)
        plot = _figure("Striker velocity", [velocity], "time [ms]", "velocity [m/s]")
        figures.append(Figure("velocity", plot))
    energies = [
        _line(time, history[column], label, color)
        for column, label, color in (
            ("strain_j", "strain", _BLUE),
            ("fracture_j", "fracture", _RED),
            ("kinetic_plate_j", "kinetic, plate", _ORANGE),
            ("contact_j", "lost in contact", _GREEN),
            ("damping_j", "lost by damping", _VIOLET),
            ("external_j", "work of gravity or grips", "#7f7f7f"),
        )
        if column in history
    ]
    if "kinetic_striker_j" in history:
        given = history["kinetic_striker_j"][0] - history["kinetic_striker_j"]
        line = {"dash": "dash"}
        energies.append(_line(time, given, "given up by the striker", "#7f7f7f", line=line))
    figures.append(Figure("energy", _figure("Energies", energies, "time [ms]", "energy [J]")))
    error = np.abs(history["energy_error"])
    shown = _line(time, np.where(error > 0, 100 * error, np.nan), "energy error", "#333333", 1.2)
    more = {"yaxis": {"type": "log", "exponentformat": "power"}}
    name = "Energy error, of the initial energy and external work"
    figures.append(Figure("error", _figure(name, [shown], "time [ms]", "error [%]", more=more)))
    if "broken_bars" in history:
        broken = _line(time, history["broken_bars"], "broken bars", _RED)
        figures.append(Figure("broken", _figure("Broken bars", [broken], "time [ms]", "bars")))
    if cracks is not None:
        figures.append(_crack_map(scene, cracks, float(time[-1])))
    return figures


def _force(scene: Scene, history: Mapping[str, Series], summary: Mapping[str, Any]) -> Figure:
    time, force = history["time_s"], history["striker_force_n"]
    window = SMOOTHING_WINDOW if scene.supports is None else 60e-6
    smooth = smooth_force(time, force, window)
    average = f"mean over {_MS * window:g} ms"
    traces = [
        _line(_MS * time, force, "striker, as sampled", _GREY, 0.7),
        _line(_MS * time, smooth, f"striker, {average}", _BLUE, 2.5),
    ]
    shown = [smooth]
    for name in ("ring", "support"):
        if f"{name}_force_n" in history:
            other = smooth_force(time, history[f"{name}_force_n"], window)
            sign = RING_SIGN if name == "ring" else ""
            traces.append(_line(_MS * time, other, f"{name}s, {average}{sign}", _GREEN, 1.2))
            shown.append(other)
    for number, cutoff in enumerate(scene.output.filter_frequencies):
        filtered = low_pass(time, force, cutoff, _number(summary, "first_peak_time_s"))
        name = f"striker, low-pass at {cutoff / 1e3:g} kHz after t1"
        traces.append(_line(_MS * time, filtered, name, (_ORANGE, _VIOLET)[number % 2]))
    for label, peak, at in (
        ("P1", "first_peak_force_n", "first_peak_time_s"),
        ("P2", "second_peak_force_n", "second_peak_time_s"),
    ):
        load, when = _number(summary, peak), _number(summary, at)
        if load is not None and when is not None:
            traces.append(_mark(_MS * when, load, f"{label} = {load:.0f} N"))
    more: dict[str, Any] = {}
    if paper.is_papers_test(scene):
        shown.append(np.array(paper.P2_N))
        more["shapes"] = [
            {
                "type": "rect",
                "x0": _MS * paper.T2_S[0],
                "x1": _MS * paper.T2_S[1],
                "y0": paper.P2_N[0],
                "y1": paper.P2_N[1],
                "fillcolor": _RED,
                "opacity": 0.15,
                "line": {"width": 0},
            }
        ]
        experiments = f"experiments, P1 about {paper.P1_N:g} N (box: P2 and t2)"
        traces.append(_mark(_MS * paper.T1_S, paper.P1_N, experiments, _RED, "diamond-open"))
    more["yaxis"] = {"range": _range(np.concatenate(shown))}
    return Figure("force", _figure("Striker force", traces, "time [ms]", "force [N]", more=more))


def _range(shown: Series) -> list[float]:
    """Limits that hold zero and all of a curve."""
    low, high = min(0.0, float(shown.min())), max(1e-9, float(shown.max()))
    return [low - 0.05 * (high - low), high + 0.08 * (high - low)]


def _mark(x: float, y: float, name: str, color: str = _BLUE, symbol: str = "circle") -> Trace:
    marker = {"size": 10, "color": color, "symbol": symbol}
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [x],
        "y": [y],
        "name": name,
        "marker": marker,
    }


def _along(name: str, history: Mapping[str, Series], x: str, y: str) -> Figure:
    """One column over another, with a point that the time moves."""
    (x_label, x_unit, x_factor), (y_label, y_unit, y_factor) = _COLUMNS[x], _COLUMNS[y]
    across, up = x_factor * history[x], y_factor * history[y]
    traces = [
        _line(across, up, "computed", _BLUE),
        _mark(float(across[0]), float(up[0]), "at the time of the slider", _RED),
    ]
    plot = _figure(name, traces, f"{x_label} [{x_unit}]", f"{y_label} [{y_unit}]")
    path = ([float(f"{v:.6g}") for v in across], [float(f"{v:.6g}") for v in up])
    stem = "force_displacement" if y == "striker_force_n" else "force_strain"
    return Figure(stem, plot, "point", path, 1)


def _crack_map(scene: Scene, cracks: Cracks, end: float) -> Figure:
    """When each column of modules cracked, with radial cracks and fitted circles, from below."""
    arrival = cracks.map.arrival
    half = [0.5 * _MM * n * cracks.map.spacing for n in arrival.shape]
    centres = [
        np.linspace(-h, h, n, endpoint=False, dtype=np.float32) + np.float32(h / n)
        for h, n in zip(half, arrival.shape, strict=True)
    ]
    traces: list[Trace] = [
        {
            "type": "heatmap",
            "x": centres[0],
            "y": centres[1],
            "z": np.where(np.isfinite(arrival), _MS * arrival, np.nan).T.astype(np.float32),
            "zmin": 0.0,
            "zmax": end,
            "colorscale": [[0.0, "#440154"], [0.5, "#21918c"], [1.0, "#fde725"]],
            "colorbar": {"title": {"text": "cracked at [ms]"}, "len": 0.8},
            "hovertemplate": "x %{x:.2f} mm, y %{y:.2f} mm: %{z:.3f} ms<extra></extra>",
            "name": "cracked to a third of the thickness",
        }
    ]
    for number, crack in enumerate(cracks.radial, start=1):
        path = _MM * crack.path.T
        more = {"legendgroup": "radial", "showlegend": number == 1}
        when = "t2 (energy)" if cracks.at_failure else "the end"
        count = f"{len(cracks.radial)} radial cracks"
        label = f"{count} at {when}, {_MS * cracks.radial_time:.2f} ms"
        traces.append(_line(path[0], path[1], label, _RED, 2.0, **more))
        x, y = (float(v) for v in _MM * crack.tip)
        tip = _mark(x, y, f"tip {number}", _RED)
        traces.append(tip | more | {"showlegend": False})
    for circle, label, color in (
        (cracks.radial_circle, "d_r", _RED),
        (cracks.circular_circle, "d_c", _BLUE),
    ):
        if circle is not None:
            angle = np.linspace(0.0, 2 * math.pi, 181)
            radius = circle.diameter / 2
            across = _MM * (circle.x + radius * np.cos(angle))
            up = _MM * (circle.y + radius * np.sin(angle))
            name = f"{label} = {_MM * circle.diameter:.1f} mm"
            traces.append(_line(across, up, name, color, 2.0, line={"dash": "dash"}))
    clamp = scene.clamp
    if clamp is not None and scene.held and clamp.inner_diameter is not None:
        angle = np.linspace(0.0, 2 * math.pi, 181)
        radius = _MM * clamp.inner_diameter / 2
        line = {"dash": "dot"}
        name = f"clamp, {2 * radius:g} mm"
        traces.append(
            _line(radius * np.cos(angle), radius * np.sin(angle), name, "#555555", 1.0, line=line)
        )
    more = {
        "xaxis": {"range": [half[0], -half[0]], "constrain": "domain", "zeroline": False},
        "yaxis": {
            "range": [-half[1], half[1]],
            "scaleanchor": "x",
            "constrain": "domain",
            "zeroline": False,
        },
        "height": 500,
        "legend": {"y": -0.14},
    }
    plot = _figure("Cracks, from below", traces, "x [mm]", "y [mm]", more=more)
    return Figure("crack_map", plot, "map")


# --- pictures -------------------------------------------------------------------------------------


MISSING = (
    f"White or missing: modules with {100 * FAILED_SHARE:.0f} % or more of their bars broken; "
    "they are still in the model."
)


def _embedded(file: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(file.read_bytes()).decode()


def _snapshots(folder: RunFolder, scene: Scene, most: int) -> tuple[list[Snapshots], str]:
    """The plate over time, from below and above; from its broken modules without Vulkan."""
    from taichi_ldem.output.render.snapshots import render_shot
    from taichi_ldem.output.render.views import Shot

    no_fields = not folder.fields_file.is_file()
    if most < 1 or no_fields or scene.pulse is not None or scene.scenario == "modes":
        return [], ""
    stored = read_times(folder.fields_file)
    if not stored.size:
        return [], ""
    chosen = np.unique(np.linspace(0, len(stored) - 1, min(most, len(stored))).round().astype(int))
    times = [float(stored[n]) for n in chosen]
    views = ("below", "above") if scene.striker is not None and not scene.supports else ("above",)
    with tempfile.TemporaryDirectory() as scratch:
        try:
            found = []
            for view in views:
                into = Path(scratch, view)
                into.mkdir()
                drawn = render_shot(folder, Shot(view=view), into, times)
                pictures = [Picture(f"{1e3 * at:.3f} ms", _small(file)) for at, file in drawn]
                found.append(Snapshots(view, [at for at, _ in drawn], pictures, MISSING))
            return found, ""
        except SceneError as error:
            return [_plain_maps(folder, [int(n) for n in chosen])], str(error)


def _small(file: Path) -> str:
    """A picture as WebP of the page's width."""
    from taichi_ldem.output.movie import load

    packed = io.BytesIO()
    load(file, _WIDTH_PX).save(packed, "WEBP", quality=82)
    return "data:image/webp;base64," + base64.b64encode(packed.getvalue()).decode()


def _plain_maps(folder: RunFolder, steps: Sequence[int]) -> Snapshots:
    """Largest share of broken bars in each column of modules, without any drawing device."""
    from matplotlib import colormaps
    from PIL import Image

    pictures, times = [], []
    for step in steps:
        fields = read_fields(folder.fields_file, step)
        base = fields.points[fields.hexahedra[:, 0]]
        edge = np.linalg.norm(fields.points[fields.hexahedra[0, 1]] - base[0])
        i, j = np.rint((base - base.min(axis=0))[:, :2] / edge).astype(int).T
        column = np.full((j.max() + 1, i.max() + 1), -1.0)
        np.maximum.at(column, (j, i), fields.broken_fraction)
        colours = colormaps["YlOrRd"](np.clip(column / 0.4, 0.0, 1.0))[..., :3]
        colours[column < 0] = 1.0
        # from below, y upwards: x to the left
        pixels = (255 * colours[::-1, ::-1]).astype(np.uint8)
        scale = max(1, _WIDTH_PX // max(pixels.shape[:2]))
        image = Image.fromarray(pixels.repeat(scale, axis=0).repeat(scale, axis=1))
        packed = io.BytesIO()
        image.save(packed, "PNG")
        data = "data:image/png;base64," + base64.b64encode(packed.getvalue()).decode()
        pictures.append(Picture(f"{1e3 * fields.time:.3f} ms, broken bars, from below", data))
        times.append(fields.time)
    return Snapshots("broken bars", times, pictures)


# --- ensembles ------------------------------------------------------------------------------------


_SHEETS = {
    "cracks_at_t2": "Cracks from below at t2 (energy), or at the end without failure",
    "cracks_at_end": "Cracks from below at the end",
    "force_envelope": "Force on the striker: smallest, mean and largest of the members",
    "velocity_envelope": "Velocity of the striker: smallest, mean and largest of the members",
    "energy_envelope": "Energies: smallest, mean and largest of the members",
}
_ACROSS = 10
"""Columns of a table of members, beside their names."""


def _csv_rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(file.read_text(encoding="utf-8"))))


def _member_tables(members: Sequence[Mapping[str, str]], folder: Path, page: Path) -> list[Table]:
    """The members' numbers in tables that fit a page, their names linked to their folders."""
    if not members:
        return []
    columns = [key for key in members[0] if key != "name"]
    pieces = [columns[at : at + _ACROSS] for at in range(0, len(columns), _ACROSS)]
    links = [_link(member["name"], folder, page) for member in members]
    note = f" (*: {MEASURED_AT_END})" if any(at_end(_read(m)) for m in members) else ""
    return [
        Table(
            [
                (link, *(_member_cell(key, _read(member)) for key in piece))
                for link, member in zip(links, members, strict=True)
            ],
            ("member", *(named(key).title for key in piece)),
            "Members" + (note if "radial_diameter_m" in piece else ""),
        )
        for piece in pieces
    ]


def _read(member: Mapping[str, str]) -> dict[str, Any]:
    """A member's cells as numbers, where they are; None where they are empty."""
    found: dict[str, Any] = {}
    for key, cell in member.items():
        try:
            found[key] = json.loads(cell) if cell else None
        except ValueError:
            found[key] = cell
    return found


def _member_cell(key: str, member: Mapping[str, Any]) -> str:
    value = member[key]
    if value is None:
        return "" if key == "reason" else "-"
    starred = key in AT_T2 and at_end(member)
    return named(key).shown(value) + ("*" if starred else "")


def _link(name: str, folder: Path, page: Path) -> Link | str:
    member = folder / MEMBERS / name
    if not member.is_dir():
        return name
    report = member / "report.html"
    there = report if report.is_file() else member
    try:
        return Link(name, Path(os.path.relpath(there, page.resolve().parent)).as_posix())
    except ValueError:  # another drive
        return name


def _ensemble_page(folder: Path, page: Path) -> Page:
    """From ``ensemble.csv``, ``ensemble.json`` and the figures of ``ldem ensemble``."""
    members = _csv_rows(folder / "ensemble.csv")
    told: dict[str, Any] = {}
    file = folder / "ensemble.json"
    if file.is_file():
        try:
            told = json.loads(file.read_text(encoding="utf-8"))
        except ValueError as error:
            raise SceneError(f"cannot read '{file}': {error}") from None
    asked = [(key, _plain(value)) for key, value in told.get("asked", {}).items()]
    read = [_read(member) for member in members]
    groups = [_group(group, starred=_starred(group, read)) for group in told.get("groups", [])]
    failed = [
        f"{name}: {member.get('reason') or member.get('state')}"
        for name, member in told.get("not_finished", {}).items()
    ]
    identity = [(k, _plain(told[k])) for k in ("version", "sha256") if told.get(k)]
    finished = told.get("finished", len(members))
    spent = sum(float(row.get("wall_s") or 0.0) for row in members)
    cost = [("members", str(len(members))), ("stepping, all members", f"{spent:.0f} s")]
    return Page(
        title="Ensemble",
        name=folder.resolve().name,
        lead=f"{finished} of {len(members)} members finished.",
        asked=[Table(asked, caption="Options of the command")],
        notes=failed,
        happened=[*groups, *_member_tables(members, folder, page)],
        images=[
            Picture(_SHEETS.get(file.stem, file.stem.replace("_", " ")), _embedded(file))
            for file in sorted(folder.glob("*.png"))
        ],
        cost=[Table(list(cost), caption="Cost")],
        repeat=[Table(identity, caption="What wrote it")],
        commands=_ensemble_commands(told.get("asked", {}), folder),
    )


def _ensemble_commands(asked: Mapping[str, Any], folder: Path) -> list[str]:
    if not asked.get("scene"):
        return []
    words = ["ldem", "ensemble", str(asked["scene"])]
    for key in ("cv", "seeds", "vary", "set"):
        given = asked.get(key) or []
        for value in given if isinstance(given, list) else [given]:
            words += [f"--{key}", str(value)]
    return [shlex.join(words), shlex.join(["ldem", "plot", str(folder)])]


def _starred(group: Mapping[str, Any], members: Sequence[Mapping[str, Any]]) -> bool:
    """Whether cracks of a member of the group were measured at the end."""
    varied = group.get("varied", {})
    own = [m for m in members if all(m.get(key) == value for key, value in varied.items())]
    return any(at_end(member) for member in own)


def _group(group: Mapping[str, Any], *, starred: bool) -> Table:
    """Statistics of a group; starred: of some members cracks were measured at the end."""
    rows: list[tuple[str, ...]] = []
    for name, s in group.get("statistics", {}).items():
        number = named(name)
        deviation, interval = s["standard_deviation"], s["interval"]
        if s["count"] < FEWEST or name == "wall_s":
            interval = None  # of folders from before
        rows.append(
            (
                number.label + ("*" if starred and name in AT_T2 else ""),
                number.unit,
                str(s["count"]),
                number.shown(float(s["mean"])),
                "" if deviation is None else number.shown(deviation),
                "" if interval is None else " to ".join(map(number.shown, interval)),
                f"{number.shown(s['smallest'])} to {number.shown(s['largest'])}",
            )
        )
    header: tuple[str, ...]
    header = ("", "unit", "members", "mean", "standard deviation", "95 % of the mean", "range")
    varied = group_label([(k, v) for k, v in group.get("varied", {}).items()])
    caption = varied[0].upper() + varied[1:]
    if not any(row[5] for row in rows):
        rows, header = [row[:5] + row[6:] for row in rows], header[:5] + header[6:]
        caption += f"; no confidence interval below {FEWEST} members"
    return Table(rows, header, caption + (f" (*: some {MEASURED_AT_END})" if starred else ""))
