"""Records of a scene's runs, and their errors against the reference."""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.interrupts import run_child
from taichi_ldem.scenarios.wave import delay
from taichi_ldem.scene import Scene
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.place import refuse_moved
from taichi_ldem.storage.provenance import scene_hash
from taichi_ldem.studies.convergence.plan import FINE_STEP, SHARES, SINGLE, STEPS, Plan, Point
from taichi_ldem.studies.convergence.run import VIBRATION, WAVE


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


class Study:
    """A scene's runs and the folder that holds their records.

    Attributes:
        file: the scene file. scene: as read from it. what: its kind (see ``run.kind``).
        out: folder of the records. plan: settings of the runs.
    """

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
        """Reserve the folder for this scene.

        Args:
            force: remove the records that the study of another scene lists as its own.

        Raises:
            SceneError: the folder holds the runs of another scene, or records that none lists.
        """
        self.out.mkdir(parents=True, exist_ok=True)
        mark, own = self.out / "scene_sha256", scene_hash(self.scene)
        listed = mark.read_text(encoding="utf-8").splitlines() if mark.exists() else [own]
        if listed[:1] != [own]:
            if not force:
                raise SceneError(f"'{self.out}' holds a study of another scene; --force removes it")
            for name in listed[1:]:
                (self.out / Path(name).name).unlink(missing_ok=True)
            listed = [own]
            others = [*self.out.glob("*.json"), *self.out.glob("mode_*.npz")]
            if others:
                raise SceneError(f"'{others[0]}' is no record of this study; move it")
        self._list(listed)

    def _list(self, lines: Sequence[str]) -> None:
        write_whole(self.out / "scene_sha256", "\n".join(lines).encode())

    def _own(self, *files: Path) -> None:
        """List files as this study's own, before they are written."""
        lines = (self.out / "scene_sha256").read_text(encoding="utf-8").splitlines()
        self._list(list(dict.fromkeys([*lines, *(file.name for file in files)])))

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
        """The record that all others are compared with."""
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
            self._own(file, *(Path(word) for word in more if word.endswith(".npz")))
            arguments = [word for text in settings for word in ("--set", text)]
            module = "taichi_ldem.studies.convergence.run"
            command = [sys.executable, "-m", module, str(self.file), str(file), *arguments, *more]
            if code := run_child(command):
                raise SceneError(f"{name}: its run ended with exit code {code}")
            refuse_moved(self.out)
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found

    def rows(self) -> list[Row]:
        """Every point against the reference, then the order in time."""
        reference = self.reference()
        rows = [self._row(point, reference) for point in self.points()]
        fine = self.record(self._fine())
        if "flight_s" in reference:  # a lattice's own record has arrival times only
            fine = {**fine, "flight_s": reference["flight_s"]}
        return rows + [self._row(point, fine, timed=True) for point in self.steps()]

    def _row(self, point: Point, reference: dict[str, Any], timed: bool = False) -> Row:
        record = self.record(point)
        seconds = float(record["cpu_s"])
        errors = differences(record, reference)
        return Row(point, errors, seconds, record["share"], record["time_step_s"], record, timed)


def differences(record: dict[str, Any], reference: dict[str, Any]) -> dict[str, float]:
    """Relative errors by quantity: of numbers, and in the mean square of histories.

    For a wave, the error of its speed too: its delay over the time of flight of the exact wave.
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
        exact = np.array(reference["signals"][name])[: len(time_s)]
        computed = CubicSpline(record["time"], values)(time_s)
        errors[name] = float(np.linalg.norm(computed - exact) / np.linalg.norm(exact))
        if "flight_s" in reference:
            late = delay(time_s, np.column_stack([exact, computed]))
            errors["speed"] = abs(late) / (reference["flight_s"] + late)
    return errors


def extrapolated(sizes: Sequence[float], values: Sequence[float], degree: int) -> float:
    """The value at size zero of the polynomial through (or nearest to) values at some sizes."""
    return float(np.polyfit(sizes, values, degree)[-1])
