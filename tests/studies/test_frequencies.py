"""Errors of natural frequencies and the order in which they fall."""

import pytest

from studies import frequencies


def test_errors_and_order_of_the_study() -> None:
    exact = {"(0, 0)": [1000.0], "(1, 0)": [2000.0, 2000.0], "outside": [10.0]}
    errors = {}
    for n in (2, 4, 8):
        off = 1 - 0.16 / n**2
        found = {"(0, 0)": [1000 * off], "(1, 0)": [2000 * off, 2000 * off], "outside": [11.0]}
        errors[n] = frequencies.pairs(found, exact)
        assert errors[n] == pytest.approx({"(0, 0)": off - 1, "(1, 0)": off - 1})
    assert frequencies.order({n: found["(0, 0)"] for n, found in errors.items()}) == pytest.approx(
        2
    )
