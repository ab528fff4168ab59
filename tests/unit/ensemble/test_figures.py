"""Envelopes and panels of groups."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from support.blocks import block_scene

from taichi_ldem.ensemble.figures import envelope, make_panels
from taichi_ldem.ensemble.results import Row
from taichi_ldem.output.figures.cracks import sheet


def test_envelope_of_records_on_different_times():
    coarse, fine = np.linspace(0.0, 1.0, 6), np.linspace(0.0, 0.9, 10)
    found = envelope([(coarse, 2 * coarse), (fine, 4 * fine), (fine, 0 * fine)])
    assert np.allclose(found.time, fine)
    assert np.allclose(found.high, 4 * fine)
    assert np.allclose(found.low, 0.0)
    assert np.allclose(found.mean, 2 * fine)


def test_groups_of_one_member_stand_side_by_side(plan):
    rows = [Row(member, {}, (), "finished") for member in plan.members]
    panels = make_panels(rows, {member.name: None for member in plan.members})
    ((name, row),) = panels
    assert name == ""
    assert [panel.name for panel in row] == [f"velocity {v}" for v in ("2", "2.5", "3")]
    assert all(panel.cracks is None for panel in row)


@pytest.mark.parametrize("final", [False, True])
def test_maps_show_the_holes_and_notches_of_their_own_specimen(final):
    hole = {"shape": "circle", "diameter": 2e-3}
    notch = {"normal": "x", "position": 1e-3, "from": [-2e-3, 0.0], "to": [2e-3, 1e-3]}
    scenes = [block_scene(16, 16, 2), block_scene(16, 16, 2, hole=[hole], notch=[notch])]
    rows = [
        Row(SimpleNamespace(scene=scene, name=str(n), group=(("n", n),)), {}, (), "finished")
        for n, scene in enumerate(scenes)
    ]
    figure = Figure()
    sheet(figure, make_panels(rows, {"0": None, "1": None}), final=final)
    plain, cut = figure.axes
    assert [len(axes.patches) for axes in (plain, cut)] == [1, 2]  # the edge; and the hole
    assert np.ptp(cut.patches[1].get_xy(), axis=0) == pytest.approx([2.0, 2.0], rel=0.01)
    assert [len(axes.lines) for axes in (plain, cut)] == [0, 1]
    assert cut.lines[0].get_xdata() == pytest.approx(1.0)
