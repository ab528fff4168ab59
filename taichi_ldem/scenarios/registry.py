"""The scenarios: everything that the rest of the program has to know of each.

Commands, ``ldem resume``, ensembles, reports and figures read this table; none of them knows a
scenario by name. Adding one takes its file in this package and an entry here.
"""

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType


@dataclass(frozen=True)
class Scenario:
    """A scenario.

    Attributes:
        command: what ``ldem`` calls it, and ``scenario`` in a scene.
        help: the command's line of help.
        title: of its report.
        module: where its ``run`` and ``summary`` are, imported when they are called.
        figures: names of the figures that a run's folder gets, from ``output.curves``.
        files: what its runs write besides those of every run, with a line on each.
        resumable: whether its runs have checkpoints.
        pictures: whether the cracked plate is drawn.
    """

    command: str
    help: str
    title: str
    module: str
    figures: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = ()
    resumable: bool = True
    pictures: bool = True

    def load(self) -> ModuleType:
        """The scenario's module."""
        return import_module(self.module)


_ENTRIES = (
    Scenario(
        "impact",
        "Run a falling-weight test.",
        "Falling-weight impact",
        "taichi_ldem.scenarios.impact",
        figures=(
            "force",
            "force_displacement",
            "velocity",
            "energy",
            "crack_map",
            "cracks",
            "crack_growth",
        ),
    ),
    Scenario(
        "tension",
        "Pull a specimen apart.",
        "Tension test",
        "taichi_ldem.scenarios.tension",
        figures=("energy", "stress_strain", "crack_map"),
    ),
    Scenario(
        "bend",
        "Run a notched three-point bending test, or a series of them.",
        "Three-point bending",
        "taichi_ldem.scenarios.bend",
        figures=("force", "force_displacement", "velocity", "energy", "crack_map"),
    ),
    Scenario(
        "wave",
        "Send a pulse through a bar or a plate.",
        "Travelling pulse",
        "taichi_ldem.scenarios.wave",
        figures=("energy", "crack_map", "pulse", "dispersion", "anisotropy"),
        resumable=False,
        pictures=False,
    ),
    Scenario(
        "modes",
        "Compute natural frequencies and mode shapes of any scene's lattice.",
        "Free oscillations",
        "taichi_ldem.scenarios.modes",
        figures=("modes",),
        resumable=False,
        pictures=False,
    ),
)

SCENARIOS = {entry.command: entry for entry in _ENTRIES}
