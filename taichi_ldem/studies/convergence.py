"""Error against run time over resolution, time step and precision: a work-precision study.

What a scene is a reference for follows from its tables: an elastic impact (velocity and impulses
against the finest lattice), a free vibration (frequency against that of vanishing modules), a wave
(displacement at a probe against the exact one) or a cracking impact (times, forces, energies and
cracks, over several places of the striker, against the finest lattice).

Every run is a process of its own on one thread; what is finished is not run again. Errors are
against the reference of the whole family, and once more in time alone, against the same lattice
with a much smaller step.
"""

import csv
import importlib.util
import json
import math
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.wave import delay
from taichi_ldem.scene import Scene, load_scene
from taichi_ldem.storage.provenance import scene_hash
from taichi_ldem.studies.convergence_runs import CRACKING, IMPACT, VIBRATION, WAVE, kind

Array = npt.NDArray[np.float64]

SHARES = (0.25, 0.5, 0.9)
"""Time steps over the critical one, in f64, at every resolution."""
SINGLE = (0.5, 0.9)
"""The same in f32."""
STEPS = (0.95, 0.7, 0.5, 0.35, 0.25, 0.12)
"""The same for the order in time, at one resolution."""
FINE_STEP = 0.03
"""That of the reference in time."""
GOALS = (0.01, 0.05)
PAPER = (6, 0.5, "f64")
"""The paper's own setting: six modules, 9e-8 s, which is 0.51 of the critical step."""


@dataclass(frozen=True)
class Plan:
    """What is run for a kind of scene.

    Attributes:
        modules: through the thickness. reference: of the finest. timed: where the order in time is
            measured. first: the quantity that counts in figure and advice.
    """

    modules: tuple[int, ...]
    reference: int
    timed: int
    first: str


PLANS = {
    IMPACT: Plan((2, 3, 4, 6, 8), 12, 4, "striker impulse"),
    VIBRATION: Plan((2, 3, 4, 6, 8), 0, 4, "frequency"),
    WAVE: Plan((2, 3, 4, 6), 0, 4, "speed"),
    CRACKING: Plan((5, 6), 8, 5, "t2"),
}


@dataclass(frozen=True)
class Point:
    """One run: modules through the thickness, share of the critical step, precision."""

    modules: int
    share: float
    precision: str = "f64"
    seed: int = 0

    @property
    def name(self) -> str:
        """Of its record."""
        seed = f"_seed{self.seed}" if self.seed else ""
        return f"{self.modules}_modules_{self.share:g}_{self.precision}{seed}"

    @property
    def settings(self) -> list[str]:
        """Overrides of the scene."""
        return [
            f"plate.modules_through_thickness={self.modules}",
            f"solver.safety={self.share}",
            f"solver.precision={self.precision}",
            "solver.threads=1",
        ]


@dataclass(frozen=True)
class Row:
    """A finished point with its errors.

    Attributes:
        errors: by quantity, relative. seconds: of stepping on one core.
        share: of the critical time step, as rounded to whole history intervals.
        timed: the errors are against the same lattice, in time alone.
    """

    point: Point
    errors: dict[str, float]
    seconds: float
    share: float
    time_step: float
    record: dict[str, Any]
    timed: bool = False


def run(
    scene_file: Path,
    out: Path,
    *,
    modules: Sequence[int] = (),
    reference: int | None = None,
    seeds: int = 4,
    force: bool = False,
) -> int:
    """Run what is missing and write ``convergence.csv``, ``.md`` and ``.png``; returns 0.

    Args:
        modules: through the thickness, instead of the plan's. reference: the same of the finest.
        seeds: places of the striker for a cracking scene. force: forget the runs of another scene.

    Raises:
        SceneError: a scene that is no reference, or a folder with another scene's runs.
    """
    scene = load_scene(scene_file)
    what = kind(scene)
    if what == VIBRATION and scene.held and importlib.util.find_spec("skfem") is None:
        raise SceneError("a clamped plate is compared with finite elements: install scikit-fem")
    study = Study(scene_file, scene, what, out, PLANS[what], modules, reference)
    study.claim(force)
    if what == CRACKING:
        from taichi_ldem.studies import convergence_cracking

        return convergence_cracking.run(study, seeds)
    study.run_all()
    rows = study.rows()
    _write_csv(rows, out / "convergence.csv")
    text = report(study, rows)
    (out / "convergence.md").write_text(text, encoding="utf-8")
    figure(study, rows, out / "convergence.png")
    print(text)
    return 0


class Study:
    """A scene's runs and where they are kept."""

    def __init__(
        self,
        file: Path,
        scene: Scene,
        what: str,
        out: Path,
        plan: Plan,
        modules: Sequence[int] = (),
        reference: int | None = None,
    ):
        self.file, self.scene, self.what, self.out = file, scene, what, out
        finest = plan.reference if reference is None else reference
        self.plan = Plan(tuple(modules) or plan.modules, finest, plan.timed, plan.first)

    def claim(self, force: bool) -> None:
        """Make the folder this scene's.

        Raises:
            SceneError: it holds the runs of another scene.
        """
        self.out.mkdir(parents=True, exist_ok=True)
        mark, mine = self.out / "scene_sha256", scene_hash(self.scene)
        if mark.exists() and mark.read_text(encoding="utf-8") != mine:
            if not force:
                raise SceneError(f"'{self.out}' holds a study of another scene; --force removes it")
            for file in [*self.out.glob("*.json"), *self.out.glob("mode_*.npz")]:
                file.unlink()
        mark.write_text(mine, encoding="utf-8")

    def points(self) -> list[Point]:
        """All runs against the reference."""
        pairs = [(s, "f64") for s in SHARES] + [(s, "f32") for s in SINGLE]
        return [Point(m, s, p) for m in self.plan.modules for s, p in pairs]

    def steps(self) -> list[Point]:
        """The runs for the order in time."""
        return [Point(self.plan.timed, share) for share in STEPS]

    def run_all(self) -> None:
        """Run what is missing, the reference first."""
        self.reference()
        for point in dict.fromkeys([*self.points(), *self.steps(), self._fine()]):
            self.record(point)

    def _fine(self) -> Point:
        return Point(self.plan.timed, FINE_STEP)

    def reference(self) -> dict[str, Any]:
        """The record that everything is compared with."""
        if self.what == WAVE:
            return self._record("reference", [], ["--reference", "wave"])
        if self.what == VIBRATION and self.scene.held:
            return self._record("reference", [], ["--reference", "finite-elements"])
        if self.what == VIBRATION:
            found = {m: self.record(Point(m, 0.5)) for m in self.plan.modules}
            finest = sorted(self.plan.modules)[-3:]
            edges = [found[m]["spacing_m"] for m in finest]
            values = [found[m]["eigenfrequency_hz"] for m in finest]
            # free faces leave a smooth series
            return {"values": {"frequency": extrapolated(edges, values, 2)}}
        return self.record(Point(self.plan.reference, 0.5))

    def record(self, point: Point) -> dict[str, Any]:
        """A point's record, run in a process of its own unless it is there."""
        more = []
        if self.what == VIBRATION:  # a resolution's mode is computed once, in its first run
            more = ["--mode", str(self.out / f"mode_{point.modules}.npz")]
        return self._record(point.name, point.settings, more)

    def _record(self, name: str, settings: Sequence[str], more: Sequence[str]) -> dict[str, Any]:
        file = self.out / f"{name}.json"
        if not file.exists():
            print(name, flush=True)
            words = [word for text in settings for word in ("--set", text)]
            module = "taichi_ldem.studies.convergence_runs"
            command = [sys.executable, "-m", module, str(self.file), str(file), *words, *more]
            subprocess.run(command, check=True)
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found

    def rows(self) -> list[Row]:
        """Every point against the reference, then the order in time."""
        reference = self.reference()
        rows = [self._row(point, reference) for point in self.points()]
        fine = self.record(self._fine())
        if "flight_s" in reference:  # a lattice's wave knows only when it arrives
            fine = {**fine, "flight_s": reference["flight_s"]}
        return rows + [self._row(point, fine, timed=True) for point in self.steps()]

    def _row(self, point: Point, reference: dict[str, Any], timed: bool = False) -> Row:
        record = self.record(point)
        seconds = float(record["cpu_s"])
        errors = differences(record, reference)
        return Row(point, errors, seconds, record["share"], record["time_step_s"], record, timed)


def differences(record: dict[str, Any], reference: dict[str, Any]) -> dict[str, float]:
    """Relative errors by quantity: of a number, or of a history in the mean square.

    Of a wave also that of its speed: how late it comes over the time that it should have flown.
    """
    errors = {
        name: abs(value / reference["values"][name] - 1)
        for name, value in record.get("values", {}).items()
    }
    if "signals" not in record:
        return errors
    from scipy.interpolate import CubicSpline

    # the last row may come a step early or late
    end = min(record["time"][-1], reference["time"][-1])
    time_s = np.array([t for t in reference["time"] if t < end])
    for name, values in record["signals"].items():
        true = np.array(reference["signals"][name])[: len(time_s)]
        mine = CubicSpline(record["time"], values)(time_s)
        errors[name] = float(np.linalg.norm(mine - true) / np.linalg.norm(true))
        if "flight_s" in reference:
            late = delay(time_s, np.column_stack([true, mine]))
            errors["speed"] = abs(late) / (reference["flight_s"] + late)
    return errors


def extrapolated(sizes: Sequence[float], values: Sequence[float], degree: int) -> float:
    """The value at size zero of the polynomial through (or nearest to) values at some sizes."""
    return float(np.polyfit(sizes, values, degree)[-1])


def order(sizes: Sequence[float], errors: Sequence[float]) -> float:
    """Observed order p of error ~ size^p, by least squares of the logarithms."""
    pairs = [(s, e) for s, e in zip(sizes, errors, strict=True) if e > 0]
    if len(pairs) < 2:
        return math.nan
    x, y = np.log(np.array(pairs)).T
    return float(np.polyfit(x, y, 1)[0])


def orders(study: Study, rows: Sequence[Row]) -> dict[str, tuple[float, float]]:
    """Observed orders in space (at half the critical step, in f64) and in time, by quantity."""
    found = {}
    for name in rows[0].errors:
        space = [r for r in rows if not r.timed and r.point.share == 0.5]
        space = [r for r in space if r.point.precision == "f64"]
        timed = [r for r in rows if r.timed]
        found[name] = (
            order([r.record["spacing_m"] for r in space], [r.errors[name] for r in space]),
            order([r.time_step for r in timed], [r.errors[name] for r in timed]),
        )
    return found


def pareto(rows: Sequence[Row], name: str) -> list[Row]:
    """The points that no other beats in both error and seconds, from the cheapest on."""
    front: list[Row] = []
    for row in sorted((r for r in rows if not r.timed), key=lambda r: (r.seconds, r.errors[name])):
        if not front or row.errors[name] < front[-1].errors[name]:
            front.append(row)
    return front


def advice(study: Study, rows: Sequence[Row]) -> list[str]:
    """A sentence for each goal, and one about the paper's own setting."""
    name = study.plan.first
    front = pareto(rows, name)
    lines = []
    for goal in GOALS:
        good = [row for row in front if row.errors[name] <= goal]
        if good:
            p = good[0].point
            lines.append(
                f"For an error of {100 * goal:.0f} % in the {name}, choose {p.modules} modules, "
                f"{good[0].share:.2f} of the critical time step and {p.precision}: it costs "
                f"{good[0].seconds:.2g} s on one core here, with an error of "
                f"{100 * good[0].errors[name]:.2g} %."
            )
        else:
            best = min(rows, key=lambda row: math.inf if row.timed else row.errors[name])
            lines.append(
                f"None of these settings reaches {100 * goal:.0f} % in the {name}; the best is "
                f"{best.point.modules} modules, with {100 * best.errors[name]:.2g} % in "
                f"{best.seconds:.2g} s."
            )
    for row in rows:
        if (row.point.modules, row.point.share, row.point.precision) == PAPER and not row.timed:
            lines.append(
                "The paper's own setting (six modules, half of the critical step, f64) costs "
                f"{row.seconds:.2g} s here; its error in the {name} is "
                f"{100 * row.errors[name]:.2g} %."
            )
    return lines


def report(study: Study, rows: Sequence[Row]) -> str:
    """Table, observed orders and advice, as Markdown."""
    names = list(rows[0].errors)
    lines: list[str] = []
    for timed, title in ((False, "Against the reference"), (True, "In time alone")):
        lines += [f"### {title}", ""]
        heads = ["modules", "dt/critical", "precision", "steps", "seconds of a core"]
        heads += [f"{name}: error [%]" for name in names]
        lines += ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
        for row in rows:
            if row.timed != timed:
                continue
            cells = [f"{row.point.modules}", f"{row.share:.3f}", row.point.precision]
            cells += [f"{row.record['steps']:,}", f"{row.seconds:.3g}"]
            cells += [f"{100 * row.errors[name]:.3g}" for name in names]
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    lines += ["| quantity | order in space | order in time |", "|---|---|---|"]
    for name, (space, in_time) in orders(study, rows).items():
        lines.append(f"| {name} | {space:.1f} | {in_time:.1f} |")
    reference = study.reference()
    if "continuum_m_s" in reference:
        lines += ["", f"The reference's speed of long waves is {reference['speed_m_s']:.1f} m/s, "]
        lines[-1] += f"the continuum's {reference['continuum_m_s']:.1f} m/s."
    lines += ["", *advice(study, rows), ""]
    return "\n".join(lines)


def _write_csv(rows: Sequence[Row], file: Path) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        names = list(rows[0].errors)
        cost = ["steps", "bars", "time_step_s", "cpu_s", "wall_s", "compile_s", "energy_error"]
        heads = ["against", "modules", "share", "precision", *cost]
        writer.writerow([*heads, *[f"error_{name.replace(' ', '_')}" for name in names]])
        for row in rows:
            p, against = row.point, "finer_step" if row.timed else "reference"
            values = [row.record[key] for key in cost]
            errors = [row.errors[name] for name in names]
            writer.writerow([against, p.modules, row.share, p.precision, *values, *errors])


def figure(study: Study, rows: Sequence[Row], file: Path) -> None:
    """Draw error against seconds, a line a family, and the error of the time step alone."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    name = study.plan.first
    space, in_time = orders(study, rows)[name]
    drawing = plt.figure(figsize=(11, 5), layout="constrained")
    left, right = drawing.subplots(1, 2)
    families = dict.fromkeys((r.point.precision, r.point.share) for r in rows if not r.timed)
    for number, (precision, share) in enumerate(families):
        mine = [
            r
            for r in rows
            if not r.timed and (r.point.precision, r.point.share) == (precision, share)
        ]
        x, y = [r.seconds for r in mine], [r.errors[name] for r in mine]
        style = "-" if precision == "f64" else "--"
        label = f"{precision}, step {share:g} of the critical"
        left.loglog(x, y, style, marker="o", ms=4, color=f"C{number}", label=label)
        if number == 0:
            for row in mine:
                at = (row.seconds, row.errors[name])
                left.annotate(f" {row.point.modules}", at, fontsize=8, va="bottom")
    front = pareto(rows, name)
    left.loglog(
        [r.seconds for r in front],
        [r.errors[name] for r in front],
        color="black",
        lw=5,
        alpha=0.15,
        label="Pareto front",
    )
    for goal in GOALS:
        left.axhline(goal, color="gray", ls=":", lw=1)
    left.set(xlabel="seconds of stepping on one core", ylabel=f"relative error of the {name}")
    left.set_title(
        f"modules through the thickness at the points; order in space {space:.1f}", fontsize=10
    )
    left.legend(fontsize=8)
    timed = sorted((r for r in rows if r.timed), key=lambda r: r.time_step)
    for number, quantity in enumerate(rows[0].errors):
        y = [r.errors[quantity] for r in timed]
        got = orders(study, rows)[quantity][1]
        right.loglog(
            [r.share for r in timed],
            y,
            "o-",
            ms=4,
            color=f"C{number}",
            label=f"{quantity}: order {got:.1f}",
        )
    shares = np.array([timed[0].share, timed[-1].share])
    top = max(timed[-1].errors[name], 1e-16)
    right.loglog(shares, top * (shares / shares[-1]) ** 2, color="black", ls=":", label="order 2")
    right.set(xlabel="time step over the critical one", ylabel="relative error by the time step")
    right.set_title(
        f"the time step alone, {study.plan.timed} modules, f64: order {in_time:.1f}", fontsize=10
    )
    right.legend(fontsize=8)
    for axes in (left, right):
        axes.grid(alpha=0.3, which="both")
    drawing.savefig(file, dpi=130)
    plt.close(drawing)
