"""Random material: Weibull fields of fracture energy, Young's modulus and density, Eqs. (14)-(17).

Eqs. (15), (16) have their symbols mixed up. Meant is a factor x on the mean (Eq. (14)) that is
Weibull with shape gamma and scale 1 / Gamma(1 + 1/gamma), so that its mean is one; the shape
follows from the coefficient of variation (Eq. (17)) through CV^2 = Gamma(1 + 2/gamma) / Gamma(1 +
1/gamma)^2 - 1.

Fracture energy and modulus are a bar's, taken at its mid-point; density is a module's, taken at
its centre. Each property has a stream of its own: naming one does not change another. Only raw bits
of NumPy's PCG64 are used, whose stream NumPy keeps, so a seed means the same field in every
version.

With a correlation length l the factors come from a Gaussian field in space that knows no lattice,
with the covariance exp(-(r/l)^2): white noise on a grid of 0.4 l, smoothed by exp(-2 (r/l)^2) and
scaled to unit variance exactly at every point, then mapped through its distribution to Weibull's.
The grid's noise is drawn in blocks by their number, so any body of any module edge sees a piece of
the same field.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import DISORDERED, Disorder, Scene
from taichi_ldem.scene.weibull import (
    SMALLEST_CV,
    cv_from_shape,
    shape_from_cv,
    shape_from_data,
    shape_of,
)

__all__ = [
    "SMALLEST_CV",
    "Drawn",
    "GaussianField",
    "cv_from_shape",
    "draw",
    "shape_from_cv",
    "shape_from_data",
    "shape_of",
    "varies",
]

Array = npt.NDArray[np.float64]

GRID = 0.4
"""Spacing of the noise over the correlation length: covariances are off by less than 1e-6."""

REACH = 7
"""Points of the noise taken on either side: the next one weighs 2e-7."""

BLOCK = 16
"""Edge of a block of noise that is drawn at once, points."""

FAR = 1 << 30
"""Added to the numbers of blocks, which a seed's key wants positive."""


def varies(scene: Scene, name: str) -> bool:
    """Whether a scene needs a field of a property."""
    if name in ("fracture_energy", "strength") and not scene.material.damage:
        return False
    return shape_of(scene.disorder, name) is not None


# --- fields ---------------------------------------------------------------------------------------


def _uniform(sequence: np.random.SeedSequence, count: int) -> Array:
    """Numbers in (0, 1) from the highest 52 bits of a stream, neither end included."""
    raw = np.random.PCG64(sequence).random_raw(count)
    return ((raw >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


@dataclass
class GaussianField:
    """A stationary Gaussian field in space of mean 0, variance 1, covariance exp(-(r/l)^2).

    Attributes:
        length: correlation length l, m.
        seed: of the scene; stream: number of the property.
    """

    length: float
    seed: int
    stream: int
    _low: list[int] = field(default_factory=list)
    _noise: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))

    def _block(self, number: Sequence[int]) -> Array:
        from scipy.special import ndtri

        key = (self.stream, *(FAR + n for n in number))
        drawn = _uniform(np.random.SeedSequence(self.seed, spawn_key=key), BLOCK**3)
        return np.asarray(ndtri(drawn)).reshape((BLOCK,) * 3)

    def cover(self, bounds: Sequence[tuple[float, float]]) -> None:
        """Draw the noise that points within bounds need: (lower, upper), m, along z, y, x."""
        step = GRID * self.length
        low = [(math.floor(a / step) - REACH) // BLOCK for a, _ in bounds]
        high = [(math.floor(b / step) + REACH + 1) // BLOCK + 1 for _, b in bounds]
        self._noise = np.empty([BLOCK * (b - a) for a, b in zip(low, high, strict=True)])
        for n in np.ndindex(*(b - a for a, b in zip(low, high, strict=True))):
            place = tuple(slice(BLOCK * m, BLOCK * (m + 1)) for m in n)
            self._noise[place] = self._block([a + m for a, m in zip(low, n, strict=True)])
        self._low = [BLOCK * n for n in low]

    def _smooth(self, values: Array, axis: int, places: Array) -> Array:
        """Values of the grid along an axis brought to places (m) along it.

        Summed term by term in one order: no library's threads may change a bit.
        """
        step = GRID * self.length
        base = np.floor(places / step).astype(np.int64) - REACH
        points = base[:, None] + np.arange(2 * REACH + 2)
        weights = np.exp(-2 * ((places[:, None] - step * points) / self.length) ** 2)
        weights /= np.sqrt((weights**2).sum(axis=1))[:, None]
        shape = [1, 1, 1]
        shape[axis] = len(places)
        total: Array = np.zeros(1)
        for n in range(points.shape[1]):
            part = values.take(points[:, n] - self._low[axis], axis=axis)
            total = total + weights[:, n].reshape(shape) * part
        return total

    def on_grids(self, grids: Sequence[tuple[Array, Array, Array]]) -> list[Array]:
        """The field on rectangular grids of places z, y, x, m; (z, y, x) values each."""
        bounds = [
            (min(float(g[a].min()) for g in grids), max(float(g[a].max()) for g in grids))
            for a in range(3)
        ]
        self.cover(bounds)
        partial: dict[tuple[bytes, ...], Array] = {}
        found = []
        for places in grids:
            values = self._noise
            key: tuple[bytes, ...] = ()
            for axis in range(3):
                key = (*key, places[axis].tobytes())
                if axis == 2:
                    values = self._smooth(values, axis, places[axis])
                elif key in partial:
                    values = partial[key]
                else:
                    values = partial[key] = self._smooth(values, axis, places[axis])
            found.append(values)
        return found


def _weibull(exponential: Array, shape: float) -> Array:
    """Weibull variates of mean one from exponential ones."""
    return np.asarray(exponential ** (1 / shape) / math.gamma(1 + 1 / shape))


def _factors(
    disorder: Disorder, name: str, shape: float, grids: Sequence[tuple[Array, Array, Array]]
) -> Array:
    """(grids, z, y, x) factors of a property on grids of one shape."""
    stream = DISORDERED.index(name)
    if disorder.correlation_length > 0:
        from scipy.special import log_ndtr

        gauss = GaussianField(disorder.correlation_length, disorder.seed, stream)
        return _weibull(-np.asarray(log_ndtr(-np.stack(gauss.on_grids(grids)))), shape)
    size = (len(grids), *(len(places) for places in grids[0]))
    sequence = np.random.SeedSequence(disorder.seed, spawn_key=(stream,))
    return _weibull(-np.log(_uniform(sequence, math.prod(size)).reshape(size)), shape)


def _site_grid(lattice: Lattice, offset: Array, ghosts: bool) -> tuple[Array, Array, Array]:
    """Places z, y, x of all sites, or of all modules, with an offset x, y, z in module edges; m."""
    axes = []
    for axis in (2, 1, 0):
        count = lattice.sites[2 - axis] if ghosts else lattice.modules[axis]
        number = np.arange(count) - (1 if ghosts else 0)
        axes.append(lattice.origin[axis] + (number + offset[axis]) * lattice.spacing)
    return axes[0], axes[1], axes[2]


@dataclass(frozen=True)
class Drawn:
    """Factors on the means of what varies; None what does not.

    Attributes:
        fracture_energy, youngs_modulus: (nz + 3, ny + 3, nx + 3, bars), of every bar.
        density: (nz, ny, nx), of every module.
        strength: (nz + 3, ny + 3, nx + 3, bars), of every bar's eps_p apart from G_f.
    """

    fracture_energy: Array | None = None
    youngs_modulus: Array | None = None
    density: Array | None = None
    strength: Array | None = None

    def statistics(self, lattice: Lattice) -> dict[str, tuple[float, float]]:
        """Mean and CV of each field over the bars or modules that exist."""
        bars = lattice.bar_exists()
        found = {}
        for name in DISORDERED:
            values = getattr(self, name)
            if values is not None:
                there = values[lattice.mask if name == "density" else bars]
                found[name] = float(there.mean()), float(there.std() / there.mean())
        return found

    @property
    def peak_strain(self) -> Array | None:
        """(S, bars) eps_p over its mean: eps_p follows sqrt(G_f / E), which keeps R_f, K_r."""
        if self.strength is not None:
            return self.strength
        if self.fracture_energy is None and self.youngs_modulus is None:
            return None
        energy = 1.0 if self.fracture_energy is None else self.fracture_energy
        modulus = 1.0 if self.youngs_modulus is None else self.youngs_modulus
        return np.asarray(np.sqrt(energy / modulus))


def _of_part_volumes(lattice: Lattice, shape: float) -> Array:
    """(S, bars) strength of bars on a face or an edge, which stand for part of a volume, over 1."""
    weights = lattice.bar_shares()
    return np.asarray(np.where(weights > 0, weights, 1.0) ** (-1 / shape))


def draw(scene: Scene, lattice: Lattice) -> Drawn:
    """The random fields of a scene, and only those that it needs."""
    disorder = scene.disorder
    if disorder is None:
        return Drawn()
    middles = lattice.cell.starts + 0.5 * lattice.cell.vectors
    bars = [_site_grid(lattice, offset, True) for offset in middles]
    modules = [_site_grid(lattice, np.full(3, 0.5), False)]
    drawn = {}
    for name in DISORDERED:
        if varies(scene, name):
            shape = shape_of(disorder, name)
            assert shape is not None
            of_modules = name == "density"
            values = _factors(disorder, name, shape, modules if of_modules else bars)
            drawn[name] = values[0] if of_modules else np.moveaxis(values, 0, -1)
            if name == "strength" and disorder.reference_volume is not None:
                drawn[name] *= _of_part_volumes(lattice, shape)
    return Drawn(**drawn)
