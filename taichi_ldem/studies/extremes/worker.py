"""Runs the cases of a group in one process, one after the other.

    python -m taichi_ldem.studies.extremes.worker GROUP FILE NAME ...

FILE gets a line of JSON when a case begins and another when it has ended.
"""

import json
import math
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import tomli_w

from taichi_ldem.errors import SceneError, SimulationStopped, TooManyNodes
from taichi_ldem.studies.extremes.bench import Bench, Result
from taichi_ldem.studies.extremes.case import REFUSED, STABLE, STOPPED, Case, changed
from taichi_ldem.studies.extremes.cases import CASES
from taichi_ldem.studies.extremes.scenes import COMMAND, GROUPS

SAMPLES = 20
"""History rows of a case, at each of which the guard checks the run."""


def follow(bench: Bench, case: Case) -> Result:
    """Run a case on its group's simulation."""
    simulation = bench.simulation
    try:
        bench.reset(changed(bench.base, case.changes))
        _prepare(bench, case)
        for sample in simulation.samples():
            bench.note(sample)
    except SceneError as error:
        bench.result.outcome, bench.result.message = REFUSED, str(error)
    except (SimulationStopped, TooManyNodes) as error:
        bench.result.outcome, bench.result.message = STOPPED, str(error)
    else:
        _judge(bench, case)
    return bench.result


def _prepare(bench: Bench, case: Case) -> None:
    """Set the time step and the state of a case."""
    simulation, result = bench.simulation, bench.result
    if case.share is not None:
        simulation.time_step = case.share * simulation.critical_time_step
        for body in simulation.bodies:
            body.start(bench.scene, simulation.time_step)
    simulation.steps, simulation.sample_every = case.steps, max(1, case.steps // SAMPLES)
    if case.set_up is not None:
        case.set_up(bench)
    result.critical_s = simulation.critical_time_step
    result.share = simulation.time_step / simulation.critical_time_step


def _judge(bench: Bench, case: Case) -> None:
    """Decide how a case ended that took all its steps."""
    result = bench.result
    result.outcome = STABLE
    if not np.isfinite(bench.simulation.displacement()).all() or not math.isfinite(result.drift):
        result.outcome = "not finite"
    elif max(result.drift, result.gained) > case.drift:
        result.outcome = "drifted"
        result.message = f"{100 * result.drift:.2g} % of the energy that the plate has held"
    elif case.check is not None and (wrong := case.check(bench)):
        result.outcome, result.message = "wrong", wrong


def command(case: Case, folder: Path) -> Result:
    """Run a case as a user does, by ``ldem impact`` in a process of its own."""
    file = folder / "scene.toml"
    file.write_text(tomli_w.dumps(changed(COMMAND, case.changes)), encoding="utf-8")
    words = ["impact", str(file), "--out", str(folder / "run"), "--force", "--quiet"]
    done = subprocess.run(
        [sys.executable, "-m", "taichi_ldem.cli", *words], capture_output=True, text=True
    )
    outcome = {0: STABLE, 2: REFUSED, 3: STOPPED}.get(done.returncode, f"exit {done.returncode}")
    errors = [line for line in done.stderr.splitlines() if not line.startswith("warning")]
    return Result(outcome, errors[-1] if errors else "")


def main(group: str, names: list[str], out: Path) -> None:
    """Run the named cases of a group."""
    bench: Bench | None = None
    with out.open("a", encoding="utf-8") as file:
        for case in CASES:
            if case.group != group or case.name not in names:
                continue
            print(json.dumps({"begun": case.name}), file=file, flush=True)
            started = time.perf_counter()
            if group == "commands":
                with tempfile.TemporaryDirectory() as folder:
                    result = command(case, Path(folder))
            else:
                bench = bench or Bench(GROUPS[group])
                result = follow(bench, case)
            result.seconds = time.perf_counter() - started
            print(json.dumps({"name": case.name} | asdict(result)), file=file, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[3:], Path(sys.argv[2]))
