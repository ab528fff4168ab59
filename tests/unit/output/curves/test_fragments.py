"""Sieve curves of the pieces, from a table with known masses."""

from pathlib import Path

import numpy as np
from support.synthetic import synthetic_run

from taichi_ldem.output.curves.chart import Curve
from taichi_ldem.output.curves.registry import FIGURES
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.fragments import COLUMNS, FragmentWriter


def _run(path: Path) -> RunFolder:
    """At the end: debris with 1 % of the mass, two pieces of 2 mm with 9 %, one with 90 %."""
    folder = synthetic_run(path)
    text = folder.scene_file.read_text()
    folder.write_scene(text + "fragments = true\n")  # the last table is [output]
    writer = FragmentWriter(folder.fragments_file)
    for time, numbers, masses, sizes in (
        (0.0, [1], [1.0], [0.03]),
        (1e-2, [0, 1, 2, 3], [0.01, 0.90, 0.06, 0.03], [1e-3, 0.028, 2e-3, 2e-3]),
    ):
        values = {name: np.zeros(len(numbers)) for name in COLUMNS}
        known = {"fragment": numbers, "mass_kg": masses, "equivalent_diameter_m": sizes}
        writer.append(time, values | {name: np.array(v) for name, v in known.items()})
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
