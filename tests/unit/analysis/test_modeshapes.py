"""Names of modes from shapes that are known, and the frequencies of thin discs."""

import numpy as np
import pytest
from scipy.special import iv, jv

from taichi_ldem.analysis.modeshapes import (
    Name,
    clamped_disc,
    groups,
    nodal_lines,
    thin_plate_frequency,
)

# lambda^2 of the clamped disc: Leissa, Vibration of Plates, NASA SP-160 (1969), Table 2.1
LEISSA = {
    (0, 0): 10.2158,
    (1, 0): 21.26,
    (2, 0): 34.88,
    (3, 0): 51.04,
    (0, 1): 39.771,
    (1, 1): 60.82,
    (2, 1): 84.58,
    (0, 2): 89.104,
}


@pytest.mark.parametrize(("name", "value"), LEISSA.items(), ids=str)
def test_clamped_disc_has_the_tabulated_frequencies(name: tuple[int, int], value: float) -> None:
    assert clamped_disc(*name) == pytest.approx(value, rel=3e-4)  # four digits, some misrounded


def test_the_paper_s_rayleigh_ritz_column_has_another_modulus_and_radius() -> None:
    """Its Table 2, with E = 3.30 GPa and a = 40 mm; to its printed digits."""
    printed = {(0, 0): 1.61e3, (1, 0): 3.35e3, (2, 0): 5.51e3, (0, 1): 6.29e3, (0, 2): 14.05e3}
    for (m, n), value in printed.items():
        computed = thin_plate_frequency(Name("plate", m, n), 0.040, 3.2e-3, 3.30e9, 0.25, 1190.0)
        assert computed == pytest.approx(value, rel=4e-3)


@pytest.mark.parametrize("name", LEISSA, ids=str)
@pytest.mark.parametrize("turned", [0.0, 0.4])
def test_nodal_lines_of_exact_shapes(name: tuple[int, int], turned: float) -> None:
    m, n = name
    k = np.sqrt(clamped_disc(m, n))
    line = np.linspace(-1.2, 1.2, 61)
    y, x = np.meshgrid(line, line, indexing="ij")
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    shape = jv(m, k * r) - jv(m, k) / iv(m, k) * iv(m, k * r)
    assert nodal_lines(line, line, shape * np.cos(m * (angle - turned)), 1.0) == (m, n)


def test_pairs_are_told_by_name_and_frequency() -> None:
    names = [Name("rigid")] * 2 + [
        Name("plate", 0, 0),
        Name("plate", 2, 0),
        Name("outside"),
        Name("plate", 2, 0),
        Name("outside"),
        Name("outside"),
    ]
    values = np.array([0.0, 1e-3, 10.0, 20.0, 21.0, 22.0, 30.0, 30.001])
    assert groups(names, values) == [[0, 1], [2], [3, 5], [4], [6, 7]]
