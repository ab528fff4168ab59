"""Sizes of the pieces that a run ends with, as in a sieve analysis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taichi_ldem.analysis.fragments import DEBRIS
from taichi_ldem.output.curves.chart import BLUE, DARK, RED, Curve, Line, Panel
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.storage.fragments import read_fragments

_MM, _MS = 1e3, 1e3
_SIZE = "equivalent diameter [mm]"


def fragments(run: LoadedRun) -> tuple[Panel, ...]:
    """Mass in pieces up to a size, and number of pieces from a size on, at the last stored time."""
    table = read_fragments(run.folder.fragments_file)
    end = float(table["time_s"].max())
    last = table["time_s"] == end
    order = np.argsort(table["equivalent_diameter_m"][last], kind="stable")
    size, mass, number = (
        table[name][last][order] for name in ("equivalent_diameter_m", "mass_kg", "fragment")
    )
    sizes, first = np.unique(size, return_index=True)
    passing = np.add.reduceat(mass, first).cumsum()
    # what is drawn jumps at every size: in between there is no piece
    across, up = np.repeat(_MM * sizes, 2)[1:], np.repeat(100 * passing / passing[-1], 2)[:-1]
    share = Curve(across, up, "mass in pieces up to this size", BLUE)
    whole = number != DEBRIS
    kept, start = np.unique(size[whole], return_index=True)
    across, up = np.repeat(_MM * kept, 2)[:-1], np.repeat(whole.sum() - start, 2)[1:]
    count = Curve(across, up, "pieces from this size on", RED)
    edge = run.scene.plate.spacing
    module = Line(x=_MM * edge * np.cbrt(6 / np.pi), label="one module", colour=DARK, dash="dot")
    debris = 100 * float(mass[~whole].sum()) / float(mass.sum())
    pieces = int(whole.sum())
    word = "piece" if pieces == 1 else "pieces"
    note = f"{pieces} {word} at {_MS * end:.3f} ms; single nodes: {debris:.3g} % of the mass"
    return (
        Panel(
            "fragment_mass",
            "Mass of the pieces",
            _SIZE,
            "share of the mass [%]",
            [share, module],
            log=True,
            log_x=True,
            note=note,
            in_time=False,
        ),
        Panel(
            "fragment_number",
            "Number of pieces",
            _SIZE,
            "pieces",
            [count, replace(module, label="")],
            log=True,
            log_x=True,
            in_time=False,
        ),
    )
