"""Interactive figures of the page."""

import json
from pathlib import Path

import numpy as np
from support.synthetic import synthetic_run

from taichi_ldem.output.curves.forces import force
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.output.report.plots import figure


def test_all_of_the_forces_is_in_the_plot(tmp_path: Path) -> None:
    run = LoadedRun.read(synthetic_run(tmp_path / "run"))
    history = dict(run.history)
    history["ring_force_n"] = np.where(history["time_s"] > 8e-3, -900.0, 0.0)
    (panel,) = force(LoadedRun(run.folder, run.scene, history, {}))
    plot = json.loads(figure(panel).json)
    low, high = plot["layout"]["yaxis"]["range"]
    assert low < -900.0
    assert high > 830.0  # the largest P2 of the paper's experiments
    assert "rings, mean over 0.2 ms, positive upwards" in [t["name"] for t in plot["data"]]


def test_a_page_shows_the_same_series_as_the_figure(tmp_path: Path) -> None:
    run = LoadedRun.read(synthetic_run(tmp_path / "run"))
    (panel,) = force(run)
    plot = json.loads(figure(panel).json)
    shown = [item["name"] for item in (*plot["data"], *plot["layout"]["shapes"])]
    labels = [element.label for element in panel.elements if getattr(element, "label", "")]
    assert sorted(shown) == sorted(labels)
    assert "experiments, P2 and t2" in labels  # the synthetic run is the paper's test
