"""The forces in the line that shows a run's progress."""

import pytest

from taichi_ldem.scenarios.progress import in_words


@pytest.mark.parametrize(
    ("forces", "line"),
    [
        ({}, ""),
        ({"striker": 12.34}, "  F    12.3 N"),
        (
            {"striker": 1.0, "floor": -2.0, "striker2": 3.0},
            "  F striker     1.0 N  F floor    -2.0 N  F striker2     3.0 N",
        ),
        (
            {"striker": 1.0, "floor": 2.0, "striker2": 3.0, "striker3": 4.0},
            "  F 3 strikers     8.0 N  F floor     2.0 N",
        ),
    ],
)
def test_progress_shows_the_forces_of_all_strikers(forces: dict[str, float], line: str) -> None:
    assert in_words(forces) == line
