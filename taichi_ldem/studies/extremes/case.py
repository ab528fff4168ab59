"""A stiff or extreme case: its scene, its prediction by theory, and the reason."""

import re
from dataclasses import dataclass, field
from typing import Any

from taichi_ldem.studies.extremes.bench import Result
from taichi_ldem.studies.extremes.checks import Check
from taichi_ldem.studies.extremes.setups import SetUp

STABLE, REFUSED, STOPPED = "stable", "refused", "stopped"

ABOVE_CRITICAL = "time step .* above the critical"
"""Message of the guard that names the time step as the cause."""

LINEAR = "central differences: stable below 2 / omega_max, growing by 1.3 a step at 1.01"


@dataclass(frozen=True)
class Case:
    """A stiff or extreme case.

    Attributes:
        name: short and unique.
        group: the simulation that it runs on, or "commands".
        predicted: STABLE, REFUSED or STOPPED.
        because: the theory behind the prediction.
        changes: keys of the group's scene, "table.key" -> value.
        says: regular expression that the message of a refusal or of the guard must contain.
        set_up: changes the state or the arrays before the first step.
        check: runs after the last step and returns what is wrong, or nothing.
        share: time step over the critical one; None: the scene's own choice.
        steps: largest number of steps.
        drift: largest energy error of a stable case, over all energy that the plate has held.
        quick: whether the small form of the study includes it.
    """

    name: str
    group: str
    predicted: str
    because: str
    changes: dict[str, Any] = field(default_factory=dict)
    says: str = ""
    set_up: SetUp | None = None
    check: Check | None = None
    share: float | None = 0.5
    steps: int = 2000
    drift: float = 0.01
    quick: bool = False

    def agrees(self, result: Result) -> bool:
        """Whether the case ended as predicted, with the predicted message."""
        said = re.search(self.says, result.message) is not None
        return result.outcome == self.predicted and (said or self.predicted == STABLE)


def changed(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Tables of a scene with other values at some keys "table.key"."""
    data: dict[str, Any] = {k: dict(v) if isinstance(v, dict) else v for k, v in base.items()}
    for path, value in changes.items():
        table, key = path.split(".")
        data.setdefault(table, {})[key] = value
    return data
