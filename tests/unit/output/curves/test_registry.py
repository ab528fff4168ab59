"""Figures are found by the names in the scenarios' entries, and every element can be drawn."""

from pathlib import Path

import pytest
from support.synthetic import synthetic_run

from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.figures.run import _DRAWN_HERE
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.scenarios.registry import SCENARIOS


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
