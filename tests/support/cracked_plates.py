"""Broken bars of cracks drawn by hand: curves cut the in-plane bars that they cross."""

from dataclasses import dataclass, field

import numpy as np

from taichi_ldem.scene import Plate
from taichi_ldem.storage.fields import BrokenBars

PLATE = Plate(size=(0.0928, 0.0928, 0.0032), modules_through_thickness=6)  # the paper's
START, END, RING = 1.5e-3, 7.0e-3, 7.5e-3
"""Radial cracks grow from START to END, the ring from RING on within 0.4 ms, s."""


@dataclass
class Drawing:
    """Collects the broken bars of curves.

    Attributes:
        plate: whose bars are cut.
        rows: of (time, x, y, z, bar).
    """

    plate: Plate = PLATE
    rows: list[np.ndarray] = field(default_factory=list)

    def curve(self, points: np.ndarray, time: np.ndarray, depth: float = 1.0) -> None:
        """Cut what a fine polyline (n, 2), m, crosses, from the bottom to a share of the height."""
        spacing, layers = self.plate.spacing, self.plate.modules_through_thickness
        for shift, first_bar in ((0.0, 0), (0.5, 3)):
            # lines of nodes at whole numbers: corner nodes, then centre nodes
            nodes = points / spacing + 0.5 * np.array(self.plate.modules[:2]) - shift
            heights = (np.arange(layers + (shift == 0)) + shift) * spacing
            heights = heights[heights <= depth * self.plate.size[2] * (1 + 1e-9)]
            for axis in (0, 1):  # a bar along x is cut where the curve crosses a row of nodes
                cell = np.floor(nodes[:, 1 - axis])
                at = np.flatnonzero(np.diff(cell) != 0)
                middle = np.empty((len(at), 2))
                middle[:, axis] = np.floor(nodes[at, axis]) + 0.5
                middle[:, 1 - axis] = np.maximum(cell[at], cell[at + 1])
                place = (middle + shift - 0.5 * np.array(self.plate.modules[:2])) * spacing
                for z in heights:
                    self._add(
                        time[at], np.column_stack([place, np.full(len(at), z)]), first_bar + axis
                    )

    def ray(
        self, tip: np.ndarray, start: float = START, end: float = END, depth: float = 1.0
    ) -> None:
        """A straight crack from the plate's centre to a tip, at constant speed."""
        share = np.linspace(0.0, 1.0, 4000)
        self.curve(share[:, None] * tip, start + share * (end - start), depth)

    def wide_ray(self, tip: np.ndarray, width: float) -> None:
        """A band of parallel cracks from the plate's centre to a tip, half a module apart."""
        across = np.array([-tip[1], tip[0]]) / np.hypot(*tip)
        share = np.linspace(0.0, 1.0, 4000)
        time = START + share * (END - START)
        for off in np.arange(-width / 2, width / 2, 0.5 * self.plate.spacing):
            self.curve(share[:, None] * tip + off * across, time)

    def arc(self, centre: np.ndarray, radius: float, begin: float, stop: float) -> None:
        """A part of a ring between two angles, after END."""
        angle = np.linspace(begin, stop, 6000)
        points = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self.curve(points, RING + 0.4e-3 * np.linspace(0.0, 1.0, len(angle)))

    def crush(self, radius: float, rng: np.random.Generator) -> None:
        """Most in-plane bars within a radius of the centre, by 3 ms."""
        self._scatter(rng, 60_000, (0, 1, 3, 4), radius)

    def noise(self, count: int, rng: np.random.Generator) -> None:
        """Single broken bars of all kinds all over the plate, at any time."""
        self._scatter(rng, count, tuple(range(14)), None)

    def delaminate(self, radius: float) -> None:
        """A crack parallel to the plate, half-way up: bars along z and diagonals."""
        spacing = self.plate.spacing
        side = np.arange(-radius, radius, spacing)
        x, y = (a.ravel() for a in np.meshgrid(side, side))
        for bar in (2, *range(6, 14)):
            place = np.column_stack([x, y, np.full(len(x), 3.25 * spacing)])
            self._add(np.full(len(x), 3e-3), place, bar)

    def bars(self) -> BrokenBars:
        """All broken bars, each once, in order of time."""
        rows = np.concatenate([np.empty((0, 5)), *self.rows])
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        _, first = np.unique(np.round(rows[:, 1:], 9), axis=0, return_index=True)
        rows = rows[np.sort(first)]
        return BrokenBars(rows[:, 0], rows[:, 1:4], rows[:, 4].astype(np.uint8))

    def _add(self, time: np.ndarray, place: np.ndarray, bar: int) -> None:
        self.rows.append(np.column_stack([time, place, np.full(len(time), float(bar))]))

    def _scatter(
        self, rng: np.random.Generator, count: int, kinds: tuple[int, ...], radius: float | None
    ) -> None:
        """Bars at random places of the in-plane lattice (others at the same places)."""
        spacing, half = self.plate.spacing, 0.5 * np.array(self.plate.modules)
        bar = rng.choice(kinds, count)
        site = rng.integers(0, self.plate.modules, (count, 3))
        middle = np.zeros((count, 3))
        for kind in range(14):
            shift = {0: (0.5, 0, 0), 1: (0, 0.5, 0), 3: (1, 0.5, 0.5), 4: (0.5, 1, 0.5)}
            middle[bar == kind] = shift.get(kind, (0.25, 0.25, 0.25))
        place = (site + middle - [half[0], half[1], 0.0]) * spacing
        time = rng.uniform(START, 3e-3 if radius else 9e-3, count)
        inside = (
            np.ones(count, dtype=bool) if radius is None else np.hypot(*place[:, :2].T) < radius
        )
        for kind in kinds:
            chosen = inside & (bar == kind)
            self._add(time[chosen], place[chosen], kind)


def tips_on_circle(
    count: int, centre: np.ndarray, diameter: float, rng: np.random.Generator
) -> np.ndarray:
    """Ends (n, 2), on a circle, of rays from the origin 28 degrees apart or more."""
    least = np.radians(28.0)
    free = rng.dirichlet(np.ones(count)) * (2 * np.pi - count * least)
    angle = np.cumsum(free + least) + rng.uniform(0, 2 * np.pi)
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # |s ray - centre| = radius
    along = ray @ centre
    reach = along + np.sqrt(along**2 - centre @ centre + (diameter / 2) ** 2)
    return ray * reach[:, None]
