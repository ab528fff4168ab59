"""The critical time step of the assembled lattice.

Central differences are stable up to 2 / omega_max. The highest frequency comes from a few Lanczos
steps on M^(-1/2) K M^(-1/2), with K applied by the very kernels that step the plate, so it is the
operator of the run and not a bound on it (the element-wise bound is a third too low). Kinematic
contact and clamps are constraints, which cannot raise the highest frequency, and broken bars lower
it.
"""

import numpy as np
import numpy.typing as npt

from taichi_ldem.dynamics import _ENDS as ENDS
from taichi_ldem.dynamics import Dynamics
from taichi_ldem.lattice import BAR_VECTORS, BARS_PER_SITE, bar_weights

STRETCHED = 3**-0.5
"""Share of the critical time step at rest that is enough at any deformation.

A bar of stiffness k at length ratio r has the tangent stiffness k along itself and k (1 - 1/r) < k
across, so no deformation takes omega^2 above that of the lattice whose bars had k in every
direction; averaged over three directions of motion that lattice's energy is three times the
lattice's own, so its omega^2 is at most three times that at rest. Softening and breaking lower it.
"""

TOLERANCE = 1e-3
BASIS = 8
"""Lanczos vectors kept, each as large as the displacement."""


def critical_time_step(dynamics: Dynamics) -> float:
    """2 / omega_max of the lattice at rest, s.

    The Lanczos value approaches omega_max^2 from below; its tolerance of 1e-3 means half of that in
    the time step. Displacements and velocities are left at zero.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    shape = (2, *dynamics.sites, 3)
    root = np.sqrt(dynamics.masses())[..., None]
    inverse = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0)
    largest = min(1e-6, 1e-2 * _least_peak_strain(dynamics))
    amplitude = largest * dynamics.lattice.spacing / inverse.max()
    factor = -root / amplitude
    now, rest, acceleration = 0, np.zeros(shape), np.zeros(shape)
    dynamics.set_velocity(rest)

    def apply(vector: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        # strains of about 1e-6, far below eps_p: the kernels answer linearly and note no history
        dynamics.set_displacement(now, amplitude * inverse * vector.reshape(shape))
        # the step's own operator: from rest and for a second, velocities are accelerations
        dynamics.kick(now, 1.0)
        dynamics.get_velocity(acceleration)
        dynamics.set_velocity(rest)
        return (factor * acceleration).ravel()

    size = int(np.prod(shape))
    operator = LinearOperator((size, size), matvec=apply, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(shape) * (root > 0)
    value = eigsh(
        operator,
        k=1,
        which="LA",
        v0=start.ravel(),
        ncv=BASIS,
        tol=TOLERANCE,
        return_eigenvectors=False,
    )
    for buffer in (0, 1):
        dynamics.set_displacement(buffer, rest)
    return float(2 / np.sqrt(value[0]))


def _least_peak_strain(dynamics: Dynamics) -> float:
    """The smallest eps_p of any bar; infinite without damage."""
    if not dynamics.features.damage:
        return np.inf
    weakest = float(dynamics.weakest.to_numpy().min()) if dynamics.features.strength else 1.0
    return dynamics.peak_strain * weakest


def largest_strains(
    dynamics: Dynamics, displacement: npt.NDArray[np.float64]
) -> tuple[float, float]:
    """Largest and smallest strain of the bars that carry, at a displacement (2, *S, 3), m.

    NaN where a position is not finite; (0, 0) where there is no bar left.
    """
    lattice, features = dynamics.lattice, dynamics.features
    carries = bar_weights(False)[lattice.code] > 0
    if features.notch:
        removed = dynamics.lanes.gather(dynamics.removed.to_numpy())
        carries &= (removed[..., None] >> np.arange(BARS_PER_SITE) & 1) == 0
    if features.damage:
        failure = dynamics.softening.to_numpy()[:, 0]
        for bar, field in enumerate(dynamics.peak):
            peak = dynamics.lanes.gather(field.to_numpy())
            carries[..., bar] &= peak < failure[dynamics.softening_row(bar)]
    extremes = [0.0]
    for bar, ends in enumerate(ENDS):
        if carries[..., bar].any():
            first, second = (
                np.roll(displacement[kind], [-n for n in offset], axis=(0, 1, 2))
                for kind, offset in ends
            )
            rest = BAR_VECTORS[bar] * lattice.spacing
            with np.errstate(over="ignore", invalid="ignore"):
                now = np.linalg.norm(second - first + rest, axis=-1)[carries[..., bar]]
            strain = now / np.linalg.norm(rest) - 1
            extremes += [float(strain.max()), float(strain.min())]
    return max(extremes, key=_nan_first), min(extremes, key=lambda e: -_nan_first(-e))


def _nan_first(value: float) -> float:
    return np.inf if np.isnan(value) else value
