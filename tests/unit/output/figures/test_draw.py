"""Panels drawn by Matplotlib."""

import numpy as np
from matplotlib.figure import Figure

from taichi_ldem.output.curves.chart import Curve, Panel
from taichi_ldem.output.figures.draw import draw_panels


def test_a_logarithmic_axis_of_sizes_has_plain_numbers() -> None:
    figure = Figure()
    curve = Curve(np.array([0.3, 60.0]), np.array([1.0, 100.0]), "sizes")
    draw_panels(figure, [Panel("sizes", "", "mm", "%", [curve], log=True, log_x=True)])
    (axes,) = figure.axes
    assert axes.get_xscale() == axes.get_yscale() == "log"
    shown = [label.get_text() for label in axes.get_xticklabels(which="both")]
    assert {"0.5", "1", "2", "5", "10", "20", "50"} <= set(shown)
    assert set("".join(shown)) <= set("0125.")
