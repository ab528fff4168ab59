"""The HTML page of an ensemble: statistics of its groups, its members and its figures."""

from __future__ import annotations

import csv
import io
import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_ldem.analysis.quantities import AT_T2, MEASURED_AT_END, at_end, named
from taichi_ldem.ensemble.plan import MEMBERS
from taichi_ldem.ensemble.results import FEWEST
from taichi_ldem.ensemble.table3 import label
from taichi_ldem.errors import DamagedFile
from taichi_ldem.output.loaded import number
from taichi_ldem.output.report.images import embedded
from taichi_ldem.output.report.page import Link, Page, Picture, Table
from taichi_ldem.output.report.tables import plain
from taichi_ldem.output.report.write import write_page
from taichi_ldem.reading import parse_json, read_object, read_text

_TABLE = "ensemble.csv"


def has_members(folder: Path) -> bool:
    """Whether a folder holds the table of an ensemble's members."""
    return (folder / _TABLE).exists()


def write_report(folder: Path, out: Path | None = None) -> Path:
    """Write the page of an ensemble's folder.

    Args:
        out: the page; None: ``report.html`` in the folder.

    Raises:
        SceneError: ``ensemble.json`` cannot be read, or the optional packages are missing.
        OSError: the page cannot be written.
    """
    path = folder / "report.html" if out is None else out
    return write_page(ensemble_page(folder.resolve(), path), path)


_SHEETS = {
    "cracks_at_t2": "Cracks from below at t2 (energy), or at the end without failure",
    "cracks_at_end": "Cracks from below at the end",
    "force_envelope": "Force on the striker: smallest, mean and largest of the members",
    "velocity_envelope": "Velocity of the striker: smallest, mean and largest of the members",
    "energy_envelope": "Energies: smallest, mean and largest of the members",
}
_ACROSS = 10
"""Columns of a table of members, in addition to their names."""


def _csv_rows(file: Path) -> list[dict[str, str]]:
    rows = list(csv.DictReader(io.StringIO(read_text(file)), strict=True))
    for place, row in enumerate(rows):
        if None in row or None in row.values() or "name" not in row:
            raise DamagedFile(f"'{file}': row {place + 1} does not fit its header")
    return rows


def _member_tables(members: Sequence[Mapping[str, str]], folder: Path, page: Path) -> list[Table]:
    """The members' numbers in tables that fit a page, their names linked to their folders."""
    if not members:
        return []
    columns = [key for key in members[0] if key != "name"]
    pieces = [columns[at : at + _ACROSS] for at in range(0, len(columns), _ACROSS)]
    links = [_link(member["name"], folder, page) for member in members]
    note = f" (*: {MEASURED_AT_END})" if any(at_end(_cells(m)) for m in members) else ""
    return [
        Table(
            [
                (link, *(_member_cell(key, _cells(member)) for key in piece))
                for link, member in zip(links, members, strict=True)
            ],
            ("member", *(named(key).title for key in piece)),
            "Members" + (note if "radial_diameter_m" in piece else ""),
        )
        for piece in pieces
    ]


def _cells(member: Mapping[str, str]) -> dict[str, Any]:
    """A member's cells as numbers, where they are; None where they are empty."""
    found: dict[str, Any] = {}
    for key, cell in member.items():
        try:
            found[key] = parse_json(cell) if cell else None
        except ValueError:
            found[key] = cell
    return found


def _member_cell(key: str, member: Mapping[str, Any]) -> str:
    value = member[key]
    if value is None:
        return "" if key == "reason" else "-"
    starred = key in AT_T2 and at_end(member)
    return named(key).shown(value) + ("*" if starred else "")


def _link(name: str, folder: Path, page: Path) -> Link | str:
    member = folder / MEMBERS / name
    if not member.is_dir():
        return name
    report = member / "report.html"
    there = report if report.is_file() else member
    try:
        return Link(name, Path(os.path.relpath(there, page.resolve().parent)).as_posix())
    except ValueError:  # another drive
        return name


def ensemble_page(folder: Path, page: Path) -> Page:
    """The page, from ``ensemble.csv``, ``ensemble.json`` and the figures in the folder.

    Args:
        page: where the page will be, from which its links lead.

    Raises:
        SceneError: ``ensemble.json`` cannot be read.
    """
    members = _csv_rows(folder / _TABLE)
    record: dict[str, Any] = {}
    file = folder / "ensemble.json"
    if file.exists():
        record = read_object(file)
        if not _is_record(record):
            raise DamagedFile(f"'{file}' does not hold the statistics of an ensemble")
    asked = [(key, plain(value)) for key, value in record.get("asked", {}).items()]
    read = [_cells(member) for member in members]
    groups = [_group(group, starred=_starred(group, read)) for group in record.get("groups", [])]
    failed = [
        f"{name}: {member.get('reason') or member.get('state')}"
        for name, member in record.get("not_finished", {}).items()
    ]
    identity = [(k, plain(record[k])) for k in ("version", "sha256") if record.get(k)]
    finished = record.get("finished", len(members))
    spent = sum(number(cells, "wall_s") or 0.0 for cells in read)
    cost = [("members", str(len(members))), ("stepping, all members", f"{spent:.0f} s")]
    return Page(
        title="Ensemble",
        name=folder.resolve().name,
        lead=f"{finished} of {len(members)} members finished.",
        asked=[Table(asked, caption="Options of the command")],
        notes=failed,
        happened=[*groups, *_member_tables(members, folder, page)],
        images=[
            Picture(_SHEETS.get(file.stem, file.stem.replace("_", " ")), embedded(file))
            for file in sorted(folder.glob("*.png"))
        ],
        cost=[Table(list(cost), caption="Cost")],
        repeat=[Table(identity, caption="What wrote it")],
        commands=_commands(record.get("asked", {}), folder),
    )


def _is_record(record: Mapping[str, Any]) -> bool:
    """Whether a table of values has the parts of ``ensemble.json`` that the page shows."""
    groups, failed = record.get("groups", []), record.get("not_finished", {})
    if not isinstance(groups, list) or not all(isinstance(group, dict) for group in groups):
        return False
    inner = [group.get(key, {}) for group in groups for key in ("varied", "statistics")]
    if not all(isinstance(part, dict) for part in (record.get("asked", {}), failed, *inner)):
        return False
    if not all(isinstance(member, dict) for member in failed.values()):
        return False
    statistics = [s for group in groups for s in group.get("statistics", {}).values()]
    return all(isinstance(s, dict) and _are_statistics(s) for s in statistics)


def _are_statistics(values: Mapping[str, Any]) -> bool:
    """Whether these are the statistics of a number, as ``results.Statistics`` holds them."""
    interval = values.get("interval", 0)
    if interval is not None and not (isinstance(interval, list) and len(interval) == 2):
        return False
    numbers = [values.get(name) for name in ("count", "mean", "smallest", "largest")]
    numbers += interval or []
    deviation = values.get("standard_deviation", "")
    numbers += [] if deviation is None else [deviation]
    return all(type(value) in (int, float) for value in numbers)


def _commands(asked: Mapping[str, Any], folder: Path) -> list[str]:
    if not asked.get("scene"):
        return []
    words = ["ldem", "ensemble", str(asked["scene"])]
    for key in ("cv", "seeds", "vary", "set"):
        given = asked.get(key) or []
        for value in given if isinstance(given, list) else [given]:
            words += [f"--{key}", str(value)]
    return [shlex.join(words), shlex.join(["ldem", "plot", str(folder)])]


def _starred(group: Mapping[str, Any], members: Sequence[Mapping[str, Any]]) -> bool:
    """Whether cracks of a member of the group were measured at the end."""
    varied = group.get("varied", {})
    own = [m for m in members if all(m.get(key) == value for key, value in varied.items())]
    return any(at_end(member) for member in own)


def _group(group: Mapping[str, Any], *, starred: bool) -> Table:
    """Statistics of a group.

    Args:
        starred: whether the cracks of some members were measured at the end.
    """
    rows: list[tuple[str, ...]] = []
    for name, s in group.get("statistics", {}).items():
        number = named(name)
        deviation, interval = s["standard_deviation"], s["interval"]
        if s["count"] < FEWEST or name == "wall_s":
            interval = None  # folders of earlier versions have one
        rows.append(
            (
                number.label + ("*" if starred and name in AT_T2 else ""),
                number.unit,
                str(s["count"]),
                number.shown(float(s["mean"])),
                "" if deviation is None else number.shown(deviation),
                "" if interval is None else " to ".join(map(number.shown, interval)),
                f"{number.shown(s['smallest'])} to {number.shown(s['largest'])}",
            )
        )
    header: tuple[str, ...]
    header = ("", "unit", "members", "mean", "standard deviation", "95 % of the mean", "range")
    varied = label([(k, v) for k, v in group.get("varied", {}).items()])
    caption = varied[0].upper() + varied[1:]
    if not any(row[5] for row in rows):
        rows, header = [row[:5] + row[6:] for row in rows], header[:5] + header[6:]
        caption += f"; no confidence interval below {FEWEST} members"
    return Table(rows, header, caption + (f" (*: some {MEASURED_AT_END})" if starred else ""))
