"""The lattice a second time, bar by bar in NumPy, from the paper's description alone.

Nothing here comes from the program: nodes are keyed by their place in half module edges, every
module brings a quarter of its twelve edges, its eight diagonals, and half a bar towards each
neighbour's centre (Section 2, Fig. 1(a)). Slow and obvious, for small bodies.
"""

import itertools
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Place = tuple[int, int, int]

CORNERS = [np.array(c) for c in itertools.product((0, 2), repeat=3)]
DIAGONAL = np.sqrt(3) / 2


def _bars_and_masses(modules: list[Place]) -> tuple[dict[tuple[Place, Place], float], dict]:
    bars: dict[tuple[Place, Place], float] = defaultdict(float)
    masses: dict[Place, float] = defaultdict(float)
    present = set(modules)
    for module in modules:
        low = 2 * np.array(module)
        centre = tuple((low + 1).tolist())
        masses[centre] += 1 / 2
        corners = [tuple((low + c).tolist()) for c in CORNERS]
        for corner in corners:
            masses[corner] += 1 / 16
            bars[centre, corner] += 1.0
        for a, b in itertools.combinations(corners, 2):
            if sum(x != y for x, y in zip(a, b, strict=True)) == 1:
                bars[a, b] += 1 / 4
        for axis in range(3):
            neighbour = tuple(n + (a == axis) for a, n in enumerate(module))
            if neighbour in present:
                bars[centre, tuple(2 * n + 1 for n in neighbour)] += 1.0
    return bars, masses


def _cubic_26(modules: list[Place]) -> tuple[dict[tuple[Place, Place], float], dict]:
    """The same for cubes without a centre node, whose corners are all connected to each other."""
    bars: dict[tuple[Place, Place], float] = defaultdict(float)
    masses: dict[Place, float] = defaultdict(float)
    for module in modules:
        corners = [tuple((2 * np.array(module) + c).tolist()) for c in CORNERS]
        for corner in corners:
            masses[corner] += 1 / 8
        for a, b in itertools.combinations(corners, 2):
            axes = sum(x != y for x, y in zip(a, b, strict=True))
            bars[a, b] += {1: 1 / 4, 2: 1 / 2, 3: 1.0}[axes]  # of how many modules it is a part
    return bars, masses


@dataclass(frozen=True)
class Body:
    """Bars and nodes of the modules of a mask.

    Attributes:
        mask: (nz, ny, nx). spacing: L, m. surface_weights: False gives every bar its whole section.
        offsets: (nodes, 3) how far the nodes lie off their places in the regular lattice, m.
        lattice: its name in a scene.
    """

    mask: npt.NDArray[np.bool_]
    spacing: float = 1.0
    surface_weights: bool = True
    offsets: Array | float = 0.0
    lattice: str = "module"

    @cached_property
    def _census(self) -> tuple[dict[tuple[Place, Place], float], dict[Place, float]]:
        modules = [(int(i), int(j), int(k)) for k, j, i in np.argwhere(self.mask)]
        return _cubic_26(modules) if self.lattice == "cubic-26" else _bars_and_masses(modules)

    @cached_property
    def places(self) -> npt.NDArray[np.int64]:
        """(nodes, 3) places x, y, z in half module edges; odd is a centre."""
        return np.array(sorted(self._census[1]))

    @cached_property
    def mass_shares(self) -> Array:
        """(nodes,) mass over that of a module."""
        return np.array([self._census[1][tuple(p)] for p in self.places.tolist()])

    @cached_property
    def ends(self) -> npt.NDArray[np.int64]:
        """(bars, 2) node numbers."""
        number = {tuple(p): n for n, p in enumerate(self.places.tolist())}
        return np.array([(number[a], number[b]) for a, b in self._census[0]])

    @cached_property
    def weights(self) -> Array:
        """(bars,) share of a whole bar."""
        shares = np.array(list(self._census[0].values()))
        return shares if self.surface_weights else np.ones_like(shares)

    @cached_property
    def rest(self) -> Array:
        """(bars, 3) vectors between the ends at rest, m."""
        place = 0.5 * self.spacing * self.places + self.offsets
        return place[self.ends[:, 1]] - place[self.ends[:, 0]]

    @cached_property
    def lengths(self) -> Array:
        """(bars,) lengths at rest, m."""
        return np.linalg.norm(self.rest, axis=1)

    @cached_property
    def diagonal(self) -> npt.NDArray[np.bool_]:
        """(bars,) True for diagonal bars."""
        return (self.places[self.ends[:, 1]] != self.places[self.ends[:, 0]]).all(axis=1)

    @cached_property
    def positions(self) -> Array:
        """(nodes, 3) at rest, m, the prism centred on x = y = 0 and standing on z = 0."""
        _, ny, nx = self.mask.shape
        return 0.5 * self.spacing * (self.places - np.array([nx, ny, 0])) + self.offsets

    @cached_property
    def family(self) -> npt.NDArray[np.int64]:
        """(bars,) number of the bar's family: by its length, but for the module's diagonals."""
        if self.lattice == "module":
            return self.diagonal.astype(np.int64)
        return (self.places[self.ends[:, 1]] != self.places[self.ends[:, 0]]).sum(axis=1) - 1

    def per_bar(self, *values: float) -> Array:
        """(bars,) a property of the families, spread over the bars."""
        return np.array(values)[self.family]

    def strains(self, displacement: Array) -> Array:
        """(bars,) engineering strains at any displacement (nodes, 3), m."""
        now = self.rest + displacement[self.ends[:, 1]] - displacement[self.ends[:, 0]]
        return np.linalg.norm(now, axis=1) / self.lengths - 1

    def forces(
        self, displacement: Array, stiffness: tuple[float, ...], integrity: Array | float = 1.0
    ) -> Array:
        """(nodes, 3) N, from axial stiffnesses EA of the families and what bars keep."""
        now = self.rest + displacement[self.ends[:, 1]] - displacement[self.ends[:, 0]]
        length = np.linalg.norm(now, axis=1)
        pull = integrity * self.weights * self.per_bar(*stiffness) * (length / self.lengths - 1)
        force = np.zeros_like(displacement)
        along = (pull / length)[:, None] * now
        np.add.at(force, self.ends[:, 0], along)
        np.add.at(force, self.ends[:, 1], -along)
        return force

    def strain_energy(
        self, displacement: Array, stiffness: tuple[float, ...], integrity: Array | float = 1.0
    ) -> float:
        """J, as ``forces``."""
        whole = self.weights * self.per_bar(*stiffness) * self.lengths
        return float(np.sum(0.5 * integrity * whole * self.strains(displacement) ** 2))

    def stiffness_matrix(self, stiffness: tuple[float, ...], integrity: Array | float = 1.0):
        """(3 nodes, 3 nodes) sparse stiffness at rest, N/m, as ``forces``."""
        from scipy import sparse

        along = self.rest / self.lengths[:, None]
        bars, nodes = len(self.ends), len(self.places)
        rows = np.repeat(np.arange(bars), 3)
        columns = 3 * self.ends[:, :, None] + np.arange(3)
        stretch = sparse.csr_matrix(
            (along.ravel(), (rows, columns[:, 1].ravel())), shape=(bars, 3 * nodes)
        ) - sparse.csr_matrix(
            (along.ravel(), (rows, columns[:, 0].ravel())), shape=(bars, 3 * nodes)
        )
        k = integrity * self.weights * self.per_bar(*stiffness) / self.lengths
        return (stretch.T @ sparse.diags(k) @ stretch).tocsr()

    # -- the program's layout ----------------------------------------------------------------------

    @cached_property
    def index(self) -> tuple[npt.NDArray[np.int64], ...]:
        """Index of every node in the program's (sublattices, *S) site arrays."""
        i, j, k = self.places.T // 2 + 1
        return self.places[:, 0] % 2, k, j, i

    def spread(self, values: Array) -> Array:
        """(nodes, 3) values in the program's layout, zero elsewhere."""
        nz, ny, nx = self.mask.shape
        sublattices = 2 if self.lattice == "module" else 1
        field = np.zeros((sublattices, nz + 3, ny + 3, nx + 3, 3))
        field[self.index] = values
        return field

    def bar_values(self, field: Array, midpoints: Callable[..., Array]) -> Array:
        """(bars,) values from the program's (S, 14) field, bars matched by their mid-points.

        Args:
            midpoints: ``Lattice.bar_midpoints``.
        """
        site = np.argwhere(np.ones(field.shape[:3], dtype=bool))
        bars = np.tile(np.arange(14), len(site))
        site = np.repeat(site, 14, axis=0)
        middle = np.rint(4 * midpoints(site, bars) / self.spacing).astype(int)
        found = dict(zip(map(tuple, middle.tolist()), field.reshape(-1), strict=True))
        mine = (self.positions - self.offsets)[self.ends].mean(axis=1)
        return np.array(
            [found[tuple(p)] for p in np.rint(4 * mine / self.spacing).astype(int).tolist()]
        )
