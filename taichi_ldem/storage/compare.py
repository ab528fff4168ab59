"""Comparison of the results of two runs, bit by bit."""

from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.storage.fields import read_broken_bars, read_fields, read_quantities, read_times
from taichi_ldem.storage.folder import RunFolder


def differences(run: Path, other: Path) -> list[str]:
    """What differs between the results of two runs, bit by bit; empty where nothing does."""
    found = []
    one, two = RunFolder.open(run), RunFolder.open(other)
    if one.history_file.read_bytes() != two.history_file.read_bytes():
        found.append("history.csv")
    pieces = [f.fragments_file.read_bytes() for f in (one, two) if f.fragments_file.exists()]
    if len(pieces) == 1 or pieces[:1] != pieces[1:]:
        found.append("fragments.csv")
    if not np.array_equal(read_times(one.fields_file), read_times(two.fields_file)):
        return [*found, "times of the fields"]
    for step in range(len(read_times(one.fields_file))):
        mine, theirs = (
            read_fields(folder.fields_file, step, read_quantities(folder.fields_file))
            for folder in (one, two)
        )
        found += _unequal(mine, theirs, f"fields, step {step}")
    bars = [read_broken_bars(folder.fields_file) for folder in (one, two)]
    found += _unequal(bars[0], bars[1], "broken bars")
    numbers = [folder.read_summary() for folder in (one, two)]
    for name in numbers[0].keys() - {
        "wall_s",
        "compile_s",
        "bars_per_s",
        "peak_memory_bytes",
        "provenance",
    }:
        if numbers[0][name] != numbers[1].get(name):
            found.append(f"summary, {name}")
    return found


def _unequal(mine: Any, theirs: Any, what: str) -> list[str]:
    one, two = (dict(vars(both)) for both in (mine, theirs))
    for values in (one, two):
        values.update(values.pop("quantities", {}))
    return [
        f"{what}: {name}"
        for name in sorted(one.keys() | two.keys())
        if not np.array_equal(one.get(name, np.nan), two.get(name, np.nan))
    ]
