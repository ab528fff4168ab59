"""The registry of the scenarios: all that the rest of the program knows about each of them.

Commands, ``ldem resume``, ensembles, reports and figures read this table, and none of them knows a
scenario by name. To add a scenario, write its file and add an entry here. The file defines either

    summary(simulation, history, folder) -> dict   the numbers of a finished run, for summary.json

and is then run by ``runner.run``, or, where a run needs more than its scene,

    run(scene, out, *, force, quiet, draw) -> int  the whole run; returns its exit code.

This module holds names only and imports no scenario.
"""

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType

from taichi_ldem.scene import ScenarioRules, Scene, register_scenario


@dataclass(frozen=True)
class Option:
    """An option that one scenario's command has in addition to those of all.

    Attributes:
        name: without the leading dashes.
        help: the option's line of help.
        key: the key of the scene that it sets, a whole number; empty for a flag.
        runs: for a flag, "module:function" that is called instead of the run, with the scene, the
            run folder (None: the default), the name of the scene's file and whether to be quiet.
    """

    name: str
    help: str
    key: str = ""
    runs: str = ""


@dataclass(frozen=True)
class Scenario:
    """A scenario.

    Attributes:
        command: the name of its command, and the value of ``scenario`` in a scene file.
        help: the command's line of help.
        title: the heading of its report.
        module: the module with ``summary`` or ``run``, imported when a run begins.
        figures: names of the figures in a run's folder; one without data is left out.
        files: files that its runs write in addition to those of every run, each with a line on it.
        numbers: names of the summary's numbers in an ensemble's table; empty: all of them.
        resumable: whether a run follows from its scene and its checkpoints alone.
        pictures: whether the deformed and cracked plate is drawn.
        in_time: whether it steps in time. One that does not accepts any scene, of which it takes
            the lattice.
        options: options of its command in addition to those of all commands.
        rules: tables that its scene needs or must not have, unless ``scene.checks`` has them; None:
            any.
    """

    command: str
    help: str
    title: str
    module: str
    figures: tuple[str, ...] = ()
    files: tuple[tuple[str, str], ...] = ()
    numbers: tuple[str, ...] = ()
    resumable: bool = True
    pictures: bool = True
    in_time: bool = True
    options: tuple[Option, ...] = ()
    rules: ScenarioRules | None = None

    @property
    def writes(self) -> list[str]:
        """Names of the files that its runs write in addition to those of every run."""
        return [f"{name}.png" for name in self.figures] + [name for name, _ in self.files]

    def load(self) -> ModuleType:
        """The scenario's module."""
        return import_module(self.module)


_ENTRIES = (
    Scenario(
        "impact",
        "Run a falling-weight test",
        "Falling-weight impact",
        "taichi_ldem.scenarios.impact",
        figures=(
            "force",
            "force_displacement",
            "floor_force",
            "velocity",
            "probes",
            "energy",
            "crack_map",
            "cracks",
            "crack_growth",
            "fragments",
        ),
        numbers=(
            "damage_onset_time_s",
            "first_peak_force_n",
            "first_peak_time_s",
            "second_peak_force_n",
            "second_peak_time_s",
            "failure_time_s",
            "failure_time_velocity_s",
            "failure_time_energy_s",
            "striker_velocity_end_m_s",
            "fracture_j",
            "radial_cracks",
            "radial_diameter_m",
            "circular_diameter_m",
            "circular_coverage",
            "crack_length_m",
            "energy_error",
            "energy_error_of_plate",
        ),
    ),
    Scenario(
        "tension",
        "Pull a specimen apart",
        "Tension test",
        "taichi_ldem.scenarios.tension",
        figures=("probes", "energy", "stress_strain", "crack_map", "fragments"),
    ),
    Scenario(
        "bend",
        "Run a notched three-point bending test, or a series of them",
        "Three-point bending",
        "taichi_ldem.scenarios.bend",
        figures=(
            "force",
            "force_displacement",
            "velocity",
            "probes",
            "energy",
            "crack_map",
            "fragments",
        ),
        options=(
            Option(
                "series",
                "run eight beams of other widths and notches: the fracture energy as a slope;"
                " what is finished in DIR is not run again",
                runs="taichi_ldem.studies.bending:run_series",
            ),
        ),
    ),
    Scenario(
        "load",
        "Load a plate by tractions, forces or prescribed motions",
        "Plate under loads",
        "taichi_ldem.scenarios.load",
        figures=(
            "loads",
            "force",
            "floor_force",
            "velocity",
            "probes",
            "energy",
            "crack_map",
            "fragments",
        ),
    ),
    Scenario(
        "wave",
        "Send a pulse through a bar or a plate",
        "Travelling pulse",
        "taichi_ldem.scenarios.wave",
        figures=("energy", "crack_map", "pulse", "dispersion", "anisotropy"),
        files=(
            ("probes.csv", "displacement at the two probes, as computed and exact"),
            ("profiles.csv", "displacement along the axis at five times, as computed and exact"),
        ),
        resumable=False,
        pictures=False,
    ),
    Scenario(
        "modes",
        "Compute natural frequencies and mode shapes of any scene's lattice",
        "Free oscillations",
        "taichi_ldem.scenarios.modes",
        figures=("modes",),
        files=(
            ("modes.csv", "frequency, residual, name and group of each mode"),
            ("modes.md", "the same as a table, with thin-plate theory and the paper's values"),
            ("modes.vtkhdf", "the mode shapes, for ParaView"),
        ),
        resumable=False,
        pictures=False,
        in_time=False,
        options=(Option("count", "number of modes, from the lowest", key="modes.count"),),
    ),
)

SCENARIOS: dict[str, Scenario] = {}
"""The scenarios by the name of their command, in the order of the command line's help."""


def register(entry: Scenario) -> None:
    """Make a scenario known, also to scene files."""
    SCENARIOS[entry.command] = entry
    register_scenario(entry.command, entry.rules)


for _entry in _ENTRIES:
    register(_entry)


def entry_of(scene: Scene) -> Scenario:
    """The entry of a scene's scenario."""
    return SCENARIOS[scene.scenario]


def resumable() -> list[str]:
    """Names of the scenarios whose runs can be resumed."""
    return [name for name, entry in SCENARIOS.items() if entry.resumable]
