"""Softening laws: what a bar carries once its peak strain has passed eps_p (Section 2.1, Fig. 2).

A law is one function, the softening branch, and its integral. Everything is dimensionless: strains
in units of eps_p, forces in units of EA eps_p, energies in units of EA eps_p^2 times the bar's
length. Up to peak strain 1 a bar is elastic; from there to the ratio at failure it follows the
branch; past it, it is gone in both directions. It unloads to the origin, and compression is linear
elastic as long as the bar exists, so the peak strain is the whole history.

Two parameters describe a bar family: the ratio at failure and a second one of the law's own. Both
laws dissipate K_r / 2, the area under the bilinear law, which Eq. (12) equates with G_f A^f.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import taichi as ti

from taichi_ldem.scene import LAW_NAMES

CUT_OFF = 0.01
"""Share of the peak force at which an exponentially softening bar is removed."""


@ti.func
def _bilinear(peak, failure, _):
    return (failure - peak) / (failure - 1)


@ti.func
def _bilinear_area(peak, failure, _):
    return (peak - 1) * (1 - 0.5 * (peak - 1) / (failure - 1))


@ti.func
def _exponential(peak, _, decay):
    return ti.exp((1 - peak) / decay)


@ti.func
def _exponential_area(peak, _, decay):
    return decay * (1 - ti.exp((1 - peak) / decay))


def _exponential_parameters(ductility: float) -> tuple[float, float]:
    # 1/2 + decay (1 - CUT_OFF) = K_r / 2; a brittle bar (K_r = 1) never enters the branch
    decay = (ductility - 1) / (2 * (1 - CUT_OFF))
    return 1 - decay * math.log(CUT_OFF), max(decay, 1e-12)


@dataclass(frozen=True)
class Law:
    """A softening law.

    Attributes:
        softening: (peak, failure, parameter) -> force at peak strain 1 < peak < failure.
        area: its integral from 1 to ``peak``.
        parameters: K_r -> (peak strain at failure, second parameter).
    """

    softening: Any
    area: Any
    parameters: Callable[[float], tuple[float, float]]


LAWS = {
    "bilinear": Law(_bilinear, _bilinear_area, lambda ductility: (ductility, 0.0)),
    "exponential": Law(_exponential, _exponential_area, _exponential_parameters),
}


def register(name: str, law: Law) -> None:
    """Make a law known to scenes as ``material.law = name``.

    A law that dissipates K_r / 2 for every K_r > 1 costs G_f A^f a bar, as the built-in ones do.

    Raises:
        ValueError: the name is taken.
    """
    if name in LAWS:
        raise ValueError(f"there is a law '{name}' already")
    LAWS[name] = law
    LAW_NAMES.append(name)
