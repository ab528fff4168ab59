"""What of a panel can be seen."""

import pytest

from taichi_ldem.output.curves.chart import Box, Line, Panel, Point

INSIDE = [Line(x=2.0), Line(y=9.0), Point(5.0, 1.0), Box("both ends", (4.0, 8.0)), Box("all")]
BEYOND = [Line(x=7.5), Point(-1.0, 1.0), Box("later", (6.4, 9.4))]


@pytest.mark.parametrize("x_range", [(0.0, 5.0), None])
def test_marks_beyond_the_range_are_left_out(x_range: tuple[float, float] | None) -> None:
    panel = Panel("name", "title", "x", "y", [*INSIDE, *BEYOND], x_range)
    assert panel.visible == (INSIDE if x_range else [*INSIDE, *BEYOND])
