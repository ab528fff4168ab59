"""Strengths of pulled bars: what is read from a pull, the closed form, and what is pulled again."""

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from studies import weakest_link
from taichi_ldem.model.disorder import shape_from_cv
from taichi_ldem.solver import backend

LENGTH = weakest_link.LENGTHS[0]


def _pull(strains: list[float], energies: list[float], broken: list[int]) -> Iterator:
    for strain, energy, count in zip(strains, energies, broken, strict=True):
        yield SimpleNamespace(
            energy_error_of_plate=1e-3 * strain,
            observed={"grip_displacement_m": strain * LENGTH},
            broken_bars=count,
            ledger=SimpleNamespace(strain=energy),
        )


def test_the_strength_is_read_where_the_strain_energy_is_largest() -> None:
    strains = [0.01, 0.015, 0.02, 0.022, 0.03, 0.04]
    energies = [1.0, 2.2, 4.0, 3.9, 3.0, 100.0]  # the last is after the end
    samples = _pull(strains, energies, [0, 3, 9, 20, 40, 50])
    found = weakest_link.pulled(SimpleNamespace(samples=lambda: samples), LENGTH)  # type: ignore[arg-type]
    assert found["first"] == pytest.approx(3.35e9 * 0.015)
    assert found["strength"] == pytest.approx(3.35e9 * 0.02)
    assert found["energy_error"] == pytest.approx(1e-3 * 0.03)
    assert next(samples).broken_bars == 50  # nothing was pulled further


@pytest.mark.parametrize("modules", weakest_link.MODULES)
@pytest.mark.parametrize("length", weakest_link.LENGTHS)
def test_bars_have_their_length_between_the_grips(length: float, modules: int) -> None:
    scene = weakest_link.scene(length, modules, 3, "module")
    spacing = scene.plate.spacing
    assert spacing == pytest.approx(weakest_link.WIDTH / modules)
    # the grips hold the nodes of the last module at either end
    assert spacing < scene.grips.length < 1.5 * spacing
    assert scene.plate.size[0] - 2 * spacing == pytest.approx(length)
    assert scene.grips.velocity / length == pytest.approx(weakest_link.RATE)


def _rows() -> list[dict]:
    """Strengths on Weibull's closed form, at quantiles that leave its mean and scatter."""
    shape, rows = shape_from_cv(weakest_link.CV), []
    for length in weakest_link.LENGTHS:
        volume = weakest_link.WIDTH**2 * length
        mean = weakest_link.SIGMA * (weakest_link.VOLUME / volume) ** (1 / shape)
        share = np.linspace(-1, 1, 40)
        values = mean * (1 + weakest_link.CV * share / share.std(ddof=1))
        for modules in weakest_link.MODULES:
            rows += [
                {"length": length, "modules": modules, "strength": v, "first": 0.9 * v}
                for v in values
            ]
    return rows


def test_specimens_on_the_closed_form_are_printed_beside_it() -> None:
    lines = weakest_link.table(_rows()).splitlines()[2:]
    assert len(lines) == len(weakest_link.LENGTHS) * len(weakest_link.MODULES)
    for line in lines:
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        first, strength = (float(cell.split(" ±")[0]) for cell in cells[3:5])
        assert cells[2] == "40"
        assert strength == pytest.approx(float(cells[5]), abs=0.11)
        assert first == pytest.approx(0.9 * strength, abs=0.11)
        assert cells[6].startswith("15.0 (")
        assert cells[7] == "15"
    # 37, 138 and 553 mm3 against the specimens' 97: larger ones are weaker
    expected = [float(line.split("|")[6]) for line in lines]
    assert expected[0] > 75.0 > expected[2] > expected[4]


def test_a_study_goes_on_where_it_was_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, taichi: None
) -> None:
    from taichi_ldem.solver import simulation

    pulled = []

    class Fake:
        def __init__(self, scene) -> None:
            self.reset(scene)

        def reset(self, scene) -> None:
            pulled.append((scene.plate.modules_through_thickness, scene.disorder.seed))

    monkeypatch.setattr(backend, "start", lambda solver: None)
    monkeypatch.setattr(simulation, "Simulation", Fake)
    monkeypatch.setattr(
        weakest_link, "pulled", lambda s, length: {"first": 1, "strength": 2, "energy_error": 0}
    )
    rows = weakest_link.measure(tmp_path, 3, "module")
    assert len(rows) == len(pulled) == 18
    file = tmp_path / "strengths.jsonl"
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[:-2]) + "\n")
    pulled.clear()
    again = weakest_link.measure(tmp_path, 3, "module")
    assert pulled == [(6, 2), (6, 3)]
    assert again == rows == [json.loads(line) for line in file.read_text().splitlines()]
