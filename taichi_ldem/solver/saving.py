"""The state of a simulation between two steps, which a checkpoint holds."""

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.solver.energy import Ledger
from taichi_ldem.solver.stability import chosen_time_step

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

OF_ANY_LENGTH = (
    "nodes",
    "before",
    "start",
    "last",
    "ends",
    "pairs",
    "home",
    "loose",
    "shown",
    "joins",
    "rest",
    "friction",
    "works",
    "impulses",
)
"""Fields whose arrays need not be as long as those of another time."""

BEFORE_PIECES = 7
"""Energies of a ledger in checkpoints that were made before pieces could touch; the terms that came
later stand behind them, and are zero in a checkpoint without them."""

Saved = Mapping[str, npt.NDArray]
"""Arrays by names ``part/field``."""


def _parts(simulation: "Simulation") -> dict[str, Any]:
    """The parts that have a state of their own, by name."""
    parts: dict[str, Any] = {"dynamics": simulation.dynamics} | {
        body.name: body for body in simulation.bodies
    }
    for part in (simulation.openings if simulation.openings.times else None, simulation.fragments):
        parts |= {} if part is None else {part.name: part}
    return parts


def saved_state(simulation: "Simulation") -> dict[str, npt.NDArray]:
    """The state from which the next step starts: arrays by names ``part/field``.

    The critical time step is included, as it may differ between machines by rounding; the time step
    follows from it and the scene.
    """
    start = (
        [] if simulation.initial_ledger is None else list(vars(simulation.initial_ledger).values())
    )
    saved = {
        "clock/step_number": np.array(simulation.step_number),
        "clock/now": np.array(simulation.now),
        "clock/critical_time_step": np.array(simulation.critical_time_step),
        "clock/drawn": np.array(list(simulation.drawn.values())).reshape(-1, 2),
        "ledger/start": np.array(start, dtype=np.float64),
        "ledger/last": np.array(
            [] if simulation.last_sampled is None else [simulation.last_sampled]
        ),
        "ledger/impulses": np.array(list(simulation.sampler.impulses.values())),
    }
    for name, part in _parts(simulation).items():
        own = (
            part.saved_state(simulation.now) if part is simulation.dynamics else part.saved_state()
        )
        saved |= {f"{name}/{field}": values for field, values in own.items()}
    return saved


def restore_state(simulation: "Simulation", saved: Saved) -> None:
    """Continue from ``saved_state`` of a simulation of the same scene.

    Raises:
        ValueError: the arrays do not fit this simulation; its state is undefined then.
    """
    _refuse_unfit(simulation, saved)
    simulation.step_number, simulation.now = (
        int(saved["clock/step_number"]),
        int(saved["clock/now"]),
    )
    simulation.critical_time_step = float(saved["clock/critical_time_step"])
    simulation.time_step, simulation.sample_every = chosen_time_step(
        simulation.scene, simulation.critical_time_step
    )
    simulation.steps = round(simulation.scene.solver.duration / simulation.time_step)
    start, last = saved["ledger/start"], saved["ledger/last"]
    simulation.initial_ledger = Ledger(*(float(value) for value in start)) if len(start) else None
    simulation.last_sampled = float(last[0]) if len(last) else None
    names = list(simulation.sampler.impulses)
    simulation.sampler.start()
    simulation.sampler.impulses |= zip(names, saved["ledger/impulses"].tolist(), strict=False)
    for name, part in _parts(simulation).items():
        prefix = f"{name}/"
        part.restore_state(
            {n.removeprefix(prefix): v for n, v in saved.items() if n.startswith(prefix)}
        )


def _refuse_unfit(simulation: "Simulation", saved: Saved) -> None:
    """Raise ValueError unless names, types and shapes are those of this simulation's state."""
    mine = saved_state(simulation)
    for name in sorted(mine.keys() ^ saved.keys()):
        raise ValueError(f"'{name}' is {'missing' if name in mine else 'not of this scene'}")
    for name, values in saved.items():
        own = mine[name]
        # of any length; a body that a later version has added has no impulse yet
        free = name.partition("/")[2] in OF_ANY_LENGTH
        same = values.shape[1:] == own.shape[1:] if free else values.shape == own.shape
        if not same or values.ndim != own.ndim or values.dtype != own.dtype:
            raise ValueError(f"'{name}' has another shape or type")
    known = (0, *range(BEFORE_PIECES, len(fields(Ledger)) + 1))
    if len(saved["ledger/start"]) not in known or (
        len(saved["ledger/last"]) != bool(len(saved["ledger/start"]))
    ):
        raise ValueError("'ledger' has another shape")
    critical = float(saved["clock/critical_time_step"])
    if not abs(critical - simulation.critical_time_step) <= 1e-6 * simulation.critical_time_step:
        raise ValueError(
            f"the critical time step was {critical:.6g} s and is now "
            f"{simulation.critical_time_step:.6g} s"
        )
    # the random fields themselves are drawn again, from the seed
    if not np.allclose(saved["clock/drawn"], mine["clock/drawn"], rtol=1e-9, atol=0):
        raise ValueError("its random fields differ from those that the scene's seed gives here")
    if saved["clock/now"] not in (0, 1) or not 0 <= saved["clock/step_number"] <= 10**12:
        raise ValueError("'clock' is not a step's")
