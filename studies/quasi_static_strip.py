"""What a crack costs by the rule of `material.fracture = "crack"`, in a solver of its own.

    python -m studies.quasi_static_strip [--angle DEGREES ...] [--longitudinal AREA]

A strip of one cell of the lattice through its thickness, periodic along it, is solved statically
and for small strains with SciPy's sparse LU. Nothing here comes from the program but the paper's
stiffness and fracture areas. The bar that needs the smallest load by the rule is removed, the strip
is solved again, and so on. The cost of the crack is the largest load that it needs after the first
third of its way, as the energy stored ahead of it over G_f. No length of the material enters: the
rule knows G_f only. ``--longitudinal`` gives longitudinal bars another fracture area, and diagonals
what a plane (100) then leaves for them.
"""

import argparse
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from taichi_ldem.scene.equations import axial_stiffness, fracture_areas

Array = npt.NDArray[np.float64]

NU = 0.25
HEIGHT, WIDTH, NOTCH = 24.0, 50.0, 0.4
"""Of the strip, module edges; share of its width that the notch takes."""

GRIP = 1.0
"""Depth of the held nodes at either edge, module edges."""

ADVANCE = 10.0
"""How far a crack is followed, module edges."""

SHIFTS = ((0.0, 0.0), (0.3, 0.2))
"""Places of the strip in the lattice."""


@dataclass(frozen=True)
class Rule:
    """When a bar at a tip fails: see `solver.tips`.

    Attributes:
        most: largest opening that counts, over the bar's elongation.
        passed: opening over the elongation from which on a bar is on a flank.
        bars: most failed bars of a node at a tip.
    """

    most: float = 2 * math.pi
    passed: float = 4 * math.pi
    bars: int = 4


def family_areas(longitudinal: float | None) -> tuple[float, float]:
    """Fracture areas of a longitudinal and a diagonal bar, L^2: of the former, or the paper's.

    A plane (100) cuts two longitudinal bars and four diagonals per L^2 (Eqs. (4) to (8)).
    """
    if longitudinal is None:
        return fracture_areas(NU)
    return longitudinal, (1 - 2 * longitudinal) / 4


def unit_bars(
    longitudinal: float | None = None,
) -> list[tuple[int, int, tuple[float, float, float], float, float]]:
    """Bars of a module: sublattices of the ends, vector, EA (E = L = 1), fracture area."""
    stiffness, areas = axial_stiffness(1.0, NU, 1.0), family_areas(longitudinal)
    along = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    bars = [(s, s, axis, stiffness[0], areas[0]) for s in (0, 1) for axis in along]
    for x, y, z in itertools.product((-0.5, 0.5), repeat=3):
        bars.append((1, 0, (x, y, z), stiffness[1], areas[1]))
    return bars


class Strip:
    """A strip at an angle to the lattice with a notch in its middle plane, pulled apart by 1.

    Attributes:
        ends: (bars, 2) numbers of the nodes. middle: (bars, 2) mid-points across and along.
        alive: (bars,) which have not failed. stiffness, area: (bars,) EA/L0 and fracture area.
        released: G at this separation by linear elasticity.
    """

    def __init__(self, angle: float, shift: tuple[float, float], longitudinal: float | None = None):
        self.turn = math.radians(angle)
        places, ends, kinds = self._cut(shift)
        bars = unit_bars(longitudinal)
        vectors = np.array([bar[2] for bar in bars])
        length = np.linalg.norm(vectors, axis=1)
        c, s = math.cos(self.turn), math.sin(self.turn)
        direction = (vectors / length[:, None]) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]).T
        self.ends = ends
        self.direction = direction[kinds]
        self.stiffness = (np.array([bar[3] for bar in bars]) / length)[kinds]
        self.area = np.array([bar[4] for bar in bars])[kinds]
        half = 0.5 * self.direction[:, :2] * length[kinds, None]
        self.middle = places[ends[:, 0]] + half
        low, high = self.middle[:, 0] - half[:, 0], self.middle[:, 0] + half[:, 0]
        slope = np.divide(half[:, 1], half[:, 0], out=np.zeros(len(low)), where=half[:, 0] != 0)
        along = self.middle[:, 1] - slope * (self.middle[:, 0] - 1e-3)
        self.tip = (NOTCH - 0.5) * WIDTH
        self.alive = ~(((low - 1e-3) * (high - 1e-3) < 0) & (along < self.tip))
        self._hold(places)

    def _cut(self, shift: tuple[float, float]) -> tuple[Array, npt.NDArray, npt.NDArray]:
        """(nodes, 2) places, (bars, 2) nodes at the ends, (bars,) kinds of bars."""
        number, places = {}, []
        reach = int(max(HEIGHT, WIDTH)) + 3
        c, s = math.cos(self.turn), math.sin(self.turn)
        for kind, i, j in itertools.product((0, 1), range(-reach, reach), range(-reach, reach)):
            x, y = i + kind / 2, j + kind / 2
            across, along = c * x + s * y - shift[0], -s * x + c * y - shift[1]
            if abs(across) <= HEIGHT / 2 and abs(along) <= WIDTH / 2:
                number[kind, i, j] = len(places)
                places.append((across, along))
        ends, kinds = [], []
        for (kind, i, j), here in number.items():
            for which, (first, second, vector, *_) in enumerate(unit_bars()):
                step = [round(v + (first - second) / 2) for v in vector[:2]]
                there = number.get((second, i + step[0], j + step[1]))
                if first == kind and there is not None:
                    ends.append((here, there))
                    kinds.append(which)
        return np.array(places), np.array(ends), np.array(kinds)

    def _hold(self, places: Array) -> None:
        """Prescribe the displacement of the grips, and set up the matrix of elongations."""
        upper = places[:, 0] > places[:, 0].max() - GRIP
        lower = places[:, 0] < places[:, 0].min() + GRIP
        self.free = np.repeat(~(upper | lower), 3)
        self.held = np.zeros((len(places), 3))
        self.held[upper, 0], self.held[lower, 0] = 0.5, -0.5
        height = places[upper, 0].min() - places[lower, 0].max()
        self.released = 1 / (1 - NU**2) / (2 * height)
        row = np.repeat(np.arange(len(self.ends)), 3)
        axis = np.tile(np.arange(3), len(self.ends))
        first, second = (3 * np.repeat(self.ends[:, end], 3) + axis for end in (0, 1))
        values = self.direction.ravel()
        self.elongations = sp.csr_matrix(
            (np.r_[values, -values], (np.r_[row, row], np.r_[second, first])),
            shape=(len(self.ends), 3 * len(places)),
        )

    def solve(self) -> Array:
        """(bars,) elongations in equilibrium."""
        b = self.elongations
        whole = b.T @ sp.diags(self.stiffness * self.alive) @ b
        free, moved = self.free, self.held.ravel().copy()
        matrix = whole[free][:, free].tocsc() + 1e-9 * sp.identity(free.sum(), format="csc")
        options = {"SymmetricMode": True}
        lu = splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        moved[free] = lu.solve(-(whole[free][:, ~free] @ moved[~free]))
        return np.asarray(b @ moved)

    def share(self, elongation: Array, rule: Rule) -> Array:
        """(bars,) G_f over the strip's G at which each bar fails; 0 for a bar that is at no tip."""
        opening, count = np.zeros(len(self.held)), np.zeros(len(self.held), dtype=int)
        for end in (0, 1):
            nodes = self.ends[~self.alive, end]
            np.maximum.at(opening, nodes, elongation[~self.alive])
            np.add.at(count, nodes, 1)
        opening[count > rule.bars] = 0.0
        parts = opening[self.ends].max(axis=1)
        at_tip = self.alive & (elongation > 0) & (parts <= rule.passed * elongation)
        work = 0.5 * self.stiffness * elongation * np.minimum(parts, rule.most * elongation)
        return np.asarray(np.where(at_tip, work / (self.area * self.released), 0.0))


@dataclass(frozen=True)
class Crack:
    """What a crack did.

    Attributes:
        cost: G_c / G_f.
        turned: by how much its path leaves the notch's direction, degrees, positive towards (100).
    """

    cost: float
    turned: float


def grow(
    angle: float,
    rule: Rule,
    shift: tuple[float, float] = (0.0, 0.0),
    longitudinal: float | None = None,
) -> Crack:
    """Let a crack grow whose notch lies at an angle to a plane (100), degrees."""
    strip = Strip(angle, shift, longitudinal)
    aside = np.abs(strip.middle[:, 0]) > 0.3 * HEIGHT
    aside |= strip.middle[:, 1] < strip.tip - 3
    front, most = 0.0, 0.0
    notched = ~strip.alive
    while front < ADVANCE:
        share = np.where(aside, 0.0, strip.share(strip.solve(), rule))
        if front > ADVANCE / 3:
            most = max(most, 1 / share.max())
        fails = share > (1 - 1e-3) * share.max()
        strip.alive[fails] = False
        front = max(front, strip.middle[fails, 1].max() - strip.tip)
    across, along = strip.middle[~strip.alive & ~notched].T
    way = along - strip.tip > ADVANCE / 4
    slope = np.polyfit(along[way], across[way], 1)[0]
    return Crack(float(most), math.degrees(math.atan(slope)))


def main(words: Sequence[str] | None = None) -> None:
    """Print cost and path for each angle."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--angle", type=float, action="append", help="degrees; may be repeated")
    parser.add_argument("--longitudinal", type=float, metavar="AREA", help="fracture area, L^2")
    parser.add_argument("--most", type=float, default=Rule.most, help="see Rule")
    parser.add_argument("--passed", type=float, default=Rule.passed, help="see Rule")
    parser.add_argument("--bars", type=int, default=Rule.bars, help="see Rule")
    options = parser.parse_args(words)
    rule = Rule(options.most, options.passed, options.bars)
    for angle in options.angle or (0.0, 15.0, 22.5, 30.0, 45.0):
        found = [grow(angle, rule, shift, options.longitudinal) for shift in SHIFTS]
        costs, turned = ([f"{getattr(c, name):.2f}" for c in found] for name in ("cost", "turned"))
        print(
            f"{angle:5.1f} degrees: G_c / G_f = {' '.join(costs)}, "
            f"path turns towards (100) by {' '.join(turned)} degrees",
            flush=True,
        )


if __name__ == "__main__":
    main()
