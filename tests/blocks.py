"""Small scenes for the tests, and a way to start one again without compiling it again."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.scene import Scene, parse_scene

if TYPE_CHECKING:
    from taichi_ldem.simulation import Simulation

SPACING = 0.5e-3
PMMA = {"youngs_modulus": 3.35e9, "poisson_ratio": 0.25, "density": 1190.0, "damage": False}
DAMAGE = {"damage": True, "fracture_energy": 1034.0, "failure_strain": 0.0175}


def block_scene(
    nx: int, ny: int, nz: int, *, spacing: float = SPACING, **tables: dict[str, Any] | list[Any]
) -> Scene:
    """A prism of nx x ny x nz modules, elastic PMMA unless the tables say more."""
    data: dict[str, Any] = {
        "scenario": "impact",
        "plate": {
            "size": [nx * spacing, ny * spacing, nz * spacing],
            "modules_through_thickness": nz,
        },
        "material": PMMA,
        "solver": {"duration": 1e-3},
    }
    for name, table in tables.items():
        data[name] = data.get(name, {}) | table if isinstance(table, dict) else table
    return parse_scene(data)


def restart(simulation: "Simulation") -> "Simulation":
    """Put a plate back to its first step, at rest and whole (a striker stays where it is)."""
    dynamics = simulation.dynamics
    for name in ("displacement", "velocity", "axial", "peak", "touched", "recorded", "damped"):
        if hasattr(dynamics, name):
            getattr(dynamics, name).fill(0)
    simulation.now = simulation.step_number = 0
    simulation._start = simulation._last = None
    return simulation


def smooth_velocity(places: np.ndarray, speed: float) -> np.ndarray:
    """(nodes, 3) a velocity field that stretches, shears and bends a block, without a jump."""
    span = np.ptp(places, axis=0)
    x, y, z = (np.pi * (places - places.min(axis=0)) / span).T
    return speed * np.stack([np.cos(x), np.cos(x) * np.sin(y), np.cos(x + z)], axis=1)
