"""Tables of a run's page: its numbers, its scene, its cost and what wrote it."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_ldem.analysis import paper
from taichi_ldem.analysis.quantities import AT_T2, MEASURED_AT_END, at_end, named, unit_of
from taichi_ldem.output.loaded import LoadedRun, number
from taichi_ldem.output.report.page import Table
from taichi_ldem.reading import read_text
from taichi_ldem.scene import Scene

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
_LISTS = ("provenance", "frequencies_hz", "residuals", "names", "groups")


def cards(scene: Scene, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and value of the most important numbers.

    Numbers without a value are shown, too, where the material could have failed.
    """
    frequencies = summary.get("frequencies_hz", [])
    if frequencies:
        return [(f"mode {n + 1}", f"{f / 1e3:.3f} kHz") for n, f in enumerate(frequencies[:6])]
    found = []
    for key in _CARDS:
        if number(summary, key) is not None:
            found.append((_card_label(key, summary), named(key).with_unit(summary[key])))
        elif key in summary and scene.material.damage:
            within = ""
            if "time" in key:
                within = f" within {named(key).with_unit(scene.solver.duration)}"
            found.append((_card_label(key, summary), f"none{within}"))
    key = "energy_error_of_plate"
    key = key if number(summary, key) is not None else "energy_error"
    if number(summary, key) is not None:
        found.append((named(key).label, named(key).with_unit(summary[key])))
    return found


def _card_label(key: str, summary: Mapping[str, Any]) -> str:
    label = named(key).label
    if key in AT_T2 and summary.get(key):
        return f"{label}, {MEASURED_AT_END if at_end(summary) else 'at t2 (energy)'}"
    return label


def keys(scene: Scene) -> Table:
    """All keys of a scene with their values and units."""
    from taichi_ldem.storage.provenance import canonical

    rows = []
    for key, value in canonical(scene).items():
        if isinstance(value, list) and len(value) > 1 and isinstance(value[0], dict):
            rows += [(f"{key}[{n}]", plain(table), "") for n, table in enumerate(value)]
        else:
            rows.append((key, plain(value), unit_of(key)))
    return Table(rows, ("key", "value", "unit"), "Scene, defaults included")


def plain(value: Any) -> str:
    """A value of a scene or a provenance as text."""
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, list):
        return ", ".join(plain(item) for item in value) or "none"
    if isinstance(value, dict):
        return ", ".join(f"{key} = {plain(item)}" for key, item in value.items())
    return str(value).lower() if isinstance(value, bool) else str(value)


def happened(run: LoadedRun) -> list[Table]:
    """The run's numbers, compared with the paper's where it is the paper's test."""
    tables = []
    if run.scene.scenario == "impact" and run.is_papers_test:
        tables.append(_comparison(run.summary))
    modes = run.folder.path / "modes.csv"
    if modes.exists():
        tables.append(_csv_table(modes, "Natural frequencies"))
    rows = [
        (named(key).label, named(key).shown(value), named(key).unit, key)
        for key, value in run.summary.items()
        if key not in (*_LISTS, *_COST) and len(str(value)) < 200
    ]
    header = ("", "value", "unit", "key in summary.json, which has all digits in SI units")
    return [*tables, Table(rows, header, "All numbers")]


def _comparison(summary: Mapping[str, Any]) -> Table:
    """Numbers of this run, of the paper's model and of its experiments."""
    model, tests = paper.TABLE_3[0.0], paper.EXPERIMENTS

    def own(key: str, factor: float, form: str) -> str:
        value = number(summary, key)
        return "none" if value is None else form.format(factor * value)

    def all_of(values: Sequence[float], factor: float = 1.0, unit: str = "") -> str:
        return ", ".join(f"{factor * value:g}" for value in values) + unit

    def millimetres(label: str, key: str, model: Sequence[float], tests: Sequence[float]) -> Any:
        printed = (all_of(values, 1e3, " mm") for values in (model, tests))
        return (label, own(key, 1e3, "{:.1f} mm"), *printed)

    low, high = (f"{n:g}" for n in paper.P2_N)
    first, last = (f"{1e3 * t:g}" for t in paper.T2_S)
    p1, t1 = f"about {paper.P1_N:g} N", f"about {1e3 * paper.T1_S:g} ms"
    cracks = all_of(model.radial_cracks), all_of(tests.radial_cracks)
    rows = [
        ("first peak P1", own("first_peak_force_n", 1, "{:.0f} N"), p1, p1),
        ("its time t1", own("first_peak_time_s", 1e3, "{:.2f} ms"), t1, t1),
        ("second peak P2", own("second_peak_force_n", 1, "{:.0f} N"), "", f"{low} to {high} N"),
        (
            "failure t2 (force)",
            own("failure_time_s", 1e3, "{:.2f} ms"),
            f"about {1e3 * paper.T2_LDEM_S:g} ms",
            f"{first} to {last} ms",
        ),
        ("radial cracks", own("radial_cracks", 1, "{:.0f}"), *cracks),
        millimetres("d_r", "radial_diameter_m", model.radial_diameter, tests.radial_diameter),
        millimetres("d_c", "circular_diameter_m", model.circular_diameter, tests.circular_diameter),
    ]
    return Table(rows, ("", "this run", "paper's LDEM", "experiments"), "Compared with the paper")


def cost(summary: Mapping[str, Any]) -> Table:
    """Time, memory and error."""
    rows: list[tuple[str, ...]] = [
        (named(key).label, named(key).shown(summary[key]), named(key).unit)
        for key in _COST
        if number(summary, key) is not None
    ]
    rows = rows or [("", "not finished: no summary yet", "")]
    return Table(rows, caption="Time, memory, error")


def provenance(process: Mapping[str, Any]) -> Table:
    """The program, machine and scene of the process that wrote the folder."""
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
            rows.append((label, plain(value).replace(" = ", " ")))
    return Table(rows, caption="What wrote it")


def _csv_table(file: Path, caption: str) -> Table:
    rows = list(csv.reader(io.StringIO(read_text(file))))
    body = [tuple(_short(cell) for cell in row) for row in rows[1:]]
    return Table(body, tuple(rows[0]) if rows else (), caption)


def _short(cell: str) -> str:
    try:
        value = float(cell)
    except ValueError:
        return cell
    return cell if value == round(value) and abs(value) < 1e6 else f"{value:.5g}"
