"""The guard: it stops a run that has become invalid, with the place and the likely cause."""

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.errors import SimulationStopped
from taichi_ldem.solver import stability
from taichi_ldem.solver.energy import Ledger

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation

WARN_ERROR, STOP_ERROR = 0.01, 0.05
"""Energy errors at which a run warns and stops."""

STOP_ERROR_OF_PLATE = 0.1
"""Imbalance over the energy of the plate at which a run stops. STOP_ERROR alone would miss it where
a heavy striker dominates the energy. Valid runs stay below 0.03."""

LEAST_SHARE = 1e-10
"""Share of all energy that the plate must have before its imbalance is checked."""

COARSEST = 1e-3
"""Largest rounding error of displacements over the largest elongation: rounding in every step heats
the lattice."""

EXTREME_TENSION, EXTREME_COMPRESSION = 0.2, -0.5
"""Strains beyond which the message of a stopped run names them: those of a bar that should have
broken long before, and of a bar that is about to pass through zero length."""


def check(simulation: "Simulation", sample: "Sample") -> None:
    """Stop at the first NaN, at too large an imbalance, or where contact creates energy.

    Raises:
        SimulationStopped: with time, step, place and likely cause.
    """
    ledger, start = sample.ledger, simulation.initial_ledger
    assert start is not None
    # 0: half a step before it starts from rest, a falling plate moves up, and 1/2 v M v is below 0
    held = max(ledger.held_by_plate, LEAST_SHARE * (start.stored + abs(ledger.external)), 0.0)
    imbalance = abs(ledger.imbalance(start))
    if not np.isfinite(ledger.stored):
        what = "the energies are not finite"
    elif sample.energy_error > STOP_ERROR:
        what = f"the energy error reached {100 * sample.energy_error:.3g} %"
    elif imbalance > STOP_ERROR_OF_PLATE * held:
        what = f"the energy error reached {100 * imbalance / held:.3g} % of what the plate holds"
    elif gained_in_contact(ledger, start) > STOP_ERROR_OF_PLATE:
        what = f"contact gave the plate {-ledger.contact:.3g} J"
    else:
        return
    raise stopped(simulation, sample.step, what, ledger)


def gained_in_contact(ledger: Ledger, start: Ledger | None) -> float:
    """Energy created by contact over the initial energy or that of the plate.

    Contact should only dissipate energy.

    Args:
        start: the run's first ledger.
    """
    if start is ledger or start is None:
        return 0.0  # half of the first step's works are still missing
    given = start.stored - ledger.kinetic_bodies + ledger.external
    # before the first contact there are only rounding errors of nodes that press on a ring
    least = LEAST_SHARE * start.stored
    scale = max(ledger.held_by_plate, abs(given), least)
    return -ledger.contact / scale if scale > 0 else 0.0


def stopped(
    simulation: "Simulation", step: int, what: str, ledger: Ledger | None = None
) -> SimulationStopped:
    """The error with the event, its place and the most likely cause."""
    return SimulationStopped(
        f"t = {step * simulation.time_step:.6g} s, step {step}: {what}, fastest "
        f"{fastest_node(simulation)}; likely cause: {likely_cause(simulation, ledger)}"
    )


def likely_cause(simulation: "Simulation", ledger: Ledger | None) -> str:
    """The most likely cause of an imbalance, in words."""
    step, critical = simulation.time_step, simulation.critical_time_step
    if step > critical:
        return f"the time step {step:.3g} s is above the critical one, {critical:.3g} s"
    if ledger is not None:
        gained = gained_in_contact(ledger, simulation.initial_ledger)
        if gained > STOP_ERROR_OF_PLATE:
            return (
                "contact gave energy: a rigid body lay inside the plate, or is so sharp that nodes "
                "go round it within a step"
            )
    dynamics = simulation.dynamics
    displacement = simulation.displacement_before()
    longest, shortest = stability.largest_strains(dynamics, displacement)
    largest = np.abs(displacement).max()
    digits = float(np.finfo(dynamics.numpy_float()).eps) * largest
    if digits > COARSEST * max(longest, -shortest) * simulation.spacing:
        return (
            f"displacements of {largest:.3g} m have a rounding error of {digits:.1g} m, too "
            f'large for strains of {max(longest, -shortest):.1g}; use solver.precision = "f64"'
        )
    if longest < EXTREME_TENSION and shortest > EXTREME_COMPRESSION:
        return "a collision too fast for the time step; try a smaller solver.safety"
    bars = f"bars are at {1 + shortest:.3g} to {1 + longest:.3g} of their length"
    if step > stability.STRETCHED * critical:
        return (
            f"{bars}: stretched bars lower the critical time step; try solver.safety <= "
            f"{stability.STRETCHED:.2f}"
        )
    return f"{bars}: a bar near zero length turns round within a step; strike more slowly"


def fastest_node(simulation: "Simulation") -> str:
    """Place of the first node whose velocity is not finite, or else of the fastest, in words."""
    dynamics = simulation.dynamics
    speed = np.linalg.norm(dynamics.get_velocity(), axis=-1)
    bad = ~np.isfinite(speed)
    index = np.argmax(bad) if bad.any() else np.argmax(speed)
    place = np.unravel_index(index, speed.shape)
    x, y, z = dynamics.lattice.positions()[place] * 1e3
    kind = "centre" if place[0] else "corner"
    return f"at {kind} node x = {x:.2f}, y = {y:.2f}, z = {z:.2f} mm ({speed[place]:.3g} m/s)"
