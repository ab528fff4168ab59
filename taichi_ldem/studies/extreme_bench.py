"""Where the cases of ``extremes`` run: one simulation a process, renewed for every case.

python -m taichi_ldem.studies.extreme_bench GROUP FILE NAME ...
"""

import json
import math
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import tomli_w

from taichi_ldem.errors import SceneError
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import parse_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample

Array = npt.NDArray[np.float64]

STABLE, REFUSED, STOPPED = "stable", "refused", "stopped"

SPACING = 0.5e-3
SAMPLES = 20
"""Looks at a case: each is a history row, at which the guard decides."""


@dataclass(frozen=True)
class Case:
    """A stiff or extreme case.

    Attributes:
        name: short, unique. group: the simulation that it runs on, or "commands".
        predicted: STABLE, REFUSED or STOPPED. because: the theory behind that.
        changes: keys of the group's scene, "table.key" -> value.
        says: what the message of a refusal or of the guard must contain (a regular expression).
        set_up: changes the state or the arrays before the first step.
        check: looks at the end; returns what is wrong, or nothing.
        share: time step over the critical one; None: the scene's own choice.
        steps: taken at most. drift: largest energy error of a stable case, of all that the plate
            has held.
        quick: also in the small form.
    """

    name: str
    group: str
    predicted: str
    because: str
    changes: dict[str, Any] = field(default_factory=dict)
    says: str = ""
    set_up: "Callable[[Bench], None] | None" = None
    check: "Callable[[Bench], str] | None" = None
    share: float | None = 0.5
    steps: int = 2000
    drift: float = 0.01
    quick: bool = False


@dataclass
class Seen:
    """What became of a case.

    Attributes:
        outcome: STABLE, REFUSED, STOPPED, or what must not be: "drifted", "not finite", "wrong".
        drift: largest imbalance over the most that the plate has held, beside what the run's own
            guard looks at (``error``).
        gained: most that contact has given instead of taken, over all that there was.
        strain: largest of a bar that is not broken; compression: largest shortening.
    """

    outcome: str = ""
    message: str = ""
    steps: int = 0
    share: float = math.nan
    critical_s: float = math.nan
    drift: float = math.nan
    error: float = math.nan
    strain: float = math.nan
    compression: float = math.nan
    gained: float = 0.0
    broken: int = 0
    seconds: float = math.nan

    def agrees(self, case: Case) -> bool:
        """Whether it is what was predicted."""
        said = re.search(case.says, self.message) is not None
        return self.outcome == case.predicted and (said or case.predicted == STABLE)


def changed(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Tables of a scene with other values at some keys "table.key"."""
    data: dict[str, Any] = {k: dict(v) if isinstance(v, dict) else v for k, v in base.items()}
    for path, value in changes.items():
        table, key = path.split(".")
        data.setdefault(table, {})[key] = value
    return data


class Bench:
    """A group's simulation and what cases do to it.

    Attributes:
        simulation: None until the first case. case, scene: the present ones.
        kept: what ``set_up`` leaves for ``check``.
    """

    def __init__(self, base: dict[str, Any]):
        from taichi_ldem.solver import backend

        self.base = base
        self.scene = parse_scene(base)
        backend.start(self.scene.solver)
        from taichi_ldem.solver.simulation import Simulation

        self.simulation = Simulation(self.scene)
        self.whole: Lattice = self.simulation.dynamics.lattice
        self.kept: dict[str, Any] = {}
        self.held = 0.0
        self.seen = Seen()

    def run(self, case: Case) -> Seen:
        """Renew the simulation for a case and follow it."""
        from taichi_ldem.errors import SimulationStopped, TooManyNodes

        self.seen, self.kept, s = Seen(), {}, self.simulation
        seen, self.held = self.seen, 0.0
        try:
            self.scene = parse_scene(changed(self.base, case.changes))
            s.reset(self.scene, self.whole)
            if case.share is not None:
                s.time_step = case.share * s.critical_time_step
                for body in s.bodies:
                    body.start(self.scene, s.time_step)
            s.steps, s.sample_every = case.steps, max(1, case.steps // SAMPLES)
            if case.set_up is not None:
                case.set_up(self)
            seen.share, seen.critical_s = s.time_step / s.critical_time_step, s.critical_time_step
            for sample in s.samples():
                self._note(sample)
        except SceneError as error:
            seen.outcome, seen.message = REFUSED, str(error)
            return seen
        except (SimulationStopped, TooManyNodes) as error:
            seen.outcome, seen.message = STOPPED, str(error)
            return seen
        seen.outcome = STABLE
        if not np.isfinite(s.displacement()).all() or not math.isfinite(seen.drift):
            seen.outcome = "not finite"
        elif max(seen.drift, seen.gained) > case.drift:
            seen.outcome, seen.message = "drifted", f"{100 * seen.drift:.2g} % of what it has held"
        elif case.check is not None and (wrong := case.check(self)):
            seen.outcome, seen.message = "wrong", wrong
        return seen

    def _note(self, sample: "Sample") -> None:
        from taichi_ldem.solver.guard import gained_in_contact

        seen, ledger, start = self.seen, sample.ledger, self.simulation.initial_ledger
        assert start is not None
        plate = ledger.kinetic_plate + ledger.strain + ledger.fracture + ledger.damping
        self.held = max(self.held, plate + abs(ledger.contact))
        drift = abs(ledger.imbalance(start)) / self.held if self.held > 0 else 0.0
        longest, shortest = self.strains()
        for name, value in (
            ("drift", drift),
            ("error", sample.energy_error),
            ("gained", gained_in_contact(ledger, start)),
            ("strain", longest),
            ("compression", -shortest),
        ):
            # a NaN stays: max() would drop it or not, depending on the order
            old = getattr(seen, name)
            setattr(seen, name, value if not old >= value else old)
        seen.steps, seen.broken = sample.step, sample.broken_bars

    # -- what cases use

    @property
    def lattice(self) -> Lattice:
        """The present body."""
        return self.simulation.dynamics.lattice

    @property
    def exists(self) -> npt.NDArray[np.bool_]:
        """(2, *S, 1) True where a node exists."""
        return self.lattice.exists()[..., None]

    @property
    def places(self) -> Array:
        """(2, *S, 3) positions at rest from the middle of the body, m."""
        place = self.lattice.positions()
        at = self.lattice.exists()
        middle = 0.5 * (place[at].min(axis=0) + place[at].max(axis=0))
        return np.asarray((place - middle) * at[..., None])

    @property
    def masses(self) -> Array:
        """(2, *S, 1) of the nodes, kg."""
        return np.asarray(self.simulation.dynamics.masses()[..., None])

    def start(self, displacement: Array | float = 0.0, velocity: Array | float = 0.0) -> None:
        """Set the state at t = 0."""
        rest = np.zeros((2, *self.simulation.dynamics.sites, 3))
        self.simulation.start_from(
            (rest + displacement) * self.exists, (rest + velocity) * self.exists
        )

    def noise(self, size: float, seed: int = 1) -> Array:
        """(2, *S, 3) independent normal numbers."""
        shape = (2, *self.simulation.dynamics.sites, 3)
        return np.random.default_rng(seed).normal(0.0, size, shape)

    def shake(self, speed: float) -> None:
        """Noise in every node's velocity: every mode of the body is in it."""
        self.start(velocity=self.noise(speed))

    def strains(self) -> tuple[float, float]:
        """Largest and smallest strain of the bars that exist and are not broken, one step back."""
        from taichi_ldem.solver.stability import largest_strains

        s = self.simulation
        return largest_strains(s.dynamics, s.displacement_before())

    def momentum(self) -> Array:
        """(2, 3) momentum (kg m/s) and angular momentum (kg m2/s), both conserved exactly."""
        s = self.simulation
        velocity = self.masses * s.dynamics.get_velocity()
        where = (self.places + s.displacement()) * self.exists
        return np.stack(
            [velocity.sum(axis=(0, 1, 2, 3)), np.cross(where, velocity).sum((0, 1, 2, 3))]
        )


def command(case: Case, folder: Path) -> Seen:
    """Run a case as a user does, ``ldem impact``, in a process of its own."""
    from taichi_ldem.studies.extreme_cases import COMMAND

    scene = changed(COMMAND, case.changes)
    file = folder / "scene.toml"
    file.write_text(tomli_w.dumps(scene), encoding="utf-8")
    words = ["impact", str(file), "--out", str(folder / "run"), "--force", "--quiet"]
    done = subprocess.run(
        [sys.executable, "-m", "taichi_ldem.cli", *words], capture_output=True, text=True
    )
    outcome = {0: STABLE, 2: REFUSED, 3: STOPPED}.get(done.returncode, f"exit {done.returncode}")
    told = [line for line in done.stderr.splitlines() if not line.startswith("warning")]
    return Seen(outcome, told[-1] if told else "")


def main(group: str, names: list[str], out: Path) -> None:
    """Run cases of a group one after the other; each is announced, then told as a line of JSON."""
    from taichi_ldem.studies.extreme_cases import CASES, GROUPS

    bench: Bench | None = None
    with out.open("a", encoding="utf-8") as file:
        for case in CASES:
            if case.group != group or case.name not in names:
                continue
            print(json.dumps({"begun": case.name}), file=file, flush=True)
            started = time.perf_counter()
            if group == "commands":
                with tempfile.TemporaryDirectory() as folder:
                    seen = command(case, Path(folder))
            else:
                bench = bench or Bench(GROUPS[group])
                seen = bench.run(case)
            seen.seconds = time.perf_counter() - started
            print(json.dumps({"name": case.name} | asdict(seen)), file=file, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[3:], Path(sys.argv[2]))
