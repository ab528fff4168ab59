"""Labels, units and digits of the numbers in summaries and histories, for pages and tables."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from taichi_ldem.scene import TABLES

_NOTHING = 1e-3  # share of the largest of a list, below which a number is shown as 0


@dataclass(frozen=True)
class Number:
    """How a number of a summary or a column of a history is shown.

    Attributes:
        factor: from SI to ``unit``.
        positive: direction of a positive value, where that is not clear from the label.
    """

    label: str
    unit: str = ""
    factor: float = 1.0
    positive: str = ""

    @property
    def title(self) -> str:
        """Label with its unit, for the head of a column."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def shown(self, value: Any) -> str:
        """Three digits in the unit, whole numbers whole; "none" without a value."""
        if isinstance(value, (list, tuple)):
            least = _NOTHING * max((abs(v) for v in value if isinstance(v, float)), default=0.0)
            items = [0.0 if isinstance(v, float) and abs(v) < least else v for v in value]
            return ", ".join(self.shown(item) for item in items) or "none"
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return "none" if value is None else str(value)
        if self.factor == 1.0 and (isinstance(value, int) or (not self.unit and value % 1 == 0)):
            return f"{value:,.0f}"  # a count
        return three_digits(self.factor * value)

    def with_unit(self, value: Any) -> str:
        """The same, followed by the unit."""
        return f"{self.shown(value)} {'' if value is None else self.unit}".strip()


def three_digits(value: float) -> str:
    """Three significant digits without an exponent, where the value is not very small."""
    if not math.isfinite(value):
        return "none"
    size = 0 if value == 0 else math.floor(math.log10(abs(value)))
    if value and size < -4:
        return f"{value:.2e}"
    rounded = round(value, 2 - size) + 0.0
    size = 0 if rounded == 0 else math.floor(math.log10(abs(rounded)))
    return f"{rounded:,.{min(max(2 - size, 0), 6)}f}" if rounded else "0"


_MS, _MM = ("ms", 1e3), ("mm", 1e3)
NUMBERS: dict[str, Number] = {
    "damage_onset_time_s": Number("onset of damage", *_MS),
    "first_peak_force_n": Number("first peak P1", "N"),
    "first_peak_time_s": Number("its time t1", *_MS),
    "second_peak_force_n": Number("second peak P2", "N"),
    "second_peak_time_s": Number("time of P2", *_MS),
    "failure_time_s": Number("failure t2 (force)", *_MS),
    "failure_time_velocity_s": Number("failure t2 (velocity)", *_MS),
    "failure_time_energy_s": Number("failure t2 (energy)", *_MS),
    "smoothing_window_s": Number("window of smoothed forces", *_MS),
    "peak_load_n": Number("peak load (ASTM D3763)", "N"),
    "peak_load_time_s": Number("its time", *_MS),
    "deflection_at_peak_load_m": Number("deflection at peak load", *_MM),
    "energy_at_peak_load_j": Number("energy to peak load", "J"),
    "total_energy_j": Number("total energy", "J"),
    "striker_velocity_end_m_s": Number("striker velocity at the end", "m/s"),
    "contact_striker_j": Number("lost in contact with the striker", "J"),
    "contact_rings_j": Number("lost in contact with the rings", "J"),
    "contact_supports_j": Number("lost in contact with the supports", "J"),
    "contact_faces_j": Number("lost where faces of a crack met", "J"),
    "radial_cracks": Number("radial cracks"),
    "radial_diameter_m": Number("d_r, circle of the radial tips", *_MM),
    "radial_centre_m": Number("its centre", *_MM),
    "radial_scatter_m": Number("tips off it (rms)", *_MM),
    "radial_time_s": Number("time of the radial cracks' count", *_MS),
    "radial_tip_m": Number("furthest radial tip from the axis", *_MM),
    "circular_diameter_m": Number("d_c, circular crack", *_MM),
    "circular_centre_m": Number("its centre", *_MM),
    "circular_scatter_m": Number("points off it (rms)", *_MM),
    "circular_coverage": Number("circular crack, share of the turn", "%", 100.0),
    "crack_length_m": Number("length of all cracks, without the core", *_MM),
    "crack_speed_mean_m_s": Number("mean speed of the furthest tip", "m/s"),
    "crack_speed_max_m_s": Number("its largest speed", "m/s"),
    "fracture_j": Number("fracture energy", "J"),
    "contact_j": Number("lost in contact", "J"),
    "broken_bars": Number("broken bars"),
    "fragments": Number("pieces of the plate, without single nodes"),
    "fragments_above_10_modules": Number("pieces larger than 10 modules"),
    "largest_fragment_mass_share": Number("mass of the largest piece", "%", 100.0),
    "debris_mass_share": Number("mass of single nodes", "%", 100.0),
    "youngs_modulus": Number("Young's modulus", "GPa", 1e-9),
    "poisson_ratio": Number("Poisson's ratio"),
    "strength": Number("strength", "MPa", 1e-6),
    "strain_at_peak": Number("strain at the peak", "%", 100.0),
    "stress_at_first_broken_bar": Number("stress at the first broken bar", "MPa", 1e-6),
    "fracture_energy_dissipated": Number("dissipated over the net section", "J/m2"),
    "work_of_grips_until_parted": Number("work of the grips until it parts", "J/m2"),
    "loading_rate_pa_s": Number("loading rate", "GPa/s", 1e-9),
    "strain_rate_1_s": Number("strain rate", "1/s"),
    "net_section_m2": Number("net section", "mm2", 1e6),
    "gauge_length_m": Number("gauge length", *_MM),
    "peak_force_n": Number("peak force", "N"),
    "peak_time_s": Number("time of the peak", *_MS),
    "peak_work_j": Number("work at the peak", "mJ", 1e3),
    "striker_displacement_m": Number("striker displacement", *_MM),
    "striker_velocity_m_s": Number("striker velocity", "m/s"),
    "striker_force_n": Number("striker force", "N"),
    "ring_force_n": Number("ring force", "N", positive="upwards"),
    "support_force_n": Number("support force", "N"),
    "floor_force_n": Number("floor force", "N", positive="upwards"),
    "grip_force_n": Number("grip force", "N"),
    "grip_displacement_m": Number("grip displacement", *_MM),
    "gauge_strain": Number("gauge strain", "%", 100.0),
    "gauge_lateral_strain": Number("lateral strain", "%", 100.0),
    "strain_j": Number("strain energy", "J"),
    "kinetic_plate_j": Number("kinetic energy of the plate", "J"),
    "kinetic_striker_j": Number("kinetic energy of the striker", "J"),
    "damping_j": Number("lost by damping", "J"),
    "contact_elastic_j": Number("energy held in elastic landings", "J"),
    "pieces_elastic_j": Number("energy stored where pieces touch", "J"),
    "pieces_friction_j": Number("lost by friction of pieces", "J"),
    "notch_j": Number("taken by notches that opened", "J"),
    "external_j": Number("work of gravity, grips, loads or an indenter", "J"),
    "energy_error": Number("energy error, of the initial energy", "%", 100.0),
    "energy_error_of_plate": Number("energy error, of what the plate was given", "%", 100.0),
    "wall_s": Number("time of stepping", "s"),
    "compile_s": Number("time of set-up (import, compilation)", "s"),
    "steps": Number("steps"),
    "time_step_s": Number("time step", "ns", 1e9),
    "critical_time_step_s": Number("critical time step", "ns", 1e9),
    "bars": Number("bars"),
    "nodes": Number("nodes"),
    "bars_per_s": Number("speed", "million bars a second", 1e-6),
    "disorder.fracture_energy_cv": Number("CV of the fracture energy", "%", 100.0),
    "disorder.youngs_modulus_cv": Number("CV of Young's modulus", "%", 100.0),
    "disorder.density_cv": Number("CV of the density", "%", 100.0),
    "disorder.seed": Number("seed"),
    "peak_memory_bytes": Number("largest memory of the process", "MB", 1e-6),
}
AT_T2 = ("radial_cracks", "radial_diameter_m")
"""Numbers that are measured at t2 (energy), or at the end of a record without it."""
MEASURED_AT_END = "measured at the end: no failure by the strain energy"
"""The remark on ``AT_T2`` in a record without t2 (energy)."""


_ENDINGS = {
    "_j_m2": "J/m2",
    "_m_s": "m/s",
    "_m2": "m2",
    "_hz": "Hz",
    "_pa": "Pa",
    "_m": "m",
    "_n": "N",
    "_j": "J",
    "_s": "s",
}


def named(key: str) -> Number:
    """How a number is shown.

    A key of a scene is its own label. An unknown number is labelled by its words, in SI units
    or, if it is a displacement, in millimetres.
    """
    if "." in key and key not in NUMBERS:
        return Number(key, unit_of(key))
    if key in NUMBERS:
        return NUMBERS[key]
    if (further := re.match(r"(.*striker)(\d+)(_.*)", key)) is not None:
        first = named(further[1] + further[3])
        return replace(first, label=first.label.replace("striker", f"striker {further[2]}"))
    if re.search(r"_displacement(_[xyz])?_m$", key):  # of a load, a probe or a striker
        return Number(key.removesuffix("_m").replace("_", " "), *_MM)
    ending, unit = next((item for item in _ENDINGS.items() if key.endswith(item[0])), ("", ""))
    return Number(key.removesuffix(ending).replace("_", " "), unit)


def at_end(numbers: Mapping[str, Any]) -> bool:
    """Whether radial cracks were measured at the end, since the record has no failure."""
    measured = numbers.get("radial_diameter_m") is not None or bool(numbers.get("radial_cracks"))
    return measured and numbers.get("failure_time_energy_s") is None


_UNIT = re.compile(
    r"(?:^|, )(m\^-1/2|kg/m3|J/m2|m/s2|m/s|1/s|Pa|kg|Hz|degrees|seconds|m|s)(?=$|[,;]| of wall)"
)


def unit_of(key: str) -> str:
    """Unit of a scene's key ("striker.mass"), from the key's description; "" where it has none."""
    table, _, name = key.partition(".")
    schema = TABLES.get(table.partition("[")[0])
    field = None if schema is None else schema.model_fields.get(name)
    found = None if field is None else _UNIT.search(field.description or "")
    return "" if found is None else found[1].replace("seconds", "s")
