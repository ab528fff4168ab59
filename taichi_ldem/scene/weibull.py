"""Weibull shapes from coefficients of variation and data, and strengths by volume."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.errors import SceneError
from taichi_ldem.scene.tables import LARGEST_CV, Disorder

if TYPE_CHECKING:
    from taichi_ldem.scene.scene import Scene

SMALLEST_CV = 1e-6
"""Below it the shape is that of the limit: Gamma's differences would be rounding."""


def _log_spread(shape: float) -> float:
    """log(1 + CV^2) of a Weibull variate."""
    return math.lgamma(1 + 2 / shape) - 2 * math.lgamma(1 + 1 / shape)


@functools.lru_cache(maxsize=256)  # the members of an ensemble ask for few
def shape_from_cv(cv: float) -> float:
    """Weibull shape gamma of a coefficient of variation, 0 < CV <= 1.5."""
    limit = math.pi / (math.sqrt(6) * cv)  # log x is then Gumbel's, of that deviation
    if cv < SMALLEST_CV:
        return limit
    from scipy.optimize import brentq

    wanted = math.log1p(cv**2)
    return float(brentq(lambda g: _log_spread(g) - wanted, 0.3 * limit, 2 * limit, rtol=1e-14))


def cv_from_shape(shape: float) -> float:
    """Coefficient of variation of a Weibull variate."""
    return math.sqrt(math.expm1(_log_spread(shape)))


def shape_from_data(values: Sequence[float]) -> float:
    """Weibull shape of measured values by maximum likelihood (scale free, location 0).

    The root of sum(x^g log x) / sum(x^g) - 1/g = mean(log x).
    """
    from scipy.optimize import brentq

    logs = np.log(np.asarray(values, dtype=np.float64))
    logs -= logs.max()  # scale-free, and no power overflows

    def slope(shape: float) -> float:
        powers = np.exp(shape * logs)
        return float(powers @ logs / powers.sum() - 1 / shape - logs.mean())

    guess = math.pi / (math.sqrt(6) * float(logs.std()))
    low = high = guess
    while slope(low) > 0:
        low /= 2
    while slope(high) < 0:
        high *= 2
    return float(brentq(slope, low, high, rtol=1e-14)) if low < high else guess


def shape_of(disorder: Disorder | None, name: str) -> float | None:
    """Weibull shape of a property ("fracture_energy"); None where it does not vary.

    Raises:
        SceneError: data that scatter more than any field here may.
    """
    if disorder is None:
        return None
    values, cv = getattr(disorder, f"{name}_data"), getattr(disorder, f"{name}_cv")
    if values is None:
        return shape_from_cv(cv) if cv else None
    shape = shape_from_data(values)
    if shape < shape_from_cv(LARGEST_CV):
        raise SceneError(
            f"disorder.{name}_data: a Weibull fit gives them a CV of {cv_from_shape(shape):.2f}, "
            f"at most {LARGEST_CV} is possible"
        )
    return shape


def strength_by_volume(scene: Scene) -> float:
    """Mean eps_p of a bar over that of the tensile specimen (``disorder.reference_volume``).

    A specimen breaks where its weakest bar fails. In a volume V under tension along an axis, 2 V /
    L^3 bars (V / L^3 in the lattice "cubic-26") carry the stress, and the least of so many Weibull
    variates has the mean of one times (2 V / L^3)^(-1 / gamma). So a bar is this factor's
    inverse as strong as the specimen (Weibull 1939).
    """
    disorder = scene.disorder
    if disorder is None or disorder.reference_volume is None or not scene.material.damage:
        return 1.0
    shape = shape_of(disorder, "strength")
    assert shape is not None  # the table refuses a volume without a strength that varies
    along_axis = {"module": 2, "cubic-26": 1}[scene.plate.lattice]
    bars = along_axis * disorder.reference_volume / scene.plate.spacing**3
    return float(bars ** (1 / shape))
