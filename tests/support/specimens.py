"""A tension test in this process: its numbers and its history."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from taichi_ldem.scenarios.runner import row
from taichi_ldem.scenarios.tension import summary
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

NO_FOLDER = RunFolder(Path("not written"))


def pull(simulation: "Simulation") -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Run a specimen to the end of its scene."""
    history = [
        row(s) | {"energy_error_of_plate": s.energy_error_of_plate} for s in simulation.samples()
    ]
    return summary(simulation, history, NO_FOLDER), history
