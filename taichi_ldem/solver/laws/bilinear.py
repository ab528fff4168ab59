"""Bilinear softening: the force falls on a straight line to zero at K_r (Fig. 2 of the paper)."""

import taichi as ti


@ti.func
def softening(peak, failure, _):
    """Force over EA eps_p at peak strain 1 < peak < failure."""
    return (failure - peak) / (failure - 1)


@ti.func
def area(peak, failure, _):
    """Integral of the branch from 1 to peak."""
    return (peak - 1) * (1 - 0.5 * (peak - 1) / (failure - 1))


def parameters(ductility: float) -> tuple[float, float]:
    """K_r -> peak strain at failure; the second parameter is not used."""
    return ductility, 0.0
