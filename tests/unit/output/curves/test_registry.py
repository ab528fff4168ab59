"""Figures are found by the names in the scenarios' entries, and every element can be drawn."""

from pathlib import Path

import pytest
from support.paths import CONFIGS
from support.synthetic import synthetic_run

from taichi_ldem.output.curves.chart import Curve
from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.figures.run import _DRAWN_HERE
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scenarios.runner import columns
from taichi_ldem.scene import load_scene, scene_to_toml
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_figures_that_a_scenario_names_are_known(scenario: str) -> None:
    assert set(SCENARIOS[scenario].figures) <= set(FIGURES)


def test_every_figure_has_panels_or_a_function_that_draws_it() -> None:
    drawn = {name for name, figure in FIGURES.items() if figure.panels is not None}
    assert drawn.isdisjoint(_DRAWN_HERE)
    assert drawn | set(_DRAWN_HERE) == set(FIGURES) - {"modes"}  # drawn while its run goes on


def test_names_of_panels_are_unique(tmp_path: Path) -> None:
    run = LoadedRun.read(synthetic_run(tmp_path / "run"))
    panels = [f.panels(run) for f in FIGURES.values() if f.panels is not None and f.needs(run)]
    names = [panel.name for several in panels for panel in several]
    assert sorted(names) == ["broken", "energy", "error", "force", "velocity"]


def test_a_plate_that_falls_has_the_force_of_the_floor_and_what_it_was_given(
    tmp_path: Path,
) -> None:
    scene = load_scene(CONFIGS / "impact_drop.toml")
    folder = RunFolder.create(tmp_path / "run", force=False)
    folder.write_scene(scene_to_toml(scene))
    names = columns(scene)
    assert {"floor_force_n", "external_j", "contact_j"} < set(names)
    start = [0.032 if name == "kinetic_plate_j" else 0.0 for name in names]
    end = [1e-4 if name == "time_s" else 2e-5 * (name == "external_j") for name in names]
    with HistoryWriter(folder.history_file, names, [start, end]):
        run = LoadedRun.read(RunFolder.open(folder.path))
    found = {name for name in SCENARIOS["impact"].figures if FIGURES[name].needs(run)}
    assert {"floor_force", "energy"} <= found
    assert found.isdisjoint({"force", "velocity", "force_displacement"})
    energies = FIGURES["energy"].panels
    assert energies is not None
    given = energies(run)[0].elements[0]
    assert isinstance(given, Curve)
    assert given.label == "plate at the start + work of gravity"
    assert list(given.y) == [0.032, 0.032 + 2e-5]
