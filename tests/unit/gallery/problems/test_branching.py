"""Where a crack counts as branched."""

from typing import Any

import numpy as np
import pytest

from taichi_ldem.gallery.problems import branching

RUN: Any = None


@pytest.mark.parametrize(
    ("wide", "at"),
    [
        ([(12.0, 30.0)], 12.0),  # two parts to the end of the crack
        ([(4.0, 5.0), (12.0, 30.0)], 12.0),  # an attempt before
        ([(6.5, 19.0)], 6.5),  # an arm ends
        ([(2.0, 27.0), (29.0, 31.0)], 2.0),  # an arm has left the plate, the other goes on
        ([(34.0, 34.0)], None),  # a bump of a crack that wanders
        ([(4.0, 5.0), (31.0, 33.0)], None),
        ([], None),
    ],
)
def test_a_crack_branches_where_two_parts_go_on(
    monkeypatch: pytest.MonkeyPatch, wide: list[tuple[float, float]], at: float | None
) -> None:
    place = np.arange(-5.0, 40.0, 0.5)
    width = np.full(len(place), 0.5)
    for low, high in wide:
        width[(place >= low) & (place <= high)] = 4.0
    monkeypatch.setattr(branching, "_spread", lambda run: (1e-3 * place, 1e-3 * width))
    found = branching.branch(RUN)
    assert found == (None if at is None else pytest.approx(1e-3 * at))
