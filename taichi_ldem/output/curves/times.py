"""The events that figures and the report mark in a run's record."""

from collections.abc import Mapping
from typing import Any, Literal

from taichi_ldem.output.curves.chart import Times
from taichi_ldem.output.loaded import LoadedRun, number

Failure = Literal["force", "velocity", "energy"]
"""The record from which the time of failure is read (``analysis.signals``)."""

EVENTS = {
    "damage_onset_time_s": "onset",
    "first_peak_time_s": "t1",
    "second_peak_time_s": "P2",
    "failure_time_s": "t2 (force)",
    "failure_time_velocity_s": "t2 (velocity)",
    "failure_time_energy_s": "t2 (energy)",
    "peak_time_s": "peak",
}
"""Name of each event by the summary's number that holds its time, s."""

_FAILURE_KEYS: dict[Failure, str] = {
    "force": "failure_time_s",
    "velocity": "failure_time_velocity_s",
    "energy": "failure_time_energy_s",
}


def times_of(run: LoadedRun, failure: Failure, *, named: bool = True) -> Times:
    """Onset of damage, first peak and failure, in ms, with the failure read from one record."""
    keys = ("damage_onset_time_s", "first_peak_time_s", _FAILURE_KEYS[failure], "peak_time_s")
    found = [(1e3 * at, EVENTS[key]) for key in keys if (at := run.number(key)) is not None]
    return Times(tuple(sorted(found)), named)


def events_of(summary: Mapping[str, Any]) -> list[tuple[str, float | None]]:
    """Name and time (s) of the events that a summary knows; None where one did not happen."""
    known = [(name, number(summary, key)) for key, name in EVENTS.items() if key in summary]
    return [("onset of damage" if name == "onset" else name, at) for name, at in known]
