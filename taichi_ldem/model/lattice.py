"""The lattice: a prism of cubic modules, one byte a site (Section 2, Fig. 1 of the paper).

Sites are numbered ``[k, j, i]`` along z, y, x and padded by one ghost layer on every side, so that
a kernel reaches every neighbour by a constant offset. A site carries a corner node and, where the
module that starts there exists and its unit cell has one, a centre node half a module further. Its
byte says which of the eight modules around the corner node exist: bit ``4 dz + 2 dy + dx`` stands
for module ``(k - 1 + dz, j - 1 + dy, i - 1 + dx)``, so bit 7 is the site's own module. The byte
decides everything: which of the unit cell's bars exist (see ``cell``), the share of a whole bar
that they carry, and the masses of the nodes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.model import flaws
from taichi_ldem.model.cell import MODULE, MODULES, UnitCell
from taichi_ldem.model.flaws import turned

_WHOLE = (slice(None), slice(None), slice(None))
_FREE = np.stack(
    [(MODULES[:, np.arange(8) ^ side] == MODULES).all(axis=1) for side in (1, 2, 4)], axis=1
)
"""(256, 3): whether a corner node has the same modules on both sides of it along x, y, z."""


@dataclass(frozen=True)
class Lattice:
    """A body made of cubic modules.

    Attributes:
        mask: (nz, ny, nx) True where a module exists.
        spacing: module edge L, m.
        surface_weights: whether surface and edge bars carry 1/2 and 1/4 (``UnitCell.weights``).
        perturbation: largest way that a node lies off its place in the regular lattice, in L.
        seed: of these ways.
        cell: the bars of a site.
    """

    mask: npt.NDArray[np.bool_]
    spacing: float
    surface_weights: bool = True
    perturbation: float = 0.0
    seed: int = 0
    cell: UnitCell = MODULE

    @property
    def modules(self) -> tuple[int, int, int]:
        """Numbers of modules (nx, ny, nz) of the prism that holds the body."""
        nz, ny, nx = self.mask.shape
        return nx, ny, nz

    @property
    def sites(self) -> tuple[int, int, int]:
        """Shape of every site array: (nz + 3, ny + 3, nx + 3)."""
        nz, ny, nx = self.mask.shape
        return nz + 3, ny + 3, nx + 3

    @property
    def origin(self) -> tuple[float, float, float]:
        """Position of corner site (1, 1, 1), m: the prism is centred and stands on z = 0."""
        nx, ny, _ = self.modules
        return -0.5 * nx * self.spacing, -0.5 * ny * self.spacing, 0.0

    @cached_property
    def code(self) -> npt.NDArray[np.uint8]:
        """(nz + 3, ny + 3, nx + 3) the byte of every site."""
        nz, ny, nx = self.mask.shape
        padded = np.zeros((nz + 4, ny + 4, nx + 4), dtype=np.uint8)
        padded[2:-2, 2:-2, 2:-2] = self.mask
        code = np.zeros(self.sites, dtype=np.uint8)
        for bit in range(8):
            dz, dy, dx = bit >> 2, bit >> 1 & 1, bit & 1
            code |= padded[dz : dz + nz + 3, dy : dy + ny + 3, dx : dx + nx + 3] << bit
        return code

    @cached_property
    def _census(self) -> npt.NDArray[np.int64]:
        return np.bincount(self.code.ravel(), minlength=256)

    @property
    def bars(self) -> int:
        """Number of bars."""
        return int(self._census @ (self.cell.shares > 0).sum(axis=1))

    @property
    def nodes(self) -> int:
        """Number of nodes of all kinds."""
        return int(self._census @ (self.cell.node_shares > 0).sum(axis=1))

    @property
    def volume(self) -> float:
        """Volume of the body, m3."""
        return float(self.mask.sum()) * self.spacing**3

    def positions(self) -> npt.NDArray[np.float64]:
        """Positions of all nodes at rest, m: (sublattices, *S, 3)."""
        return self.grid() if self.offsets is None else self.grid() + self.offsets

    @cached_property
    def offsets(self) -> npt.NDArray[np.float64] | None:
        """(sublattices, *S, 3) way of each node from its regular place, m; None where all are 0.

        Uniform in a ball of radius ``perturbation`` L; a corner node on a face keeps to it and one
        on an edge to the edge, so that faces stay flat: it moves along an axis only where the
        modules on either side of it are the same.
        """
        if not self.perturbation:
            return None
        shape = (self.cell.sublattices, *self.sites)
        raw = np.random.PCG64(np.random.SeedSequence(self.seed)).random_raw(4 * math.prod(shape))
        drawn = ((raw >> np.uint64(12)).astype(np.float64) + 0.5).reshape(4, *shape) * 2.0**-52
        z, angle = 2 * drawn[0] - 1, 2 * math.pi * drawn[1]
        radius = self.perturbation * self.spacing * np.cbrt(drawn[2])
        flat = radius * np.sqrt(1 - z**2)
        offsets = np.stack([flat * np.cos(angle), flat * np.sin(angle), radius * z], axis=-1)
        offsets[0] *= _FREE[self.code]
        return np.asarray(offsets * self.exists()[..., None])

    def grid(self, part: tuple[slice, slice, slice] = _WHOLE) -> npt.NDArray[np.float64]:
        """Places of all nodes in the regular lattice, m: (sublattices, *S, 3).

        Args:
            part: of the sites, along z, y and x; the other places are left out.
        """
        axes = [
            (start + (np.arange(n) - 1) * self.spacing)[chosen]
            for start, n, chosen in zip(self.origin, self.sites[::-1], part[::-1], strict=True)
        ]
        z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        corner = np.stack([x, y, z], axis=-1)
        return np.stack([corner + 0.5 * s * self.spacing for s in range(self.cell.sublattices)])

    def exists(self) -> npt.NDArray[np.bool_]:
        """(sublattices, *S) True where a node exists."""
        return np.moveaxis(self.cell.node_shares[self.code] > 0, -1, 0)

    def bar_exists(self, part: tuple[slice, slice, slice] = _WHOLE) -> npt.NDArray[np.bool_]:
        """(nz + 3, ny + 3, nx + 3, bars) True where a bar exists; of a part of the sites only."""
        return np.asarray((self.cell.shares > 0)[self.code[part]])

    def bar_shares(self) -> npt.NDArray[np.float64]:
        """(nz + 3, ny + 3, nx + 3, bars) share of a whole bar; zero where there is none."""
        return np.asarray(self.cell.weights(self.surface_weights)[self.code])

    def bar_midpoints(
        self, site: npt.NDArray[np.int64], bar: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.float64]:
        """Mid-points of bars in the regular lattice, m: (n, 3), from sites (n, 3), bars (n,)."""
        start = self.cell.starts[bar]
        offset = (site[:, ::-1] - 1 + start + 0.5 * self.cell.vectors[bar]) * self.spacing
        return np.asarray(self.origin) + offset

    def failed_bits(
        self, midpoint: npt.NDArray[np.float64], bar: npt.NDArray[np.integer[Any]]
    ) -> npt.NDArray[np.uint16]:
        """A bit for each of some bars at its site: (nz + 3, ny + 3, nx + 3).

        Args:
            midpoint: (n, 3) as from ``bar_midpoints``. Bars that the lattice has not are left out.
            bar: (n,).
        """
        known = bar < self.cell.bars
        midpoint, bar = midpoint[known], bar[known].astype(np.int64)
        offset = self.cell.starts[bar] + 0.5 * self.cell.vectors[bar]
        place = np.rint((midpoint - np.asarray(self.origin)) / self.spacing - offset)
        site = place.astype(np.int64)[:, ::-1] + 1
        inside = ((site >= 0) & (site < self.sites)).all(axis=1)
        bits = np.zeros(self.sites, dtype=np.uint16)
        which = (1 << bar[inside]).astype(np.uint16)
        np.bitwise_or.at(bits, tuple(site[inside].T), which)
        return bits

    def bars_crossing(
        self,
        axis: int,
        position: float,
        lower: tuple[float, float],
        upper: tuple[float, float],
        angle: float = 0.0,
    ) -> npt.NDArray[np.uint16]:
        """Bars that cross a rectangle normal to an axis: the bars that a notch removes.

        Nodes count at their places in the regular lattice, whatever their perturbation.

        Args:
            axis: 0, 1, 2 for a plane normal to x, y, z.
            position: of the plane along the axis, m. A plane through nodes is taken to lie just
                beyond them (``flaws.beyond``), so that it separates two node planes.
            lower, upper: corners of the rectangle along the two other axes, in the order x, y, z,
            m.
            angle: of the specimen's axes, in which the rectangle is given, to the lattice's, about
            z, radians.

        Returns:
            (nz + 3, ny + 3, nx + 3) one bit a bar.
        """
        return self.bars_through(flaws.rectangle(axis, position, lower, upper), angle)

    def bars_through(self, flaw: flaws.Flaw, angle: float = 0.0) -> npt.NDArray[np.uint16]:
        """Bars that cross a flaw; arguments and result otherwise as for ``bars_crossing``."""
        near = self._sites_near(turned(flaw.corners, -angle) if angle else flaw.corners)
        first, vectors = self.grid(near), self.cell.vectors * self.spacing
        if angle:
            first, vectors = turned(first, angle), turned(vectors, angle)
        middle = (0.0, 0.0, 0.5 * self.modules[2] * self.spacing)
        plane = flaw.plane(middle, self.spacing)
        cut = np.zeros(self.sites, dtype=np.uint16)
        existing = self.bar_exists(near)
        height = first @ flaw.normal
        for bar, vector in enumerate(vectors):
            rise = float(vector @ flaw.normal)
            if abs(rise) < 1e-9 * self.spacing:
                continue
            sublattice = self.cell.ends[bar][0][0]
            along = (plane - height[sublattice]) / rise
            hit = existing[..., bar] & (along >= 0) & (along < 1)
            places = first[sublattice] + along[..., None] * vector
            hit &= flaw.holds(places, flaws.NUDGE * self.spacing)
            cut[near] |= hit.astype(np.uint16) << bar
        return cut

    def _sites_near(self, places: npt.NDArray[np.float64]) -> tuple[slice, slice, slice]:
        """The sites of all bars that may reach into the box around some places (n, 3).

        With thousands of notches, looking at the whole lattice for each takes minutes.
        """
        origin, count = np.array(self.origin), np.array(self.sites[::-1])
        low = np.floor((places.min(axis=0) - origin) / self.spacing) - 2  # a bar is shorter than 2
        high = np.ceil((places.max(axis=0) - origin) / self.spacing) + 5
        x, y, z = (
            slice(int(a), int(b))
            for a, b in zip(np.clip(low, 0, count), np.clip(high, 0, count), strict=True)
        )
        return z, y, x


@dataclass(frozen=True)
class Part(Lattice):
    """The modules in a box of a lattice, at their places, with the offsets of its nodes.

    Its border is not that of the body: it says which modules, nodes and bars there are, but not
    their shares.

    Attributes:
        first: numbers of the box's first module along z, y and x; those of its first site too.
        whole: the lattice.
    """

    first: tuple[int, int, int] = field(kw_only=True)
    whole: Lattice = field(kw_only=True)

    @classmethod
    def around(cls, whole: Lattice, chosen: npt.NDArray[np.bool_]) -> "Part":
        """The smallest box that holds some modules of a lattice and those next to them.

        Args:
            chosen: (nz, ny, nx) True for these modules; one at least.
        """
        place = np.argwhere(chosen)
        low = np.maximum(place.min(axis=0) - 1, 0)
        high = np.minimum(place.max(axis=0) + 2, chosen.shape)
        box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        z, y, x = low.tolist()
        settings = {f.name: getattr(whole, f.name) for f in fields(Lattice)}
        settings["mask"] = whole.mask[box]
        return cls(**settings, first=(z, y, x), whole=whole)

    @property
    def origin(self) -> tuple[float, float, float]:
        """Position of corner site (1, 1, 1), m."""
        x, y, z = (
            start + n * self.spacing
            for start, n in zip(self.whole.origin, self.first[::-1], strict=True)
        )
        return x, y, z

    @cached_property
    def offsets(self) -> npt.NDArray[np.float64] | None:
        """(sublattices, *S, 3) way of each node from its regular place, m; None where all are 0."""
        of_all = self.whole.offsets
        if of_all is None:
            return None
        sites = zip(self.first, self.sites, strict=True)
        return of_all[(slice(None), *(slice(n, n + count) for n, count in sites))]


def prism(nx: int, ny: int, nz: int) -> npt.NDArray[np.bool_]:
    """Mask of a whole prism, (nz, ny, nx)."""
    return np.ones((nz, ny, nx), dtype=bool)


def disc(nx: int, ny: int, nz: int, diameter: float) -> npt.NDArray[np.bool_]:
    """Mask of a disc cut from a prism: the modules whose centre lies within it.

    Args:
        diameter: in units of the module edge.
    """
    x = np.arange(nx) + 0.5 - nx / 2
    y = np.arange(ny) + 0.5 - ny / 2
    inside = y[:, None] ** 2 + x[None, :] ** 2 <= (diameter / 2) ** 2
    return np.broadcast_to(inside, (nz, ny, nx)).copy()


def dumbbell_half_width(
    x: npt.NDArray[np.float64],
    width: float,
    narrow_width: float,
    narrow_length: float,
    fillet_radius: float,
) -> npt.NDArray[np.float64]:
    """Half the width of a dumb-bell at a distance ``x`` from its middle, all in one unit.

    The narrow part goes over to the tabs in arcs that begin tangent to it (ASTM D638, Fig. 1).
    """
    into = np.clip(np.abs(x) - narrow_length / 2, 0.0, fillet_radius)
    arc = fillet_radius - np.sqrt(fillet_radius**2 - into**2)
    return np.asarray(np.minimum(narrow_width / 2 + arc, width / 2))


def cut_out(
    nx: int,
    ny: int,
    nz: int,
    length: float,
    half_width: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]],
    angle: float = 0.0,
) -> npt.NDArray[np.bool_]:
    """Mask of a specimen cut from a prism: the modules whose centre lies within its outline.

    Args:
        length: of the specimen, in units of the module edge.
        half_width: half its width over the distance from its middle, in the same unit.
        angle: of its long side to x, radians.
    """
    x = np.arange(nx) + 0.5 - nx / 2
    y = (np.arange(ny) + 0.5 - ny / 2)[:, None]
    along = x * math.cos(angle) + y * math.sin(angle)
    across = y * math.cos(angle) - x * math.sin(angle)
    slack = 1e-9 * length  # centres that rounding alone would put outside
    inside = np.abs(along) <= length / 2 + slack
    inside &= np.abs(across) <= half_width(along) + slack
    return np.broadcast_to(inside, (nz, ny, nx)).copy()
