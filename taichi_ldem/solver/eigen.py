"""Lowest eigenfrequencies of a lattice about its state at rest, without assembling it.

``TangentOperator`` is the stiffness that the run's own kernels have at rest, scaled by the masses.
SciPy's LOBPCG finds its lowest eigenvectors; its preconditioner is a two-grid cycle: Chebyshev
smoothing by the same operator, and a trilinear coarse grid whose stiffness is the sum of the bars'
(Galerkin) and is factorised. It starts from the coarse grid's own eigenvectors.

Vectors are over the free nodes only, three components a node: sqrt(m) u, in sqrt(kg) m.
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.model.lattice import Lattice

if TYPE_CHECKING:
    from taichi_ldem.solver.dynamics import Dynamics

Array = npt.NDArray[np.float64]

AMPLITUDE = 1e-12
"""Largest displacement over the module edge when the kernels are applied: so small that the forces
are linear in it. Strains are computed without cancellation (``bars``), so they may be this small.
"""

COARSE_FREEDOMS = 40_000
"""Limit on the degrees of freedom of the coarse grid, whose factorisation then takes seconds."""

SMOOTHING_STEPS = 3
"""Degree of the Chebyshev polynomial, before and after the coarse grid."""

TOLERANCE = 1e-4
"""Relative residual of every mode (see ``Modes``): the frequency's error goes with its square."""

START_STEPS = 5
"""Inverse iterations on the coarse grid for the start."""

GUARDS = 4
"""Additional vectors of a block, whose last ones converge slowest."""

PART = 16
"""Limit on the vectors that LOBPCG works on at a time, from the lowest that has not converged. It
keeps about fourteen blocks of them, which take most of the memory (a vector of the paper's plate at
six modules has 9.2 MB)."""

ROWS = 1 << 16
"""Rows of a block of vectors that are combined at a time, so that no second block is needed."""

ROUND, ROUNDS = 8, 12
"""LOBPCG iterations between two checks of the residuals, and the limit on such rounds. After it,
low modes that have converged are kept fixed; guards need not converge. SciPy returns the iterate
whose largest residual is least: a mode that the start had missed enters with a large one, and a
shorter round would discard it every time."""


class NotConverged(RuntimeError):
    """The eigenvalue solver ran out of iterations; ``str(error)`` gives the residual at the end."""


@dataclass(frozen=True)
class Modes:
    """Lowest modes of a lattice.

    Attributes:
        frequencies: (n,) ascending, Hz; those of rigid motions are zero but for rounding.
        residuals: (n,) |K u - omega^2 M u| in the norm of 1/M over omega^2 |u| in that of M; for
            rigid motions omega is that of the first other mode.
        shapes: (n, sublattices, *S, 3) displacements of all nodes, largest 1.
        iterations: number of LOBPCG iterations.
    """

    frequencies: Array
    residuals: Array
    shapes: Array
    iterations: int


class TangentOperator:
    """M^(-1/2) K M^(-1/2) over the free nodes, K applied by the kernels that step the plate.

    Args:
        dynamics: an elastic lattice in f64. Its displacements are overwritten.
        fixed: flat numbers over (sublattices, *S) of nodes that do not move.

    Attributes:
        nodes: (n,) flat numbers over (sublattices, *S) of the free nodes, ascending.
        root_mass: (n,) sqrt of their masses, sqrt(kg).
        size: 3 n.
        applied: number of vectors that K was applied to so far.
    """

    def __init__(self, dynamics: "Dynamics", fixed: npt.NDArray[np.integer[Any]]):
        self.dynamics = dynamics
        lattice = dynamics.lattice
        exists = lattice.exists().ravel()
        exists[fixed] = False
        self.nodes = np.flatnonzero(exists)
        self.root_mass = np.sqrt(dynamics.masses().ravel()[self.nodes])
        self.size = 3 * len(self.nodes)
        self.applied = 0
        self._motion = np.zeros((lattice.cell.sublattices, *lattice.sites, 3))
        self._acceleration = np.zeros_like(self._motion)

    def spread(self, vector: Array) -> Array:
        """(sublattices, *S, 3) displacements of a vector, m; zero where no free node is."""
        motion = np.zeros_like(self._motion)
        motion.reshape(-1, 3)[self.nodes] = vector.reshape(-1, 3) / self.root_mass[:, None]
        return motion

    def __call__(self, vector: Array) -> Array:
        """Apply to a vector (size,); (rad/s)^2 times its unit."""
        spacing = self.dynamics.lattice.spacing
        motion = vector.reshape(-1, 3) / self.root_mass[:, None]
        largest = np.abs(motion).max()
        if largest == 0.0:
            return np.zeros_like(vector)
        scale = AMPLITUDE * spacing / largest
        self._motion.reshape(-1, 3)[self.nodes] = scale * motion
        self.dynamics.set_displacement(0, self._motion)
        # like Exchange.get_acceleration, but there are no velocities to keep
        for field in self.dynamics.fields()["velocity"]:
            field.fill(0)
        with self.dynamics.weightless():
            self.dynamics.kick(0, 1.0)
        self.dynamics.get_velocity(self._acceleration)
        self.applied += 1
        acceleration = self._acceleration.reshape(-1, 3)[self.nodes]
        acceleration *= (-self.root_mass / scale)[:, None]
        return acceleration.ravel()

    @cached_property
    def largest(self) -> float:
        """Highest eigenvalue, (rad/s)^2, from a few Lanczos steps; too low by up to 1e-3."""
        from scipy.sparse.linalg import LinearOperator, eigsh

        operator = LinearOperator((self.size, self.size), matvec=self, dtype=np.float64)
        start = np.random.default_rng(0).standard_normal(self.size)
        return float(eigsh(operator, 1, which="LA", v0=start, ncv=8, tol=1e-3)[0][0])


def each(function: Callable[[Array], Array], vectors: Array) -> Array:
    """A function of a vector applied to every column of (size, m)."""
    result = np.empty_like(vectors)
    for number, column in enumerate(np.ascontiguousarray(vectors.T)):
        result[:, number] = function(column)
    return result


def stiffness(dynamics: "Dynamics", basis: Any = None) -> Any:
    """Assembled stiffness of an elastic lattice at rest, or of a basis of its motions, N/m.

    The nodes are taken at their places in the regular lattice: perturbations change the stiffness
    little, and it only preconditions.

    Args:
        basis: sparse (sublattices * prod(S), n) scalar functions of the nodes; None for the nodes
            themselves.

    Returns:
        sparse (3 n, 3 n): sum over the bars of k (n . du)(n . du), three components a function.
    """
    from scipy import sparse

    lattice, cell = dynamics.lattice, dynamics.cell
    sites = int(np.prod(lattice.sites))
    strides = np.array([lattice.sites[1] * lattice.sites[2], lattice.sites[2], 1])
    if basis is None:
        basis = sparse.identity(cell.sublattices * sites, format="csr")
    kinds = dynamics.stiffness.to_numpy()[lattice.code.ravel()]
    removed = None
    if dynamics.features.notch:
        removed = dynamics.lanes.gather(dynamics.removed.to_numpy()).ravel()
    total = sparse.csr_matrix((3 * basis.shape[1],) * 2)
    for bar, vector in enumerate(cell.vectors):
        k = kinds[:, cell.stiffness_kind[bar]]
        if dynamics.features.modulus:
            k = k * dynamics.lanes.gather(dynamics.modulus[bar].to_numpy()).ravel()
        if removed is not None:
            k = np.where((removed >> bar) & 1, 0.0, k)
        at = np.flatnonzero(k)
        first, second = (at + int(o @ strides) + s * sites for s, o in cell.ends[bar])
        difference = basis[second] - basis[first]
        product = difference.T @ difference.multiply(k[at, None]).tocsr()
        along = vector / np.linalg.norm(vector)
        total = total + sparse.kron(product, np.outer(along, along), format="csr")
    return total


def trilinear(lattice: Lattice, cell: int) -> Any:
    """Functions of a coarse grid at all sites' nodes: sparse (sublattices * prod(S), coarse nodes).

    Args:
        cell: edge of the coarse cells, modules.
    """
    from scipy import sparse

    counts = [-(-n // cell) + 1 for n in lattice.modules]
    corner = [np.arange(n) - 1.0 for n in reversed(lattice.sites)]
    halves: list[Any] = []
    for shift in (0.0, 0.5)[: lattice.cell.sublattices]:
        one: Any = None
        for axis in (2, 1, 0):  # z outermost, as the sites
            place = np.clip((corner[axis] + shift) / cell, 0, counts[axis] - 1)
            below = np.minimum(place.astype(int), counts[axis] - 2)
            share = place - below
            row = np.arange(len(place))
            weights = sparse.csr_matrix(
                (
                    np.concatenate([1 - share, share]),
                    (np.concatenate([row, row]), np.concatenate([below, below + 1])),
                ),
                shape=(len(place), counts[axis]),
            )
            one = weights if one is None else sparse.kron(one, weights, format="csr")
        halves.append(one)
    return sparse.vstack(halves, format="csr")


class TwoGrid:
    """Approximate inverse of the operator plus a shift: smoothing, coarse grid, smoothing.

    Symmetric and positive definite, as LOBPCG needs it.

    Args:
        shift: added to the operator, (rad/s)^2: keeps rigid motions from making it singular.
    """

    def __init__(
        self,
        operator: TangentOperator,
        shift: float,
    ):
        from scipy import sparse
        from scipy.sparse.linalg import splu

        self.operator, self.shift = operator, shift
        lattice = operator.dynamics.lattice
        self.cell = coarse_cell(lattice)
        whole = trilinear(lattice, self.cell)
        free = sparse.csr_matrix(
            (np.ones(len(operator.nodes)), (operator.nodes, operator.nodes)),
            shape=(whole.shape[0],) * 2,
        )
        whole = (free @ whole).tocsc()
        whole = whole[:, np.diff(whole.indptr) > 0].tocsr()
        self.stiffness = stiffness(operator.dynamics, whole)
        # the basis in scaled vectors: sqrt(m) times displacement
        self.basis = sparse.diags_array(operator.root_mass) @ whole[operator.nodes]
        self.back = self.basis.T.tocsr()
        self.mass = sparse.kron(self.back @ self.basis, np.identity(3), format="csr")
        matrix = self.stiffness + shift * self.mass
        matrix += 1e-10 * sparse.diags_array(matrix.diagonal())  # functions that nearly coincide
        self.factor = splu(
            matrix.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        self.top = 1.05 * operator.largest + shift
        self.bottom = self.top / (2 * self.cell**2)

    def _smooth(self, wanted: Array, guess: Array | None = None) -> tuple[Array, Array]:
        """Chebyshev iterations towards the solution of A x = wanted; x and A x."""
        middle, half = 0.5 * (self.top + self.bottom), 0.5 * (self.top - self.bottom)
        x = np.zeros_like(wanted) if guess is None else guess.copy()
        rest = wanted.copy() if guess is None else wanted - self.shifted(x)
        rho = half / middle
        step = rest / middle
        for number in range(SMOOTHING_STEPS):
            x += step
            if number == SMOOTHING_STEPS - 1 and guess is not None:
                break
            rest -= self.shifted(step)
            after = 1 / (2 * middle / half - rho)
            step *= after * rho
            step += (2 * after / half) * rest
            rho = after
        return x, rest

    def shifted(self, vector: Array) -> Array:
        """The operator plus the shift."""
        return self.operator(vector) + self.shift * vector

    def __call__(self, wanted: Array) -> Array:
        """Apply to the columns of (size, m), or to a vector."""
        columns = np.ascontiguousarray(wanted.reshape(len(wanted), -1).T)  # now rows
        x = np.empty_like(columns)
        coarse = np.empty((self.stiffness.shape[0], len(columns)))
        for n, column in enumerate(columns):
            x[n], rest = self._smooth(column)
            coarse[:, n] = self.restrict(rest[:, None])[:, 0]
        coarse = self.factor.solve(coarse)
        for n, column in enumerate(columns):
            x[n] += self.prolong(coarse[:, n : n + 1])[:, 0]
            x[n], _ = self._smooth(column, x[n])
        del columns
        return np.ascontiguousarray(x.T).reshape(wanted.shape)

    def restrict(self, vectors: Array) -> Array:
        """Columns of (size, m) to those of the coarse grid."""
        m = vectors.shape[1]
        coarse: Array = self.back @ vectors.reshape(-1, 3 * m)
        return coarse.reshape(-1, m)

    def prolong(self, vectors: Array) -> Array:
        """Columns of the coarse grid to those of (size, m)."""
        m = vectors.shape[1]
        fine: Array = self.basis @ vectors.reshape(-1, 3 * m)
        return fine.reshape(-1, m)

    def start(self, count: int) -> Array:
        """The coarse grid's lowest eigenvectors, roughly, on the fine grid, (size, count).

        Inverse iteration with a block: a single vector's Krylov space would hold one of several
        modes of the same frequency. Noise where the coarse grid has fewer.
        """
        from scipy.linalg import eigh, qr

        coarse, noise = self.stiffness.shape[0], np.random.default_rng(0)
        wanted = min(count + GUARDS, coarse // 2)
        vectors: Any = noise.standard_normal((coarse, wanted))
        for _ in range(START_STEPS):
            vectors, _ = qr(self.factor.solve(self.mass @ vectors), mode="economic")
        _, turn = eigh(vectors.T @ (self.stiffness @ vectors), vectors.T @ (self.mass @ vectors))
        found = self.prolong(vectors @ turn[:, :count])
        rest = noise.standard_normal((self.operator.size, count - found.shape[1]))
        return np.concatenate([found, rest], axis=1)


def coarse_cell(lattice: Lattice) -> int:
    """Edge of the coarse cells, modules: at least two, and more for large bodies."""
    cell = 2
    while 3 * np.prod([-(-n // cell) + 1 for n in lattice.modules]) > COARSE_FREEDOMS:
        cell += 1
    return cell


def low_frequency(operator: TangentOperator) -> float:
    """Order of magnitude of a free body's lowest bending frequency, squared, (rad/s)^2.

    A beam as long as the body's longest and as thick as its shortest side has omega = 22.4 c h /
    (sqrt(12) l^2); the lattice's highest frequency is about 3.6 c / L.
    """
    thin, long = min(operator.dynamics.lattice.modules), max(operator.dynamics.lattice.modules)
    return operator.largest * (22.4 / math.sqrt(12) / 3.6 * thin / long**2) ** 2


def lowest(
    operator: TangentOperator, count: int, report: Callable[[str], None] = lambda _: None
) -> Modes:
    """The lowest modes of a lattice at rest.

    Args:
        count: number of modes; at most a fifth of the degrees of freedom.
        report: called with a line of progress after each round.

    Raises:
        ValueError: more modes than the lattice can give.
        NotConverged: a residual is still above the tolerance.
    """
    size = count + GUARDS
    if 5 * size > operator.size:
        raise ValueError(f"at most {operator.size // 5 - GUARDS} for this lattice")
    shift = low_frequency(operator)
    inverse = TwoGrid(operator, shift)
    report(
        f"coarse grid: {inverse.stiffness.shape[0]:,} degrees of freedom, cells of {inverse.cell} "
        "modules"
    )
    vectors, done = inverse.start(size), 0
    locked = np.zeros(size, dtype=bool)
    goal = 0.1 * TOLERANCE * shift
    for _ in range(ROUNDS):
        part = np.flatnonzero(~locked)[:PART]
        vectors[:, part] = _lobpcg(inverse, vectors[:, part], vectors[:, locked], goal)
        done += ROUND
        values, residuals, scale = _ritz(operator, vectors, shift)
        # the first mode that has not converged; 0 if all have
        first = int(np.argmax(residuals > TOLERANCE))
        # free vectors stay orthogonal to the locked ones, whose errors must be much smaller
        goal = 0.1 * TOLERANCE * scale[first]
        locked = (residuals * scale <= goal) & (np.arange(size) < first)
        worst = residuals[:count].max()
        report(f"{done} iterations, {operator.applied:,} products: largest residual {worst:.1e}")
        if worst <= TOLERANCE:
            break
    else:
        raise NotConverged(f"residual {worst:.1e} after {done} iterations, above {TOLERANCE:.0e}")
    frequencies = np.sqrt(np.maximum(values[:count], 0.0)) / (2 * math.pi)
    shapes = np.stack([operator.spread(vectors[:, n]) for n in range(count)])
    for shape in shapes:
        shape /= shape.ravel()[np.abs(shape).argmax()]
    return Modes(frequencies, residuals[:count], shapes, done)


def _lobpcg(inverse: TwoGrid, vectors: Array, locked: Array, goal: float) -> Array:
    """Better vectors after a few iterations of SciPy's LOBPCG, orthogonal to the locked ones."""
    from scipy.sparse.linalg import LinearOperator, lobpcg

    operator = inverse.operator
    # Far below one, so that SciPy takes its Gram matrices as they are (it does where residual norms
    # are below 1e-8) and not as if its vectors were orthonormal, which they are not: it would break
    # down after a few iterations.
    scale = 1e-9 / inverse.top

    def apply(columns: Array) -> Array:
        columns = columns.reshape(operator.size, -1)
        return scale * (each(operator, columns) + inverse.shift * columns)

    def precondition(columns: Array) -> Array:
        return inverse(columns.reshape(operator.size, -1)) / scale

    shape = (operator.size, operator.size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that it was stopped before it converged
        better = lobpcg(
            LinearOperator(shape, matvec=apply, matmat=apply, dtype=np.float64),
            vectors,
            M=LinearOperator(shape, matvec=precondition, matmat=precondition, dtype=np.float64),
            Y=locked if locked.shape[1] else None,
            tol=scale * goal,
            maxiter=ROUND,
            largest=False,
        )[1]
    return np.asarray(better, dtype=np.float64)


def _ritz(operator: TangentOperator, vectors: Array, shift: float) -> tuple[Array, Array, Array]:
    """Ritz values in ascending order, relative residuals (see ``Modes``), and the latter's scale.

    Args:
        vectors: replaced by the Ritz vectors, orthonormal.
    """
    from scipy.linalg import eigh

    image = each(operator, vectors)
    solved: Any = eigh(vectors.T @ image, vectors.T @ vectors)
    values, turn = solved
    squares = np.zeros(len(values))
    for start in range(0, len(vectors), ROWS):
        rows = slice(start, start + ROWS)
        vectors[rows] = vectors[rows] @ turn
        rest = image[rows] @ turn - values * vectors[rows]
        squares += np.einsum("nm,nm->m", rest, rest)
    elastic = values[values > 1e-3 * shift]
    scale = np.maximum(values, elastic[0] if len(elastic) else shift)
    return values, np.sqrt(squares) / scale, scale
