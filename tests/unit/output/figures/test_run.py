"""Figures: what they show, and that they show only what a run has."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from support.synthetic import COLUMNS, synthetic_run

from taichi_ldem.output.figures import draw
from taichi_ldem.output.figures.run import plot_run
from taichi_ldem.storage.fields import FieldWriter, hexahedral_mesh
from taichi_ldem.storage.folder import RunFolder

ALL = [
    "force.png",
    "velocity.png",
    "energy.png",
    "crack_map.png",
    "cracks.png",
    "crack_growth.png",
]


@pytest.fixture
def run(tmp_path) -> RunFolder:
    return synthetic_run(tmp_path / "run")


@pytest.fixture
def figures(monkeypatch) -> dict[str, Figure]:
    """The figures by file name, caught instead of being drawn."""
    caught: dict[str, Figure] = {}

    def catch(file: Path, figure: Figure, **_: object) -> None:
        caught[file.name] = figure

    monkeypatch.setattr(draw, "write_figure", catch)
    return caught


def texts(figure: Figure) -> str:
    labels = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    labels += [text.get_text() for axes in figure.axes for text in axes.texts]
    return " | ".join(labels)


def keep_columns(run: RunFolder, names: list[str]) -> None:
    table = run.read_history()
    rows = np.column_stack([table[name] for name in names])
    np.savetxt(run.history_file, rows, delimiter=",", header=",".join(names), comments="")


def replace_in_scene(run: RunFolder, old: str, new: str) -> None:
    text = run.scene_file.read_text()
    assert old in text
    run.write_scene(text.replace(old, new))


def test_pictures_wide_enough_and_not_empty(run):
    written = plot_run(run)
    assert [path.name for path in written] == ALL
    for path in written:
        image = imread(path)[..., :3]
        assert image.shape[1] >= 1200
        assert 0.01 < (image < 0.9).any(axis=2).mean() < 0.9


def test_the_papers_values_stand_beside_the_papers_test(run, figures):
    plot_run(run)
    # Experiments: P1 ~ 600 N at 1.75 ms, t2 6.4 to 9.4 ms, v largest at 0.8 ms; LDEM t2 ~ 7.5 ms.
    assert "600 N at 1.75 ms" in texts(figures["force.png"])
    assert "7.5 ms" in texts(figures["force.png"])
    assert "0.8 ms" in texts(figures["velocity.png"])
    assert "6.4 to 9.4 ms" in texts(figures["velocity.png"])


@pytest.mark.parametrize(
    ("old", "new"), [("mass = 18.49", "mass = 18.5"), ("0.0928, 0.0032", "0.0960, 0.0032")]
)
def test_another_test_gets_no_marks_of_the_papers(run, figures, old, new):
    replace_in_scene(run, old, new)
    plot_run(run)
    for name in ("force.png", "velocity.png"):
        assert "experiments" not in texts(figures[name])
        assert "paper" not in texts(figures[name])


def test_the_runs_own_numbers_are_marked(run, figures):
    plot_run(run)
    marks = texts(figures["force.png"])
    assert "$P_1$ = 605 N" in marks
    assert "$P_2$ = 750 N" in marks
    for name in ("force", "velocity", "energy"):  # each has the failure time read off its curve
        for mark in ("onset", "$t_1$", f"$t_2$ ({name})"):
            assert mark in texts(figures[f"{name}.png"]).split(" | ")
    lines = figures["force.png"].axes[0].lines
    at = [line.get_xdata()[0] for line in lines if line.get_linewidth() == 0.8]
    assert 7.5 in at  # the synthetic run's failure by the force


def test_numbers_that_the_summary_lacks_are_not_marked(run, figures):
    run.write_summary({"first_peak_force_n": float("nan"), "first_peak_time_s": None})
    plot_run(run)
    assert "$P_1$ =" not in texts(figures["force.png"])
    assert "$t_1$" not in texts(figures["energy.png"]).split(" | ")


def test_force_is_shown_as_sampled_and_smoothed(run, figures):
    plot_run(run)
    raw, smooth, *_ = (line.get_ydata() for line in figures["force.png"].axes[0].lines)
    history = run.read_history()
    np.testing.assert_array_equal(raw, history["striker_force_n"])
    # Away from the jump, the mean over ten samples of 20 us has noise of 40 N / sqrt(10).
    steady = (history["time_s"] > 2e-3) & (history["time_s"] < 7e-3)
    trend = 600.0 + 20e3 * (history["time_s"] - 1.75e-3)  # synthetic_run's force without noise
    assert (smooth - trend)[steady].std() == pytest.approx(40.0 / np.sqrt(10.0), rel=0.25)


def test_energies_are_those_of_the_history(run, figures):
    plot_run(run)
    upper, lower = figures["energy.png"].axes
    history = run.read_history()
    lines = {line.get_label(): line.get_ydata() for line in upper.lines}
    np.testing.assert_array_equal(lines["strain"], history["strain_j"])
    np.testing.assert_array_equal(lines["fracture"], history["fracture_j"])
    given = history["kinetic_striker_j"][0] - history["kinetic_striker_j"]
    np.testing.assert_allclose(lines["given up by the striker"], given)
    assert "damping" not in lines  # not in this history
    assert lower.get_yscale() == "log"


def test_a_run_without_striker_has_neither_force_nor_velocity(run, figures):
    keep_columns(run, [c for c in COLUMNS if "striker" not in c and "ring" not in c])
    replace_in_scene(run, run.scene_file.read_text().split("[striker]")[1].split("[clamp]")[0], "")
    replace_in_scene(run, "[striker]", "")
    assert [path.name for path in plot_run(run)] == ALL[2:]


def test_without_damage_there_is_no_crack_map(run, figures):
    replace_in_scene(run, "failure_factor", "damage = false\nfailure_factor")
    assert [path.name for path in plot_run(run)] == ALL[:3]


def test_a_run_that_has_hardly_begun_gives_what_there_is(run, figures):
    run.history_file.write_text(",".join(COLUMNS) + "\n")
    run.summary_file.unlink()
    assert [path.name for path in plot_run(run)] == ["crack_map.png", "cracks.png"]


def test_force_is_shown_filtered_where_the_scene_asks(run, figures):
    replace_in_scene(run, "[output]", "[output]\nfilter_frequencies = [1460.0, 3040.0]")
    plot_run(run)
    lines = {str(line.get_label()): line.get_ydata() for line in figures["force.png"].axes[0].lines}
    history = run.read_history()
    np.testing.assert_array_equal(lines["striker, as sampled"], history["striker_force_n"])
    t1 = run.read_summary()["first_peak_time_s"]
    for cutoff in (1.46, 3.04):
        filtered = lines[f"striker, low-pass at {cutoff:g} kHz after $t_1$"]
        assert np.isnan(filtered[history["time_s"] < t1]).all()
        steady = (history["time_s"] > 2.5e-3) & (history["time_s"] < 6.5e-3)
        trend = 600.0 + 20e3 * (history["time_s"] - 1.75e-3)  # synthetic_run's force without noise
        # white noise of 40 N keeps a share of about cutoff / 25 kHz (half the sampling rate)
        noise = (filtered - trend)[steady].std()
        assert noise == pytest.approx(40.0 * np.sqrt(cutoff / 25.0), rel=0.4)


def test_overlay_numbers_the_tips_and_draws_the_circle(run, figures):
    plot_run(run)
    left, right = figures["cracks.png"].axes
    # synthetic_run: five radial cracks; its ring is not cracked through
    assert left.get_title() == "5 radial cracks at $t_2$ (energy), 7.48 ms, from below"
    assert [text.get_text() for text in left.texts] == ["1", "2", "3", "4", "5"]
    labels = [text.get_text() for text in left.get_legend().get_texts()]
    assert any(label.startswith("$d_r$ = ") for label in labels)
    assert right.get_title() == "no circular crack at the end, from below"
    for axes in (left, right):
        assert axes.get_xlim()[0] > axes.get_xlim()[1]  # from below
        assert min(np.abs(axes.get_xlim())) > 38.0  # the clamp's circle is in the picture
        labels = [text.get_text() for text in axes.get_legend().get_texts()]
        assert "clamp, inner diameter 76 mm" in labels
    # what the legend calls cracked to a third has the map's grey
    image = left.images[0]
    greys = [image.cmap(image.norm(value)) for value in (3, 1)]
    squares = [line for line in left.lines if line.get_marker() == "s"]
    assert [line.get_color() for line in squares] == greys


def test_the_axes_hold_all_smoothed_forces(run, figures):
    table = run.read_history()
    table["ring_force_n"] = np.where(table["time_s"] > 8e-3, -900.0, table["ring_force_n"])
    header = ",".join(table)
    rows = np.column_stack(list(table.values()))
    np.savetxt(run.history_file, rows, delimiter=",", header=header, comments="")
    plot_run(run)
    low, high = figures["force.png"].axes[0].get_ylim()
    assert low < -900.0
    assert high > 750.0


def test_names_of_times_that_lie_close_stand_in_two_rows(run, figures):
    times = {"damage_onset_time_s": 1.4e-3, "first_peak_time_s": 1.8e-3, "failure_time_s": 7.5e-3}
    run.write_summary(times)
    plot_run(run)
    names = {text.get_text(): text for text in figures["force.png"].axes[0].texts}
    heights = [names[n].xyann[1] for n in ("onset", "$t_1$", "$t_2$ (force)")]
    assert heights[0] == heights[2] < heights[1]


def test_growth_marks_the_times(run, figures):
    plot_run(run)
    for mark in ("onset", "$t_1$", "$t_2$ (energy)"):
        assert mark in texts(figures["crack_growth.png"]).split(" | ")
    upper, _, lower, right = figures["crack_growth.png"].axes
    assert upper.lines[0].get_label() == "furthest radial tip, until $t_2$ (energy)"
    assert "without the core" in right.lines[0].get_label()
    assert np.all(np.diff(lower.lines[0].get_ydata()) >= 0)


CUTS = """
[[notch]]
normal = "x"
position = -0.01
from = [-0.09, 0.0]
to = [-0.03, 0.0032]
[[notch]]
centre = [0.0, 0.02, 0.0016]
diameter = 0.008
direction = [1.0, 1.0, 0.0]
[[hole]]
shape = "circle"
centre = [0.02, 0.0]
diameter = 0.01
"""


def test_notches_and_holes_are_drawn_on_the_maps_of_cracks(run, figures):
    run.write_scene(run.scene_file.read_text() + CUTS)
    plot_run(run)
    for name, axes in (
        ("crack_map.png", figures["crack_map.png"].axes[0]),
        *(("cracks.png", axes) for axes in figures["cracks.png"].axes),
    ):
        first = next(line for line in axes.lines if line.get_label() == "notches")
        assert "notches" in [text.get_text() for text in axes.get_legend().get_texts()], name
        x, y = first.get_data()
        assert set(x) == {-10.0}, name
        assert (min(y), max(y)) == pytest.approx((-90.0, -30.0))
        box = first.get_clip_box().get_points()  # the plate ends at -46.4 mm
        lowest = axes.transData.inverted().transform(box)[:, 1].min()
        assert lowest == pytest.approx(-46.4, abs=0.1)
        disc = axes.lines[axes.lines.index(first) + 1]
        x, y = disc.get_data()  # upright, so that it is a line of 8 mm from above
        np.testing.assert_allclose(x + y, 20.0)
        assert np.ptp(x) == pytest.approx(8 / np.sqrt(2), rel=1e-3)
        hole = axes.patches[1]
        np.testing.assert_allclose(np.hypot(*(hole.get_xy() - (20.0, 0.0)).T), 5.0)
        assert hole.get_facecolor()[:3] == (1.0, 1.0, 1.0)


def test_crack_map_shows_each_bar_at_its_place_seen_from_below(run, figures):
    points, hexahedra, _ = hexahedral_mesh(np.ones((2, 58, 58), dtype=bool), 1.6e-3, (0, 0, 0))
    writer = FieldWriter(run.fields_file, points, hexahedra)
    # One bar inside column (40, 10), one on the border of columns (5, 7) and (6, 7).
    place = np.array([(40.5, 10.5, 1.0), (6.0, 7.5, 1.0)]) * 1.6e-3 - (46.4e-3, 46.4e-3, 0.0)
    writer.append_broken(np.zeros(2), place, np.zeros(2, dtype=np.uint8))
    plot_run(run)
    axes = figures["crack_map.png"].axes[0]
    image = axes.images[0]
    assert image.get_extent() == pytest.approx([-46.4, 46.4, -46.4, 46.4])
    share = np.asarray(image.get_array()) * 14 * 2  # of 14 bars a module, 2 modules a column
    assert share[10, 40] == pytest.approx(1.0)
    assert share[7, 5] == pytest.approx(0.5)
    assert share[7, 6] == pytest.approx(0.5)
    assert share.sum() == pytest.approx(2.0)
    left, right = axes.get_xlim()
    assert left > right
    assert "2 at t = 9.98 ms" in axes.get_title()  # the history's last row
    clamp = next(line for line in axes.lines if "76 mm" in str(line.get_label()))
    np.testing.assert_allclose(np.hypot(*clamp.get_data()), 38.0)
