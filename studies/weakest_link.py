"""Do pulled specimens have the strength of the tensile test, whatever their volume and the module?

    python -m studies.weakest_link --out FOLDER [--seeds 40] [--lattice cubic-26]

Square bars of three lengths and two module sizes are pulled until they break, with
``disorder.strength_cv`` and ``reference_volume``. Their mean strength and its scatter, with 95 %
intervals, stand beside Weibull's closed form for the volume between the grips,

    mean(V) = sigma (V_ref / V)^(1 / m),    CV(V) = CV.

The pull begins so gently that hardly a wave is in a bar. Its strength is E times its mean strain
when its strain energy is largest. That at which the first bar of the lattice fails stands beside
it. A line is added to FOLDER/strengths.jsonl for every specimen, and a study continues.
"""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.size_effect import deviation_interval
from taichi_ldem.ensemble.results import statistics
from taichi_ldem.scene import Scene, parse_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

SIGMA, CV, VOLUME = 75e6, 0.15, 97e-9
"""Mean strength (Pa), CV and stressed volume (m3) of the tensile specimens."""
WIDTH = 2.4e-3
LENGTHS = (6.4e-3, 24e-3, 96e-3)
MODULES = (3, 6)
MODULUS, POISSON, DENSITY = 3.35e9, 0.25, 1190.0
RATE = 40.0
"""Strain rate, 1/s: waves cross the longest bar fourteen times before it has 3 % of strain."""
RAMP = 3e-4
"""Time in which the pull begins, s: five transits of waves through the longest bar."""
FALLEN = 0.9
"""Share of the largest strain energy below which a specimen is broken."""


def scene(length: float, modules: int, seed: int, lattice: str) -> Scene:
    """A bar of a length between its grips."""
    edge = WIDTH / modules
    grip = 1.2 * edge
    whole = length + 2 * edge
    return parse_scene(
        {
            "scenario": "tension",
            "plate": {
                "size": [whole, WIDTH, WIDTH],
                "modules_through_thickness": modules,
                "lattice": lattice,
            },
            "material": {
                "youngs_modulus": MODULUS,
                "poisson_ratio": POISSON,
                "density": DENSITY,
                "fracture_energy": 1034.0,
                "failure_strain": SIGMA / MODULUS,
                "fracture": "crack",
            },
            "disorder": {"strength_cv": CV, "reference_volume": VOLUME, "seed": seed},
            "grips": {
                "velocity": RATE * length,
                "length": grip,
                "ramp": RAMP,
                "lateral": "free",
            },
            "solver": {"duration": RAMP + 0.1 / RATE, "precision": "f32", "safety": 0.8},
            "output": {"history_interval": 5e-7, "field_interval": 0},
        }
    )


def pulled(simulation: "Simulation", length: float) -> dict[str, Any]:
    """Pull a bar until it breaks.

    Returns:
        E times the mean strain when the first bar fails and when the strain energy is largest, Pa;
        largest imbalance of energy over what the plate held.
    """
    first, most, error = None, 0.0, 0.0
    strength = 0.0
    for sample in simulation.samples():
        error = max(error, sample.energy_error_of_plate)
        stress = MODULUS * sample.observed["grip_displacement_m"] / length
        if first is None and sample.broken_bars:
            first = stress
        if sample.ledger.strain > most:
            most, strength = sample.ledger.strain, stress
        if sample.ledger.strain < FALLEN * most:
            break
    return {"first": first, "strength": strength, "energy_error": error}


def measure(out: Path, seeds: int, lattice: str) -> list[dict[str, Any]]:
    """All specimens; those in the file are not pulled again."""
    from taichi_ldem.solver import backend

    out.mkdir(parents=True, exist_ok=True)
    file = out / "strengths.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {(row["length"], row["modules"], row["seed"]) for row in rows}
    backend.start(scene(LENGTHS[0], MODULES[0], 1, lattice).solver)
    from taichi_ldem.solver.simulation import Simulation

    for modules in MODULES:
        for length in LENGTHS:
            simulation = None
            for seed in range(1, seeds + 1):
                if (length, modules, seed) in done:
                    continue
                bar = scene(length, modules, seed, lattice)
                if simulation is None:
                    simulation = Simulation(bar)
                else:
                    simulation.reset(bar)
                row = {"length": length, "modules": modules, "seed": seed}
                row |= pulled(simulation, length)
                rows.append(row)
                with file.open("a") as lines:
                    lines.write(json.dumps(row) + "\n")
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Means and scatters beside the closed form, in Markdown."""
    from taichi_ldem.model.disorder import shape_from_cv

    shape = shape_from_cv(CV)
    lines = [
        "| volume [mm3] | L [mm] | specimens | first bar [MPa] | strength [MPa] "
        "| closed form [MPa] | CV of the strength [%] | closed form [%] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for length in LENGTHS:
        volume = WIDTH**2 * length
        expected = SIGMA * (VOLUME / volume) ** (1 / shape)
        for modules in MODULES:
            mine = [r for r in rows if (r["length"], r["modules"]) == (length, modules)]
            first, found = (statistics([r[k] for r in mine]) for k in ("first", "strength"))
            if first is None or found is None or found.standard_deviation is None:
                continue
            low, high = deviation_interval(found.standard_deviation, found.count)
            cv = [100 * s / found.mean for s in (found.standard_deviation, low, high)]
            means = (
                f"{1e-6 * f.mean:.1f} ± {1e-6 * (f.half_interval or 0):.1f}" for f in (first, found)
            )
            lines.append(
                f"| {1e9 * volume:.0f} | {1e3 * WIDTH / modules:.2f} | {found.count} "
                f"| {' | '.join(means)} | {1e-6 * expected:.1f} "
                f"| {cv[0]:.1f} ({cv[1]:.1f} to {cv[2]:.1f}) | {100 * CV:.0f} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--lattice", default="module")
    options = parser.parse_args()
    rows = measure(options.out, options.seeds, options.lattice)
    text = table(rows)
    (options.out / "weakest_link.md").write_text(text + "\n")
    print(text)
    print(f"Largest imbalance of energy: {100 * max(r['energy_error'] for r in rows):.2f} %")


if __name__ == "__main__":
    main()
