"""All figures of a run by name; a scenario's registry entry names those that it has.

To add a figure, describe its panels in this package, add a row here, and name it in the scenario's
entry. A figure that panels cannot describe is drawn by a function of its own in ``output.figures``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from taichi_ldem.output.curves import energies, forces, fragments, loads, probes, tension
from taichi_ldem.output.curves.chart import Panel
from taichi_ldem.output.loaded import LoadedRun


@dataclass(frozen=True)
class Figure:
    """A figure.

    Attributes:
        title: what it shows.
        needs: whether a run has the data for it.
        size: width and height, inches.
        panels: the description; None: a function of ``output.figures`` draws the figure.
    """

    title: str
    needs: Callable[[LoadedRun], bool]
    size: tuple[float, float] = (9.0, 6.4)
    panels: Callable[[LoadedRun], tuple[Panel, ...]] | None = None


def _has(column: str) -> Callable[[LoadedRun], bool]:
    return lambda run: run.has(column)


def _has_loads(run: LoadedRun) -> bool:
    return bool(run.scene.loads)


def _has_probes(run: LoadedRun) -> bool:
    shown = {"displacement", "strain", "stress"}
    return any(shown & {*probe.quantities} for probe in run.scene.probes)


def _has_section(run: LoadedRun) -> bool:
    return run.has("gauge_strain") and "net_section_m2" in run.summary


def _has_fields(run: LoadedRun) -> bool:
    return run.scene.material.damage and run.folder.fields_file.exists()


def _has_pulse(run: LoadedRun) -> bool:
    return run.scene.pulse is not None and "dispersion" in run.summary


def _has_cracks(run: LoadedRun) -> bool:
    return run.cracks is not None


def _has_fragments(run: LoadedRun) -> bool:
    return run.scene.output.fragments and run.folder.fragments_file.exists()


def _has_growth(run: LoadedRun) -> bool:
    return run.rows > 1 and run.cracks is not None


FIGURES: dict[str, Figure] = {
    "force": Figure("Striker force", _has("striker_force_n"), panels=forces.force),
    "loads": Figure("Forces of the loads", _has_loads, panels=loads.loads),
    "probes": Figure(
        "Displacement, strain and stress of the probes", _has_probes, (9.0, 7.8), probes.probes
    ),
    "floor_force": Figure("Floor force", _has("floor_force_n"), panels=forces.floor_force),
    "force_displacement": Figure(
        "Force over displacement", _has("support_force_n"), panels=forces.force_displacement
    ),
    "velocity": Figure("Striker velocity", _has("striker_velocity_m_s"), panels=forces.velocity),
    "energy": Figure("Energies", _has("energy_error"), (9.0, 7.0), energies.energy),
    "broken_bars": Figure("Broken bars", _has("broken_bars"), panels=energies.broken_bars),
    "stress_strain": Figure("Stress over strain", _has_section, panels=tension.stress_strain),
    "force_strain": Figure(
        "Force over strain",
        lambda run: run.has("grip_force_n") and not _has_section(run),
        panels=tension.force_strain,
    ),
    "crack_map": Figure("Crack map in the reference configuration", _has_fields, (9.0, 7.8)),
    "cracks": Figure(
        "Measured cracks: radial at t2 (energy), circular at the end, from below",
        _has_cracks,
        (15.0, 9.7),
    ),
    "crack_growth": Figure("Growth of the cracks", _has_growth, (9.0, 8.0)),
    "fragments": Figure("Sizes of the pieces", _has_fragments, (9.0, 9.0), fragments.fragments),
    "pulse": Figure("Snapshots of the pulse", _has_pulse, (9.0, 9.0)),
    "dispersion": Figure("Phase speed over wavelength", _has_pulse, (9.0, 7.0)),
    "anisotropy": Figure("Phase speed over direction", _has_pulse, (12.0, 9.0)),
    # drawn while the shapes are known, which no file holds
    "modes": Figure("Mode shapes", lambda run: False),
}
