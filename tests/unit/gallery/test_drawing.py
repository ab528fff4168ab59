"""The broken bars in the figures of problems."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from support.synthetic import synthetic_run

from taichi_ldem.gallery.drawing import draw_broken
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.storage.fields import read_broken_bars


def test_broken_bars_are_dots_at_their_places_in_a_plane(tmp_path: Path) -> None:
    run = LoadedRun.read(synthetic_run(tmp_path / "run"))
    bars = read_broken_bars(run.folder.fields_file)
    left, right = Figure().subplots(1, 2)
    dots = draw_broken(left, run, "xz", timed=True)
    np.testing.assert_allclose(dots.get_offsets(), 1e3 * bars.position_m[:, [0, 2]])
    np.testing.assert_allclose(dots.get_array(), 1e6 * bars.time_s)
    assert (left.get_xlabel(), left.get_ylabel()) == ("x [mm]", "z [mm]")
    plain = draw_broken(right, run, colour="C3")
    np.testing.assert_allclose(plain.get_offsets(), 1e3 * bars.position_m[:, :2])
    assert plain.get_array() is None
