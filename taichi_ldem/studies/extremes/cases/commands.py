"""Scenes that are run as a user runs them, most of which are refused."""

from typing import Any

from taichi_ldem.studies.extremes.case import ABOVE_CRITICAL, LINEAR, REFUSED, STOPPED, Case


def refused(name: str, because: str, says: str, changes: dict[str, Any]) -> Case:
    """A scene that the command refuses."""
    return Case(name, "commands", REFUSED, because, changes, says=says)


CASES = (
    refused(
        "nu = 0",
        "no diagonal stiffness: a mechanism",
        "mechanism",
        {"material.poisson_ratio": 0.0, "plate.stiffness": "equation-2"},
    ),
    refused(
        "nu = 0.5",
        "incompressible: infinite EA_d",
        "poisson_ratio.*0.5",
        {"material.poisson_ratio": 0.5},
    ),
    refused(
        "E = 0",
        "no stiffness",
        "youngs_modulus.*greater than 0",
        {"material.youngs_modulus": 0.0},
    ),
    refused(
        "K_r < 1",
        "Eq. (12): a bar cannot dissipate G_f A_f",
        "K_r",
        {"material.fracture_energy": 100.0},
    ),
    refused(
        "a striker that starts inside, as a scene",
        "gap >= 0",
        "striker.gap",
        {"striker.gap": -1e-3},
    ),
    refused(
        "a striker that misses, as a scene",
        "must be over the plate",
        "over the plate",
        {"striker.position": [0.1, 0.0]},
    ),
    refused(
        "a clamp narrower than a module",
        "it holds the nodes that happen to lie there",
        "a narrower one holds only",
        {"clamp.inner_diameter": 7.59e-3, "clamp.outer_diameter": 7.592e-3},
    ),
    refused("time step above the critical one", "unstable", "critical", {"solver.time_step": 5e-7}),
    Case(
        "the same, allowed",
        "commands",
        STOPPED,
        LINEAR,
        {"solver.time_step": 5e-7, "solver.allow_unstable": True},
        says=ABOVE_CRITICAL,
    ),
)
