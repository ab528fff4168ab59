"""Sieve curves of the pieces, from a table with known masses."""

from pathlib import Path

import numpy as np
from support.synthetic import add_fragments, synthetic_run

from taichi_ldem.output.curves.chart import Curve
from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.storage.folder import RunFolder


def _run(path: Path) -> RunFolder:
    folder = synthetic_run(path)
    add_fragments(folder)
    return folder


def test_mass_and_number_of_the_pieces_over_their_size(tmp_path: Path) -> None:
    run = LoadedRun.read(_run(tmp_path / "run"))
    figure = FIGURES["fragments"]
    assert figure.needs(run)
    assert figure.panels is not None
    mass, number = figure.panels(run)
    assert mass.note == "3 pieces at 10.000 ms; single nodes: 1 % of the mass"
    (curve,) = (element for element in mass.elements if isinstance(element, Curve))
    np.testing.assert_allclose(curve.x, [1, 2, 2, 28, 28])
    np.testing.assert_allclose(curve.y, [1, 1, 10, 10, 100])
    (curve,) = (element for element in number.elements if isinstance(element, Curve))
    np.testing.assert_allclose(curve.x, [2, 2, 28])
    np.testing.assert_allclose(curve.y, [3, 1, 1])


def test_the_page_shows_them_without_a_line_at_the_readers_time(tmp_path: Path) -> None:
    from taichi_ldem.output.report import plots

    found = {f.name: f for f in plots.figures(LoadedRun.read(_run(tmp_path / "run")))}
    assert found["fragment_mass"].marker == found["fragment_number"].marker == "none"
    assert '"type":"log"' in found["fragment_mass"].json


def test_a_run_without_the_key_has_no_such_figure(tmp_path: Path) -> None:
    assert not FIGURES["fragments"].needs(LoadedRun.read(synthetic_run(tmp_path / "run")))
