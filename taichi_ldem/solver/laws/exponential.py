"""Exponential softening, cut off where the force has fallen to 1 % of its peak."""

import math

import taichi as ti

CUT_OFF = 0.01
"""Share of the peak force at which a bar fails."""


@ti.func
def softening(peak, _, decay):
    """Force over EA eps_p at peak strain 1 < peak < failure."""
    return ti.exp((1 - peak) / decay)


@ti.func
def area(peak, _, decay):
    """Integral of the branch from 1 to peak."""
    return decay * (1 - ti.exp((1 - peak) / decay))


def parameters(ductility: float) -> tuple[float, float]:
    """K_r -> peak strain at failure, strain over which the force falls by e.

    From 1/2 + decay (1 - CUT_OFF) = K_r / 2; a brittle bar (K_r = 1) never enters the branch.
    """
    decay = (ductility - 1) / (2 * (1 - CUT_OFF))
    return 1 - decay * math.log(CUT_OFF), max(decay, 1e-12)
