"""Hertz's force, and that on a layer: a published polynomial, and a run made from the formula."""

from pathlib import Path

import numpy as np
import pytest
from support.paths import CONFIGS

from studies.indentation import MODULES, WINDOW, layer, main
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter


@pytest.mark.parametrize("x", [0.1, 0.3, 0.5])
def test_an_incompressible_layer_is_that_of_the_paper(x: float) -> None:
    """Dimitriadis et al. (2002), Eq. 13: the layer that is not bonded, with nu = 1/2."""
    expected = 1 + 0.884 * x + 0.781 * x**2 + 0.386 * x**3 + 0.0048 * x**4
    assert layer(x, 0.5) == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize("nu", [0.0, 0.25, 0.4])
def test_a_thick_layer_is_a_half_space(nu: float) -> None:
    assert layer(0.0, nu) == 1.0
    assert 1.0 < layer(0.05, nu) < layer(0.1, nu) < 1.1


def _run(path: Path, factor: float) -> Path:
    """A run of the shipped scene whose force is a factor times the layer's."""
    folder = RunFolder.create(path, force=False)
    folder.write_scene((CONFIGS / "impact_indent.toml").read_text())
    scene = folder.read_scene()
    (striker,), material = scene.strikers, scene.material
    columns = ("time_s", "striker_displacement_m", "striker_force_n")
    radius, height = striker.diameter / 2, scene.plate.size[2]
    with HistoryWriter(folder.history_file, columns) as history:
        for time in np.arange(0.0, 4e-4, 2e-6):
            depth = 0.05 * time
            stiffness = 4 / 3 * material.youngs_modulus / (1 - material.poisson_ratio**2)
            hertz = stiffness * radius**0.5 * depth**1.5
            force = factor * hertz * layer((radius * depth) ** 0.5 / height, material.poisson_ratio)
            history.append((time, depth, force))
    return path


@pytest.mark.parametrize("factor", [1.0, 0.9])
def test_a_run_made_from_the_formula_is_read_as_it_was_made(
    factor: float, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main([str(_run(tmp_path / "run", factor))]) == 0
    rows = [line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines()[2:]]
    found = [float(row[1]) for row in rows]
    # to 4 modules: the scene ends 20 um deep
    assert found == pytest.approx([n for n in MODULES if n <= 4.0], abs=0.05)
    for row in rows[1:]:
        assert row[0] == "24"
        depth = 1e-6 * float(row[2])
        # the mean of t^1.5 over a window w is above its middle by 3/4 (w / t)^2 / 24 of it
        curved = 0.75 * (WINDOW / (depth / 0.05)) ** 2 / 24
        expected = 100 * (factor * (1 + curved) - 1)
        assert float(row[-1].removesuffix(" %")) == pytest.approx(expected, abs=0.2)
        assert (0.2 * depth) ** 0.5 / 5e-4 == pytest.approx(float(row[1]), abs=0.01)
