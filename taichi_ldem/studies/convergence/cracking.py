"""Convergence of a cracking impact: times, forces, energies and cracks over several seeds.

Cracks are chaotic: they differ when the striker is moved by a fraction of a module. Every setting
therefore runs with the striker at the same few places near the plate's middle, and the means of
these runs are compared, with their 95 % confidence intervals.
"""

import csv
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.analysis import signals
from taichi_ldem.analysis.window import smoothing_window
from taichi_ldem.errors import SceneError
from taichi_ldem.reading import read_object
from taichi_ldem.scenarios.interrupts import run_child
from taichi_ldem.scene import Scene
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.place import refuse_moved
from taichi_ldem.studies.convergence.plan import Point
from taichi_ldem.studies.convergence.records import Study
from taichi_ldem.studies.convergence.run import SEED_REACH

SHARES = ((0.5, "f64"), (0.9, "f64"), (0.5, "f32"))
"""Settings at the coarsest resolution; finer ones run with the first alone."""

QUANTITIES = {
    "t1": ("first peak t1 [ms]", 1e3, ".4f"),
    "P1": ("first peak P1 [N]", 1.0, ".0f"),
    "t2": ("failure t2 [ms]", 1e3, ".4f"),
    "fracture": ("dissipated [mJ]", 1e3, ".1f"),
    "d_r": ("d_r [mm]", 1e3, ".1f"),
    "d_c": ("d_c [mm]", 1e3, ".1f"),
}


@dataclass(frozen=True)
class Setting:
    """A setting and the numbers of its runs by quantity; a run may lack some of them."""

    modules: int
    share: float
    precision: str
    values: dict[str, list[float]]
    seconds: float
    runs: int

    def mean(self, name: str) -> tuple[float, float]:
        """Mean and half of its 95 % confidence interval; NaN for too few runs."""
        return mean_of(self.values[name])


def mean_of(values: Sequence[float]) -> tuple[float, float]:
    """Mean and half of its 95 % confidence interval (Student), NaN for too few values."""
    from scipy.stats import t

    count = len(values)
    if count == 0:
        return math.nan, math.nan
    half = math.nan
    if count > 1:
        half = float(t.ppf(0.975, count - 1)) * float(np.std(values, ddof=1)) / math.sqrt(count)
    return float(np.mean(values)), half


def places(scene: Scene, seeds: int) -> list[tuple[float, float]]:
    """Places of the striker, m: within SEED_REACH of the thickness from the scene's own."""
    assert scene.striker is not None
    x, y = scene.striker.position
    reach = SEED_REACH * scene.plate.size[2]
    offsets = np.random.default_rng(7).uniform(-reach, reach, (seeds, 2))
    return [(x + float(a), y + float(b)) for a, b in offsets]


def run(study: Study, seeds: int) -> int:
    """Run what is missing and write the study's files; returns 0."""
    points = [Point(m, *SHARES[0]) for m in (*study.plan.modules, study.plan.reference)]
    points += [Point(study.plan.modules[0], *pair) for pair in SHARES[1:]]
    settings: list[Setting] = []
    for point in points:
        records = []
        for seed, place in enumerate(places(study.scene, seeds), start=1):
            records.append(_record(study, point, seed, place))
            found = [*settings, _setting(point, records)]
            (study.out / "convergence.md").write_text(report(found), encoding="utf-8")
        settings.append(_setting(point, records))
    _write_csv(settings, study.out / "convergence.csv")
    figure(settings, study.out / "convergence.png")
    print(report(settings))
    return 0


def _record(study: Study, point: Point, seed: int, place: tuple[float, float]) -> dict[str, Any]:
    """One run's numbers; `ldem impact` in a process of its own unless its folder is finished."""
    folder = study.out / f"{point.name}_seed{seed}"
    if not (folder / "summary.json").exists():
        print(folder.name, flush=True)
        settings = [*point.settings, f"striker.position=[{place[0]!r}, {place[1]!r}]"]
        words = [word for text in settings for word in ("--set", text)]
        command = [sys.executable, "-m", "taichi_ldem.cli", "impact", str(study.file)]
        command += ["--out", str(folder), "--force", "--quiet", *words]
        if code := run_child(command):
            raise SceneError(f"{folder.name}: its run ended with exit code {code}")
        refuse_moved(study.out)
    return read(folder, study.scene)


def read(folder: Path, scene: Scene) -> dict[str, Any]:
    """The numbers of a finished run."""
    summary = read_object(folder / "summary.json")
    history = RunFolder(folder).read_history()
    time_s, force = history["time_s"], history["striker_force_n"]
    onset = summary["damage_onset_time_s"]
    peaks = signals.force_peaks(time_s, force, onset, smoothing_window(scene))
    return {
        "t1": peaks.first_time,
        "P1": peaks.first_force,
        "t2": peaks.failure_time,
        "fracture": summary["fracture_j"],
        "d_r": summary["radial_diameter_m"],
        "d_c": summary["circular_diameter_m"],
        "wall_s": summary["wall_s"],
    }


def _setting(point: Point, records: Sequence[dict[str, Any]]) -> Setting:
    values = {name: [float(r[name]) for r in records if r[name] is not None] for name in QUANTITIES}
    seconds = float(np.mean([r["wall_s"] for r in records]))
    return Setting(point.modules, point.share, point.precision, values, seconds, len(records))


def report(settings: Sequence[Setting]) -> str:
    """Means and confidence intervals, then their differences from the finest, as Markdown."""
    heads = ["modules", "dt/critical", "precision", "runs", "seconds a run"]
    heads += [title for title, *_ in QUANTITIES.values()]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for s in settings:
        cells = [f"{s.modules}", f"{s.share:g}", s.precision, f"{s.runs}", f"{s.seconds:.0f}"]
        for name, (_, scale, form) in QUANTITIES.items():
            mean, half = s.mean(name)
            shown = len(s.values[name])
            text = f"{scale * mean:{form}} +- {scale * half:{form}}" if shown else "-"
            cells.append(text if shown in (0, s.runs) else f"{text} ({shown} of {s.runs})")
        lines.append("| " + " | ".join(cells) + " |")
    finest = max(settings, key=lambda s: s.modules)
    lines += ["", f"Difference of the mean from {finest.modules} modules [%]; in brackets where it"]
    lines[-1] += " lies within the two 95 % confidence intervals together."
    lines += ["", "| modules | dt/critical | precision | " + " | ".join(QUANTITIES) + " |"]
    lines.append("|---" * (3 + len(QUANTITIES)) + "|")
    for s in settings:
        if s is finest:
            continue
        cells = [f"{s.modules}", f"{s.share:g}", s.precision]
        for name in QUANTITIES:
            (mean, half), (true, spread) = s.mean(name), finest.mean(name)
            text = "-"
            if mean == mean and true == true:
                text = f"{100 * (mean / true - 1):+.1f}"
                if abs(mean - true) <= math.hypot(half, spread):
                    text = f"({text})"
            cells.append(text)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _write_csv(settings: Sequence[Setting], file: Path) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        names = [f"{name}_{what}" for name in QUANTITIES for what in ("mean", "half_interval")]
        writer.writerow(["modules", "share", "precision", "runs", "wall_s", *names])
        for s in settings:
            numbers = [value for name in QUANTITIES for value in s.mean(name)]
            writer.writerow([s.modules, s.share, s.precision, s.runs, s.seconds, *numbers])


def figure(settings: Sequence[Setting], file: Path) -> None:
    """Draw every quantity's runs, mean and confidence interval over the seconds of a run."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import LogLocator, NullLocator

    drawing = plt.figure(figsize=(11, 6.5), layout="constrained")
    for axes, (name, (title, scale, _)) in zip(
        drawing.subplots(2, 3).ravel(), QUANTITIES.items(), strict=True
    ):
        for number, s in enumerate(settings):
            if not s.values[name]:
                continue
            mean, half = s.mean(name)
            y = scale * np.array(s.values[name])
            axes.plot(np.full(len(y), s.seconds), y, ".", color=f"C{number}", alpha=0.5)
            label = f"{s.modules} modules, {s.share:g}, {s.precision}"
            axes.errorbar(
                s.seconds,
                scale * mean,
                scale * half,
                fmt="o",
                ms=5,
                capsize=4,
                color=f"C{number}",
                label=label,
            )
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        if not any(s.values[name] for s in settings):
            axes.text(0.5, 0.5, "no run has one", transform=axes.transAxes, ha="center")
            axes.set(xticks=[], yticks=[])
        axes.set(xlabel="seconds a run, one core", title=title)
        axes.grid(alpha=0.3, which="both")
    handles, labels = axes.get_legend_handles_labels()
    for other in drawing.axes:
        found, names = other.get_legend_handles_labels()
        if len(names) > len(labels):
            handles, labels = found, names
    drawing.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8)
    drawing.savefig(file, dpi=130)
    plt.close(drawing)
