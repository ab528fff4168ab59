"""Tables and figures of a finished ensemble."""

import shutil
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from support.members import PAPER
from support.synthetic import synthetic_run

from taichi_ldem.cli import main
from taichi_ldem.ensemble.plan import (
    MEMBERS,
    make_plan,
    write_plan,
)
from taichi_ldem.ensemble.report import report
from taichi_ldem.output.figures import draw


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """An ensemble of the paper's test whose runs are made from formulas."""
    folder = tmp_path_factory.mktemp("finished")
    plan = make_plan(PAPER, cv="0,0.25", seeds="0:2")
    write_plan(plan, folder, 1)
    (folder / MEMBERS).mkdir()
    made = synthetic_run(folder / MEMBERS / "cv0")
    numbers = made.read_summary() | {"radial_cracks": 5, "circular_diameter_m": None}
    made.write_summary(numbers | {"radial_diameter_m": 0.05})
    for seed, diameter in ((0, 0.050), (1, 0.054)):
        path = folder / MEMBERS / f"cv0.25_seed{seed}"
        shutil.copytree(made.path, path)
        values = {"radial_cracks": 5 + seed, "radial_diameter_m": diameter}
        type(made)(path).write_summary(numbers | values)
    return folder


@pytest.fixture
def figures(monkeypatch) -> dict[str, Figure]:
    """The figures by file name, caught instead of being drawn."""
    caught: dict[str, Figure] = {}

    def catch(file: Path, figure: Figure, **_: object) -> None:
        caught[file.name] = figure

    monkeypatch.setattr(draw, "write_figure", catch)
    return caught


def test_plot_makes_tables_and_figures_from_the_folder(finished, figures, capsys):
    assert main(["plot", str(finished)]) == 0
    assert set(figures) == {
        "force_envelope.png",
        "velocity_envelope.png",
        "energy_envelope.png",
        "cracks_at_t2.png",
        "cracks_at_end.png",
    }
    assert "table3.md" in capsys.readouterr().out
    force = figures["force_envelope.png"]
    assert [axes.get_title() for axes in force.axes] == ["CV 25 %"]
    labels = [text.get_text() for text in force.legends[0].get_texts()]
    assert "between the smallest and the largest member" in labels
    assert "homogeneous" in labels
    assert "experiments, $P_1$ ~ 600 N at 1.75 ms" in labels
    titles = [axes.get_title() for axes in figures["cracks_at_t2.png"].axes]
    assert titles[0].startswith("5 radial cracks at")
    assert [title.split("\n")[0] for title in titles[2:]] == ["seed 0", "seed 1"]


def test_table_3_has_the_papers_values_beside(finished, figures):
    report(finished)
    lines = (finished / "table3.md").read_text().splitlines()
    assert any(line.startswith("| CV 25 % | 5 6 | 50.0 54.0 | - - |") for line in lines)
    assert any(line.startswith("| mean | 5.5 (two) | 52.0 (two) | - |") for line in lines)
    # the paper's Table 3
    paper = "| *paper's LDEM, CV 25 %* | 5 6 6 5 | 53.6 54.7 53.4 46.8 | 46 42 42 32 |"
    assert any(line.startswith(paper) for line in lines)
    table = (finished / "table3.csv").read_text().splitlines()
    assert "paper's LDEM,CV 50 %,1,5,0.0463,0.016,,,,,," in table
    assert sum(line.startswith("experiments") for line in table) == 4
