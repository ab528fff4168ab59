"""``ldem paper``: what it runs, how it goes on, and what it writes from run folders."""

import itertools
import json
from pathlib import Path

import pytest
from support.paths import ROOT
from support.synthetic import synthetic_run

from taichi_ldem.cli import app as cli
from taichi_ldem.cli import main
from taichi_ldem.errors import SceneError
from taichi_ldem.reproduction import paper as reproduction
from taichi_ldem.reproduction.paper import (
    ITEMS,
    NEEDS,
    Context,
    Need,
    Row,
    available,
    chosen,
    conduct,
    reproduce,
    write,
)
from taichi_ldem.scene import load_scene


def test_every_item_s_runs_are_known_and_their_commands_parse() -> None:
    import typer

    group = typer.main.get_command(cli.app)
    assert {name for item in ITEMS for name in item.needs} == set(NEEDS)
    for need in filter(available, NEEDS.values()):
        for quick, again in itertools.product((False, True), repeat=2):
            words = need.command(Path("outputs/x"), quick=quick, again=again and bool(need.resume))
            _, module, command, *rest = words
            if module != "taichi_ldem.cli":
                continue
            group.commands[command].make_context(command, list(rest)).close()
            given = [b for a, b in itertools.pairwise(rest) if a == "--set"]
            for scene in (word for word in rest if word.endswith(".toml")):
                load_scene(ROOT / scene, given)


def test_a_quick_run_is_another_command() -> None:
    need, folder = NEEDS["ensemble"], Path("x")
    words = need.command(folder, quick=True, again=True)
    assert "configs/impact_small.toml" in words
    assert [word for word in words if word.endswith(".toml")] == [words[3]]
    assert words.count("f32") == 1
    assert NEEDS["impact"].command(folder, quick=True, again=True)[2:4] == ["resume", "x"]


@pytest.mark.parametrize(
    ("row", "told"),
    [
        (Row("P1", "N", 540.0, 600.0), "-10 % from the paper"),
        (Row("t2", "ms", 7.0, None, (6.4, 9.4)), "within the experiments"),
        (Row("t2", "ms", 3.2, 6.4, (6.4, 9.4)), "-50 % from the paper; -50 % from their range"),
        (Row("d_r", "mm", 103.5, None, (63.0, 69.0)), "+50 % from their range"),
        (Row("d_c", "mm", None, 42.0), ""),
    ],
)
def test_differences(row: Row, told: str) -> None:
    assert row.difference() == told


SCRIPT = """
import pathlib, sys
folder = pathlib.Path(sys.argv[1]); folder.mkdir(parents=True, exist_ok=True)
if len(sys.argv) == 2:
    (folder / "checkpoint.h5").touch(); sys.exit("cut off")
(folder / "summary.json").write_text(repr(sys.argv[2:]).replace("'", '"'))
"""


def test_runs_are_resumed_and_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "run.py"
    script.write_text(SCRIPT)
    resume = (str(script), "{out}", "resumed")
    need = Need("impact", (str(script), "{out}"), (), resume=resume)
    monkeypatch.setitem(NEEDS, "impact", need)
    monkeypatch.setattr(reproduction, "available", lambda need: True)
    told: list[str] = []
    failed = conduct(["impact"], tmp_path, quick=False, resume=False, tell=told.append)
    assert failed == {"impact": "ended with exit code 1: cut off"}
    assert conduct(["impact"], tmp_path, quick=False, resume=True, tell=told.append) == {}
    summary = tmp_path / "runs/impact/summary.json"
    assert json.loads(summary.read_text()) == ["resumed"]
    assert conduct(["impact"], tmp_path, quick=False, resume=True, tell=told.append) == {}
    assert told[-1] == "impact: finished already"


def test_the_report_stands_beside_the_paper(tmp_path: Path) -> None:
    run = synthetic_run(tmp_path / "runs/impact")
    (run.path / "force.png").write_bytes(b"picture")
    failed = {"ensemble": "`ldem ensemble` is not in this version"}
    items = chosen("fig2,fig11,fig12,fig16")
    text = write(items, Context(tmp_path), failed)
    # of the synthetic summary, the paper's text and its Table 1
    assert "| P1 [N] | 605 | 600 |  | +1 % from the paper |" in text
    t2 = "| t2 (force) [ms] | none | 7.50 | 6.40 to 9.40 |"
    summary = run.read_summary()
    t2 = t2.replace("none", f"{1e3 * summary['failure_time_s']:.2f}")
    assert t2 in text
    assert "| radial cracks | none | 5 | 6 to 9 |" in text
    assert "Bars hold E eps_p = 58.5 MPa where 75 MPa was measured: the plate cracks early." in text
    assert "| EA_d [N] | " in text
    assert "![Fig. 11: force and velocity, derived defaults: force](images/fig11.png)" in text
    assert (tmp_path / "images/fig11.png").read_bytes() == b"picture"
    assert (tmp_path / "images/fig2.png").stat().st_size > 10_000
    assert text.rstrip().count("Missing: `ldem ensemble` is not in this version.") == 1
    titles = [line for line in text.splitlines() if line.startswith("## ")]
    assert titles == [*(f"## {item.title}" for item in items), "## Cost"]


def test_table_2_averages_pairs(tmp_path: Path) -> None:
    folder = tmp_path / "runs/modes"
    folder.mkdir(parents=True)
    told = {
        "names": ["(0, 0)", "(1, 0)", "(1, 0)", "outside"],
        "frequencies_hz": [1.7e3, 3.4e3, 3.6e3, 9.0],
    }
    (folder / "summary.json").write_text(json.dumps(told))
    text = write(chosen("table2"), Context(tmp_path), {})
    assert "| mode (0, 0) [kHz] | 1.700 | 1.460 |  | +16 % from the paper |" in text
    assert "| mode (1, 0) [kHz] | 3.500 | 3.040 |" in text
    assert "| mode (0, 2) [kHz] | none | 11.850 |" in text


def test_bad_input_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["paper", "--only", "fig99"]) == 2
    assert "--only fig99: must be one of fig2" in capsys.readouterr().err
    (tmp_path / "paper.json").write_text('{"quick": true}')
    monkeypatch.chdir(ROOT)
    with pytest.raises(SceneError, match="--resume goes on"):
        reproduce(tmp_path, only="fig2")
    with pytest.raises(SceneError, match="was begun with --quick"):
        reproduce(tmp_path, only="fig2", resume=True)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SceneError, match="in a checkout"):
        reproduce(tmp_path / "new", only="fig2")


def test_an_ensemble_that_was_cut_off_is_not_whole(tmp_path: Path) -> None:
    folder = tmp_path / "runs/ensemble"
    folder.mkdir(parents=True)
    for finished, whole in ((2, False), (13, True)):
        (folder / "ensemble.json").write_text(json.dumps({"finished": finished, "members": 13}))
        assert reproduction._is_whole(NEEDS["ensemble"], folder) is whole
