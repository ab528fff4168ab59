"""The critical time step of the assembled lattice.

Central differences are stable up to 2 / omega_max. The highest frequency comes from a few Lanczos
steps on M^(-1/2) K M^(-1/2), with K applied by the very kernels that step the plate, so it is the
operator of the run and not a bound on it (the element-wise bound is a third too low). Kinematic
contact and clamps are constraints, which cannot raise the highest frequency, and broken bars lower
it.
"""

import numpy as np
import numpy.typing as npt

from taichi_ldem.dynamics import Dynamics

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
    amplitude = 1e-6 * dynamics.lattice.spacing / inverse.max()
    factor = -root / amplitude
    now, rest, acceleration = 0, np.zeros(shape), np.zeros(shape)
    dynamics.set_velocity(rest)

    def apply(vector: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        # strains of 1e-6 and less: the non-linear kernels answer linearly
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
