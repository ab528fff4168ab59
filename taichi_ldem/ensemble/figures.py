"""Figures of an ensemble: envelopes over time (Figs. 13, 14) and crack maps (Figs. 15, 16)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.cracks import Cracks
from taichi_ldem.analysis.paper import is_papers_test
from taichi_ldem.analysis.signals import smooth_force
from taichi_ldem.analysis.window import in_words, smoothing_window
from taichi_ldem.ensemble.attempt import FINISHED
from taichi_ldem.ensemble.axes import CV, SEED
from taichi_ldem.ensemble.plan import MEMBERS
from taichi_ldem.ensemble.results import Row, groups, numbers_of
from taichi_ldem.ensemble.table3 import label
from taichi_ldem.output.curves.forces import experiments_force, papers_velocity
from taichi_ldem.output.figures.crack_map import draw_outlines
from taichi_ldem.output.figures.cracks import Panel, sheet
from taichi_ldem.output.figures.draw import draw_elements, save
from taichi_ldem.scenarios.measure import measure_run
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Series = NDArray[np.float64]
History = Mapping[str, Series]
Group = tuple[tuple[str, Any], ...]

_MS = 1e3
MOST_PANELS = 12
MOST_COLUMNS = 8
ALONE_ACROSS = 4

AVERAGED = "averaged_force_n"
"""The striker's force averaged over the window of its scene, next to the columns of a history."""


@dataclass(frozen=True)
class Set:
    """The finished members of a group.

    Attributes:
        name: of the group. rows, histories: of its members, in order.
        homogeneous: history of the specimen without disorder that is otherwise the same, or None.
        papers: whether it is the paper's test.
    """

    name: str
    rows: Sequence[Row]
    histories: Sequence[History]
    homogeneous: History | None = None
    papers: bool = False


@dataclass(frozen=True)
class Envelope:
    """Smallest, mean and largest of several records at common times (s), (n,) each."""

    time: Series
    low: Series
    mean: Series
    high: Series


def envelope(records: Sequence[tuple[Series, Series]]) -> Envelope:
    """Smallest, mean and largest of records (time, value) at each time that all of them have.

    The times are those of the record with the shortest steps; others are interpolated linearly.
    """
    end = min(float(time[-1]) for time, _ in records)
    finest = min((time for time, _ in records), key=lambda time: float(np.median(np.diff(time))))
    common = finest[finest <= end * (1 + 1e-9)]
    table = np.array([np.interp(common, time, value) for time, value in records])
    return Envelope(common, table.min(axis=0), table.mean(axis=0), table.max(axis=0))


def draw_all(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Draw the figures that the finished members have data for; returns the pictures written."""
    finished = [row for row in rows if row.state == FINISHED]
    if not finished or any(row.member.scene.striker is None for row in finished):
        return []
    runs = {row.member.name: RunFolder(folder / MEMBERS / row.member.name) for row in finished}
    histories = {row.member.name: _averaged(row, runs[row.member.name]) for row in finished}
    sets = make_sets(finished, histories)
    draws: list[tuple[str, Callable[[Figure], None]]] = [
        ("force_envelope", lambda figure: draw_force(figure, sets)),
        ("velocity_envelope", lambda figure: draw_velocity(figure, sets)),
        ("energy_envelope", lambda figure: draw_energies(figure, sets)),
    ]
    if all(row.member.scene.scenario == "impact" for row in finished):
        cracks = {name: measure_run(run) for name, run in runs.items()}
        panels = make_panels(finished, cracks)
        draws += [
            ("cracks_at_t2", lambda figure: sheet(figure, panels, final=False)),
            ("cracks_at_end", lambda figure: sheet(figure, panels, final=True)),
        ]
    return [save(folder / f"{name}.png", draw, dpi=130) for name, draw in draws]


def _averaged(row: Row, run: RunFolder) -> History:
    """A member's history with its averaged force."""
    history = run.read_history()
    window = smoothing_window(row.member.scene)
    force = smooth_force(history["time_s"], history["striker_force_n"], window)
    return {**history, AVERAGED: force}


def make_sets(finished: Sequence[Row], histories: Mapping[str, History]) -> list[Set]:
    """Groups with their histories, in order; at most twelve.

    The homogeneous specimen is drawn over the others. It has a panel of its own only where there is
    no other group.
    """
    sets: list[Set] = []
    plain: list[Set] = []
    by_group = groups(finished)
    for key, rows in by_group.items():
        records = [histories[row.member.name] for row in rows]
        partner = None if dict(key).get(CV) == 0 else _homogeneous(key, by_group)
        papers = all(is_papers_test(row.member.scene) for row in rows)
        found = Set(
            label(key),
            rows,
            records,
            None if partner is None else histories[partner[0].member.name],
            papers,
        )
        (plain if dict(key).get(CV) == 0 else sets).append(found)
    return (sets or plain)[:MOST_PANELS]


def _homogeneous(key: Group, by_group: Mapping[Group, list[Row]]) -> list[Row] | None:
    """The group without disorder that is otherwise the same."""
    wanted = dict(key)
    for other, rows in by_group.items():
        same = all(v in (None, wanted[k]) for k, v in other if k != CV)
        if same and dict(other).get(CV) == 0:
            return rows
    return None


def make_panels(
    finished: Sequence[Row], cracks: Mapping[str, Cracks | None]
) -> list[tuple[str, list[Panel]]]:
    """Rows of a sheet of crack maps: a name and its members' maps; at most twelve.

    Groups of one member each stand side by side.
    """
    by_group = groups(finished)
    if all(len(rows) == 1 for rows in by_group.values()):
        alone = [_panel(label(key), rows[0], cracks) for key, rows in by_group.items()]
        alone = alone[: MOST_PANELS * ALONE_ACROSS]
        return [("", alone[at : at + ALONE_ACROSS]) for at in range(0, len(alone), ALONE_ACROSS)]
    panels = []
    for key, rows in by_group.items():
        named = []
        for row in rows[:MOST_COLUMNS]:
            seed = row.member.varied.get(SEED)
            named.append(_panel("" if seed is None else f"seed {seed}", row, cracks))
        panels.append((label(key), named))
    return panels[:MOST_PANELS]


def _panel(name: str, row: Row, cracks: Mapping[str, Cracks | None]) -> Panel:
    """The map of a member, with the outlines of its specimen."""
    outlines = partial(draw_outlines, scene=row.member.scene, legend=False)
    return Panel(name, cracks[row.member.name], outlines)


# --- envelopes ------------------------------------------------------------------------------------


def draw_force(figure: Figure, sets: Sequence[Set]) -> None:
    """Striker force, one panel for each group."""
    windows = sorted({smoothing_window(row.member.scene) for s in sets for row in s.rows})
    over = " to ".join(dict.fromkeys(in_words(window) for window in (windows[0], windows[-1])))
    panels = _panels(figure, sets, f"striker force,\nmean over {over} [N]")
    for axes, group in zip(panels, sets, strict=True):
        _draw_band(axes, group, itemgetter(AVERAGED))
        _mark_times(axes, group)
        if group.papers:
            draw_elements(axes, experiments_force())
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    _finish(figure, panels, "Force on the striker over time")


def draw_velocity(figure: Figure, sets: Sequence[Set]) -> None:
    """Striker velocity, one panel for each group."""
    panels = _panels(figure, sets, "striker velocity,\ntowards the plate [m/s]")
    for axes, group in zip(panels, sets, strict=True):
        _draw_band(axes, group, lambda history: history["striker_velocity_m_s"])
        _mark_times(axes, group)
        if group.papers:
            draw_elements(axes, papers_velocity())
    _finish(figure, panels, "Velocity of the striker over time")


def draw_energies(figure: Figure, sets: Sequence[Set]) -> None:
    """Strain, dissipated and kinetic energy of the plate: one row each, one column a group."""
    kinds = [
        ("strain energy [J]", "strain_j"),
        ("dissipated damage\nenergy [J]", "fracture_j"),
        ("kinetic energy\nof the plate [J]", "kinetic_plate_j"),
    ]
    kinds = [kind for kind in kinds if all(kind[1] in h for s in sets for h in s.histories)]
    figure.set_size_inches(1.5 + 4.2 * max(2, len(sets)), 1.6 + 2.9 * len(kinds))
    grid = figure.subplots(len(kinds), len(sets), sharex=True, sharey="row", squeeze=False)
    for row, (name, column) in zip(grid, kinds, strict=True):
        for axes, group in zip(row, sets, strict=True):
            _draw_band(axes, group, itemgetter(column))
            _mark_times(axes, group)
        row[0].set_ylabel(name)
    for axes, group in zip(grid[0], sets, strict=True):
        axes.set_title(group.name)
    for axes in grid[-1]:
        axes.set_xlabel("time [ms]")
    _finish(figure, list(grid.ravel()), "Energies over time")


def _panels(figure: Figure, sets: Sequence[Set], quantity: str) -> list[Axes]:
    across = min(3, len(sets))
    down = math.ceil(len(sets) / across)
    figure.set_size_inches(1.5 + 4.6 * max(2, across), 2.2 + 3.8 * down)
    grid = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    for axes in grid.ravel()[len(sets) :]:
        axes.remove()
    for axes, group in zip(grid.ravel(), sets, strict=False):
        axes.set_title(group.name)
    for row in grid:
        row[0].set_ylabel(quantity)
    panels: list[Axes] = list(grid.ravel()[: len(sets)])
    for axes in panels[-across:]:  # the lowest of each column
        axes.set_xlabel("time [ms]")
        axes.tick_params(labelbottom=True)
    return panels


def _draw_band(axes: Axes, group: Set, value: Callable[[History], Series]) -> None:
    records = [(history["time_s"], value(history)) for history in group.histories]
    found = envelope(records)
    time = _MS * found.time
    if len(records) > 1:
        between = "between the smallest and the largest member"
        axes.fill_between(time, found.low, found.high, color="C0", alpha=0.3, lw=0, label=between)
    axes.plot(time, found.mean, color="C0", label="mean" if len(records) > 1 else "member")
    if group.homogeneous is not None:
        plain = _MS * group.homogeneous["time_s"], value(group.homogeneous)
        axes.plot(*plain, color="black", linestyle="--", linewidth=1.2, label="homogeneous")
    axes.set_xlim(0.0, float(time[-1]))


def _mark_times(axes: Axes, group: Set) -> None:
    """Each member's t1 and t2 as ticks on the panel's lower edge."""
    for name, text, color in (
        ("first_peak_time_s", "$t_1$ of the members", "C2"),
        ("failure_time_energy_s", "$t_2$ (energy) of the members", "C1"),
    ):
        at = _MS * np.array(numbers_of(group.rows, name))
        place = axes.get_xaxis_transform()
        style: dict[str, Any] = {"color": color, "markersize": 16, "markeredgewidth": 2.0}
        if len(at):
            axes.plot(at, np.full(len(at), 0.03), "|", transform=place, label=text, **style)


def _finish(figure: Figure, panels: Sequence[Axes], title: str) -> None:
    """One legend for all panels."""
    entries: dict[str, Any] = {}
    for axes in panels:
        for handle, text in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(text, handle)
    figure.suptitle(title, fontsize=15)
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=2, fontsize=12
    )
