"""Curves of the energies, of their imbalance, and of the number of broken bars."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taichi_ldem.output.curves.chart import (
    BLACK,
    BLUE,
    BROWN,
    GREEN,
    GREY,
    ORANGE,
    RED,
    VIOLET,
    Curve,
    Panel,
)
from taichi_ldem.output.curves.forces import whole
from taichi_ldem.output.curves.times import times_of
from taichi_ldem.output.loaded import LoadedRun

_TIME = "time [ms]"
_STORED = (
    ("strain_j", "strain", BLUE),
    ("fracture_j", "fracture", RED),
    ("kinetic_plate_j", "kinetic, plate", ORANGE),
    ("contact_j", "lost in contact", GREEN),
    ("contact_elastic_j", "held in elastic landings", GREY),
    ("damping_j", "lost by damping", VIOLET),
    ("notch_j", "taken by notches", BROWN),
    ("pieces_elastic_j", "stored where pieces touch", BLACK),
)
"""Column, label and colour of the energies that the plate received."""


def energy(run: LoadedRun) -> tuple[Panel, ...]:
    """The energies over time, and below them their imbalance."""
    curves = [*_given(run), *_received(run)]
    error = 100 * np.abs(run.history["energy_error"])
    imbalance = Curve(run.time_ms, np.where(error > 0, error, np.nan), colour=BLACK, width=1.0)
    ratio = "imbalance of energies over initial energy and external work"
    energies = Panel(
        "energy",
        "Energies",
        _TIME,
        "energy [J]",
        [*curves, times_of(run, "energy")],
        x_range=whole(run),
        height=3.0,
    )
    below = Panel(
        "error",
        "Energy error",
        _TIME,
        "|error| [%]",
        [imbalance],
        x_range=whole(run),
        log=True,
        note=ratio,
    )
    return energies, below


def _given(run: LoadedRun) -> Iterator[Curve]:
    """The energy that the plate had or was given: by strikers, gravity, grips or loads."""
    history, given = run.history, {}
    if any(run.scene.plate.velocity or ()) or run.scene.start is not None:
        held = history["kinetic_plate_j"][0] + history["strain_j"][0]
        given["plate at the start"] = np.full(run.rows, held)
    columns = [c for c in history if c.startswith("kinetic_striker")]
    if columns:
        kinetic = np.sum([history[c] for c in columns], axis=0)
        by = "striker" if len(columns) == 1 else "strikers"
        given[f"given up by the {by}"] = kinetic[0] - kinetic
    if "external_j" in history:
        given[f"work of {_worker(run)}"] = history["external_j"]
    if given:
        total = np.sum(list(given.values()), axis=0)
        yield Curve(run.time_ms, total, " + ".join(given), GREY, dash="dash")


def _worker(run: LoadedRun) -> str:
    """What does work from outside."""
    scene = run.scene
    by = {
        "grips": scene.grips is not None,
        "loads": bool(scene.loads),
        "gravity": scene.plate.falls or any(striker.gravity for striker in scene.strikers),
        "indenter": any(striker.is_prescribed for striker in scene.strikers),
    }
    return " and ".join(name for name, works in by.items() if works)


def _received(run: LoadedRun) -> Iterator[Curve]:
    for column, label, colour in _STORED:
        if column in run.history:
            yield Curve(run.time_ms, run.history[column], label, colour)


def broken_bars(run: LoadedRun) -> tuple[Panel, ...]:
    """The number of broken bars over time."""
    curve = Curve(run.time_ms, run.history["broken_bars"], "broken bars", RED)
    return (Panel("broken", "Broken bars", _TIME, "bars", [curve], x_range=whole(run)),)
