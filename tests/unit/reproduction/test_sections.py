"""Rows of the reproduction's report."""

import pytest

from taichi_ldem.reproduction.sections import Row


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (Row("P1", "N", 540.0, 600.0), "-10 % from the paper"),
        (Row("t2", "ms", 7.0, None, (6.4, 9.4)), "within the experiments"),
        (Row("t2", "ms", 3.2, 6.4, (6.4, 9.4)), "-50 % from the paper; -50 % from their range"),
        (Row("d_r", "mm", 103.5, None, (63.0, 69.0)), "+50 % from their range"),
        (Row("d_c", "mm", None, 42.0), ""),
    ],
)
def test_differences(row: Row, expected: str) -> None:
    assert row.difference() == expected
