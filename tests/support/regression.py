"""Small reference runs: an intended change of results is told from an accident.

    python tests/support/regression.py           # compare with tests/reference/
    python tests/support/regression.py --update  # after an intended change, with a changelog entry
    python tests/support/regression.py --add     # the bits of this machine, next to those stored

Stored are the SHA-256 of all rows to the last bit, which holds for one kind of CPU, one version of
Taichi and one precision, and the rows themselves, which hold elsewhere: up to the first softening
bar to 1e-10 (1e-4 in f32) of each column's largest value, afterwards within a band, for cracking
amplifies every rounding error.
"""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parents[1]
REFERENCE = HERE / "reference"
AS_USERS_DO = {"TI_ADVANCED_OPTIMIZATION": "1"}
"""The setting of Taichi that `conftest` changes for the tests, as it is without it."""
TOLERANCE = {"f64": 1e-10, "f32": 1e-4}
BAND = 0.1
"""Of each column's largest value, after the first bar has softened."""
SUMMED = ("force",)
"""Columns that a crack makes jump from row to row: compared by their running sums."""

CLAMP = {"inner_diameter": 4.2e-3, "outer_diameter": 5.8e-3}
STRIKER = {"diameter": 2e-3, "mass": 4e-3, "velocity": 4.5}
FIRM = {"damage": True, "fracture_energy": 1034.0, "failure_strain": 0.0175}
SCENES: dict[str, dict[str, Any]] = {
    "cracking-f64": {
        "material": FIRM,
        "striker": STRIKER,
        "clamp": {"kind": "rings"} | CLAMP,
        "solver": {"duration": 1e-4},
    },
    "exponential-notch-f64": {
        "material": FIRM | {"law": "exponential"},
        "striker": STRIKER | {"gravity": 9.81, "gap": 1e-5},
        "clamp": {"kind": "bonded"} | CLAMP,
        "solver": {"duration": 1e-4, "damping": 1e3},
        "notch": [{"normal": "x", "position": 5e-4, "from": [-1e-3, 0], "to": [1e-3, 1e-3]}],
    },
    "elastic-f64": {
        "striker": STRIKER,
        "clamp": {"kind": "rim"} | CLAMP,
        "solver": {"duration": 1e-4},
    },
    "everything-f64": {
        "plate": {"gravity": [0.0, 0.0, -1e3]},
        "material": FIRM | {"poisson_ratio": 0.36, "fracture": "crack", "after_failure": "closing"},
        "disorder": {"youngs_modulus_cv": 0.05, "density_cv": 0.05, "seed": 1},
        "striker": STRIKER | {"friction": 0.2},
        "clamp": {"kind": "rings", "friction": 0.3} | CLAMP,
        "floor": {"gap": 1e-4, "friction": 0.4},
        "contact": {"fragments": True, "friction": 0.3},
        "solver": {"duration": 1e-4},
    },
    "cracking-f32": {
        "material": FIRM,
        "striker": STRIKER,
        "clamp": {"kind": "rings"} | CLAMP,
        "solver": {"duration": 1e-4, "precision": "f32"},
    },
}
ONLY_AS_USERS_DO = {"everything-f64"}
"""Scenes that are not run as the tests compile them, for the time that their kernels take."""

COLUMNS = ("displacement", "velocity", "force", "broken", "kinetic", "strain", "fracture")


def compute(names: list[str]) -> dict[str, list[list[float]]]:
    """Rows of some scenes of one precision, in this process: ``COLUMNS`` each."""
    from support.blocks import block_scene

    from taichi_ldem.solver import backend

    scenes = {
        name: block_scene(12, 12, 3, output={"history_interval": 2e-6}, **SCENES[name])
        for name in names
    }
    backend.start(next(iter(scenes.values())).solver)
    from taichi_ldem.solver.simulation import Simulation

    return {
        name: [
            [
                float(value)
                for value in (
                    s.observed["striker_displacement_m"],
                    s.observed["striker_velocity_m_s"],
                    s.observed["striker_force_n"] or 0.0,  # a zero has no sign
                    s.broken_bars,
                    s.ledger.kinetic_plate,
                    s.ledger.strain,
                    s.ledger.fracture,
                )
            ]
            for s in Simulation(scene).samples()
        ]
        for name, scene in scenes.items()
    }


def all_runs(as_users_do: bool = True) -> dict[str, dict[str, Any]]:
    """Every reference run as it comes out here, one process for each precision.

    Args:
        as_users_do: compile with all of Taichi's passes, also where the tests leave one out.
    """
    results: dict[str, dict[str, Any]] = {}
    environment = os.environ | (AS_USERS_DO if as_users_do else {})
    for precision in ("f64", "f32"):
        left_out = set() if as_users_do else ONLY_AS_USERS_DO
        names = [n for n in SCENES if n.endswith(precision) and n not in left_out]
        command = [sys.executable, "-m", "support.regression", "--compute", *names]
        done = subprocess.run(command, capture_output=True, text=True, cwd=HERE, env=environment)
        if done.returncode:
            raise RuntimeError(done.stderr[-2000:])
        for name, rows in json.loads(done.stdout).items():
            results[name] = {"made_with": kind(), "sha256": digest(rows), "rows": rows}
    return results


def digest(rows: list[list[float]]) -> str:
    """SHA-256 of all values, to the last bit."""
    return hashlib.sha256(np.array(rows, dtype="<f8").tobytes()).hexdigest()


def kind() -> dict[str, str | None]:
    """What the bits depend on."""
    from taichi_ldem.machine import processor_name
    from taichi_ldem.solver.processor import vector_bytes
    from taichi_ldem.storage.provenance import _version

    width = str(vector_bytes())
    return {"cpu": processor_name(), "vector_bytes": width, "taichi": _version("taichi")}


def stored(name: str) -> dict[str, Any]:
    """A reference run from its file."""
    result: dict[str, Any] = json.loads((REFERENCE / f"{name}.json").read_text())
    return result


def known_digest(reference: dict[str, Any], made_with: dict[str, str | None]) -> str | None:
    """The digest that a reference run has on a kind of machine; None on one not seen yet."""
    for known in (reference, *reference.get("elsewhere", ())):
        if known["made_with"] == made_with:
            return str(known["sha256"])
    return None


def deviations(name: str, mine: dict[str, Any], reference: dict[str, Any]) -> list[str]:
    """Where a run leaves its reference's tolerances, a line each."""
    one, two = np.array(mine["rows"]), np.array(reference["rows"])
    if one.shape != two.shape:
        return [f"{name}: {one.shape} values, {two.shape} in the reference"]
    softening = np.flatnonzero(two[:, COLUMNS.index("fracture")] > 0)
    whole = int(softening[0]) if len(softening) else len(two)
    found = []
    for n, column in enumerate(COLUMNS):
        a, b = one[:, n], two[:, n]
        before, after = slice(0, whole), slice(whole, None)
        exact = TOLERANCE[name[-3:]] * max(np.abs(b[before]).max(initial=0.0), 1e-300)
        if np.abs(a[before] - b[before]).max(initial=0.0) > exact:
            found.append(f"{name}: {column} differs before any bar has softened")
        if column in SUMMED:
            a, b = np.cumsum(a), np.cumsum(b)
        band = BAND * max(np.abs(b).max(), 1e-300)
        if np.abs(a[after] - b[after]).max(initial=0.0) > band:
            found.append(f"{name}: {column} leaves its band after softening")
    return found


def _text(run: dict[str, Any]) -> str:
    return json.dumps(run, indent=None).replace("], [", "],\n[") + "\n"


def main() -> int:
    """Compare with the stored runs, replace them, or add this machine's bits."""
    if "--compute" in sys.argv:
        print(json.dumps(compute(sys.argv[sys.argv.index("--compute") + 1 :])))
        return 0
    code = 0
    for name, run in all_runs().items():
        path = REFERENCE / f"{name}.json"
        if "--update" in sys.argv:
            path.write_text(_text(run))
            print(f"wrote {path}")
            continue
        reference = stored(name)
        lines = deviations(name, run, reference)
        same = run["sha256"] == known_digest(reference, run["made_with"])
        if "--add" in sys.argv and not lines and not known_digest(reference, run["made_with"]):
            mine = {"made_with": run["made_with"], "sha256": run["sha256"]}
            reference["elsewhere"] = [*reference.get("elsewhere", ()), mine]
            path.write_text(_text(reference))
            print(f"added to {path}")
        print(f"{name}: {'same bits' if same else 'other bits'}", *lines, sep="\n  ")
        code |= bool(lines)
    return code


if __name__ == "__main__":
    sys.exit(main())
