"""The data of a report's page, as the template shows them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any


@dataclass(frozen=True)
class Link:
    """A cell that leads to a file."""

    text: str
    href: str


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        header: of the columns; empty for a table of names and values.
    """

    rows: Sequence[tuple[str | Link, ...]]
    header: tuple[str, ...] = ()
    caption: str = ""

    @property
    def bare(self) -> Table:
        """The table without its caption."""
        return replace(self, caption="")


@dataclass(frozen=True)
class Figure:
    """An interactive figure.

    Attributes:
        json: of Plotly.
        marker: how the time of the slider shows: "line" (an upright line at the time), "point" (a
            point that follows a path), "map" (later events are pale), "none" (not at all).
        along: x and y of the path of a point.
        point: number of the trace that is the point.
    """

    name: str
    json: str
    marker: str = "line"
    along: tuple[list[float], list[float]] = ((), ())  # type: ignore[assignment]
    point: int = 0


@dataclass(frozen=True)
class Picture:
    """An embedded image: its caption, and its bytes as a data address."""

    caption: str
    data: str


@dataclass(frozen=True)
class Snapshots:
    """Pictures of one view over time.

    Attributes:
        times: s.
        note: a line that explains the pictures.
    """

    view: str
    times: list[float]
    pictures: list[Picture]
    note: str = ""


@dataclass(frozen=True)
class Page:
    """A page.

    Attributes:
        lead: a sentence on the specimen or the ensemble.
        cards: label and value of the most important numbers.
        asked, happened, cost, repeat: tables of the page's four parts.
        notes: warnings. left_out: features that the scene leaves out. scene: its file.
        times: of the samples, s. readings: values at these times. events: names and times, s.
        snapshot_note: why the pictures are not those of the painter.
        commands: that wrote the folder.
    """

    title: str
    name: str
    lead: str
    cards: list[tuple[str, str]] = field(default_factory=list)
    asked: list[Table] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    scene: str = ""
    times: list[float] = field(default_factory=list)
    readings: list[dict[str, Any]] = field(default_factory=list)
    events: list[tuple[str, float | None]] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    snapshots: list[Snapshots] = field(default_factory=list)
    snapshot_note: str = ""
    happened: list[Table] = field(default_factory=list)
    images: list[Picture] = field(default_factory=list)
    cost: list[Table] = field(default_factory=list)
    repeat: list[Table] = field(default_factory=list)
    commands: list[str] = field(default_factory=list)

    def script(self) -> str:
        """The data of the page's JavaScript, as JSON that may stand in a script element."""
        data = {
            "times": self.times,
            "readings": self.readings,
            "figures": [
                {
                    "name": f.name,
                    "plot": json.loads(f.json),
                    "marker": f.marker,
                    "along": f.along,
                    "point": f.point,
                }
                for f in self.figures
            ],
            "snapshots": [
                {"view": s.view, "times": s.times, "note": s.note} for s in self.snapshots
            ],
        }
        return json.dumps(data, allow_nan=False).replace("</", "<\\/")
