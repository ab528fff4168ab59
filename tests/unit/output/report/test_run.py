"""The HTML report: what stands in it, and what it does in a real browser."""

import dataclasses
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.browser import drive, need_browser
from support.synthetic import FAILURE, add_fragments, synthetic_run

from taichi_ldem.cli import main
from taichi_ldem.errors import SceneError
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.output.report.run import lead, write_report
from taichi_ldem.output.report.write import template
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    run = synthetic_run(tmp_path_factory.mktemp("runs") / "cracked")
    run.write_provenance(
        {"scene_sha256": "ab12", "version": "9.8", "command": "ldem impact x.toml"}
    )
    add_fragments(run)
    return run


@pytest.fixture(scope="module")
def page(folder: RunFolder) -> Path:
    """Its report; pictures at three times, drawn without a device, which is quick."""
    with pytest.MonkeyPatch.context() as patch:
        for variable in ("VK_ICD_FILENAMES", "VK_DRIVER_FILES"):
            patch.setenv(variable, "/nowhere/driver.json")
        return write_report(folder.path)


def _data(page: Path) -> dict:
    text = page.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    return json.loads(found[1].replace("<\\/", "</"))


class _Addresses(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [str(value) for name, value in attrs if name in ("src", "href")]


def test_it_loads_nothing_from_elsewhere(page: Path) -> None:
    parser = _Addresses()
    parser.feed(page.read_text(encoding="utf-8"))
    assert len(parser.found) > 5
    assert all(address.startswith(("data:", "#")) for address in parser.found)
    assert page.stat().st_size < 8e6


def test_it_says_what_was_asked_what_it_cost_and_how_to_repeat_it(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for part in (
        "58 x 58 x 2, L = 1.6000 mm",  # 92.8 mm over 1.6 mm
        "K_r (long., diag.)",
        "Left out, neither allocated nor compiled: damping (solver.damping = 0)",
        "605 N",  # of the synthetic summary
        "ab12",
        "ldem impact x.toml",
        "69, 65, 63, 64 mm",  # the paper's Table 1, since this is the paper's test
        "no Vulkan device",  # why the pictures are plain maps
    ):
        assert part in text, part


def test_curves_are_those_of_the_history(page: Path, folder: RunFolder) -> None:
    history, data = folder.read_history(), _data(page)
    np.testing.assert_allclose(data["times"], history["time_s"], rtol=1e-12)
    names = [figure["name"] for figure in data["figures"]]
    sizes = ["fragment_mass", "fragment_number"]
    assert names == ["force", "velocity", "energy", "error", *sizes, "broken", "crack_map"]
    readings = {reading["label"]: reading["values"] for reading in data["readings"]}
    np.testing.assert_allclose(
        readings["striker displacement"], 1e3 * history["striker_displacement_m"], rtol=1e-3
    )
    assert readings["broken bars"] == list(history["broken_bars"])  # counts keep their digits
    assert [shot["times"] for shot in data["snapshots"]] == [[0.0, 5e-3, 10e-3]]


def test_it_works_in_a_browser(page: Path) -> None:
    need_browser()
    script = """
      const slider = document.getElementById("time"), answer = {};
      const look = async () => { await pause(400); return {
        module: document.getElementById("plot-fragment_mass").layout.shapes.map(s => s.x0),
        line: [...document.querySelectorAll(".plot")]
          .filter(p => p.layout.shapes.length && p.id !== "plot-fragment_mass")
          .map(p => p.layout.shapes[p.layout.shapes.length - 1].x0),
        shown: [...document.querySelectorAll(".snapshot")]
          .map(s => [...s.querySelectorAll("img")].map(i => i.classList.contains("shown"))),
        now: document.getElementById("now").textContent,
        force: document.querySelector("#readings td:nth-child(2)").textContent,
        pale: document.getElementById("plot-crack_map").data[0].colorscale.slice(-2)[0][0],
      }; };
      await pause(1000);
      answer.end = await look();
      slider.value = 250; slider.dispatchEvent(new Event("input"));
      answer.middle = await look();
      document.querySelectorAll(".event")[3].click();
      answer.cut = [...document.querySelectorAll("table")].filter(t => t.clientWidth &&
        t.scrollWidth > t.parentElement.clientWidth + 1).length;
      answer.folded = [...document.querySelectorAll("#asked ~ details")].map(d => d.open);
      answer.failure = await look();
      slider.value = 0; slider.dispatchEvent(new Event("input"));
      answer.start = await look();
      document.getElementById("play").click(); await pause(1000);
      document.getElementById("play").click();
      answer.played = Number(slider.value);
      answer.images = [...document.images].map(i => i.complete && i.naturalWidth > 0);
      answer.curves = document.querySelectorAll(".plot .scatterlayer .trace").length;
      answer.loaded = performance.getEntriesByType("resource").map(e => e.name.slice(0, 40))
        .filter(name => !name.startsWith("data:") && !name.startsWith("blob:"));
      return answer;
    """
    answer, faults = drive(page, script)
    assert faults == []
    assert answer["loaded"] == []
    assert answer["images"] == [True] * len(answer["images"])
    assert len(answer["images"]) >= 3
    assert answer["curves"] >= 10
    assert answer["cut"] == 0  # no table is wider than its place
    assert answer["folded"][:3] == [False, False, False]
    # 500 rows of 0.02 ms; the line stands at the time in all five curves, pictures are the nearest
    for name, ms, picture in (("end", 9.98, 2), ("middle", 5.0, 1), ("start", 0.0, 0)):
        at = answer[name]
        assert at["line"] == pytest.approx([ms] * 5)
        assert at["now"] == f"{ms:.3f} ms"
        assert at["module"] == pytest.approx([1.6 * (6 / np.pi) ** (1 / 3)])  # not a time
        assert at["shown"] == [[n == picture for n in range(3)]]
        assert at["pale"] == pytest.approx(max(ms / 9.98, 1e-4), abs=2e-4)
    assert answer["failure"]["line"] == pytest.approx([1e3 * FAILURE] * 5)
    assert answer["middle"]["force"] != answer["end"]["force"]
    assert answer["played"] > 0


def test_a_run_without_figures_or_summary_has_a_page(tmp_path: Path) -> None:
    run = synthetic_run(tmp_path / "whole", cracked=False)
    run.fields_file.unlink()
    with HistoryWriter(run.history_file, ["time_s", "energy_error"]) as history:
        history.append((0.0, float("nan")))
    text = write_report(run.path).read_text(encoding="utf-8")
    assert "Not finished: until 0.000 of 10.000 ms" in text
    assert "no summary yet" in text
    assert len(text) < 1e5  # plotly stays out


def test_events_that_did_not_happen_are_named(tmp_path: Path) -> None:
    run = synthetic_run(tmp_path / "whole", cracked=False)
    numbers = {
        "damage_onset_time_s": 1e-3,
        "first_peak_force_n": 605.4321,
        "failure_time_s": None,
        "failure_time_energy_s": None,
        "radial_cracks": 3,
        "radial_diameter_m": 0.0123456,
        "circular_diameter_m": None,
        "energy_error": 1e-4,
        "energy_error_of_plate": 0.0046649,
    }
    run.write_summary(numbers)
    text = write_report(run.path, pictures=0).read_text(encoding="utf-8")
    for part in (
        "<b>605 N</b><span>first peak P1</span>",
        "<b>none within 10.0 ms</b><span>failure t2 (force)</span>",
        "<b>none</b><span>d_c, circular crack</span>",
        "<b>12.3 mm</b><span>d_r, circle of the radial tips, measured at the end: no failure",
        "<b>0.466 %</b><span>energy error, of what the plate was given</span>",
        "disabled>t2 (energy): none</button>",
        'data-time="0.001">onset of damage, 1.00 ms</button>',
    ):
        assert part in text, part
    assert "failure t2 (velocity)</span>" not in text  # the summary does not know it
    assert text.index('id="happened"') < text.index('id="asked"')
    assert "<td>striker.mass</td><td>18.49</td><td>kg</td>" in text


def test_a_random_material_is_described(tmp_path: Path) -> None:
    run = synthetic_run(tmp_path / "random")
    table = "[disorder]\nfracture_energy_cv = 0.25\ncorrelation_length = 3e-3\nseed = 7\n"
    run.write_scene(run.scene_file.read_text(encoding="utf-8") + table)
    expected = "Random fracture energy with a CV of 25 %{}, correlated over 3 mm, seed 7"
    loaded = LoadedRun.read(run)
    assert expected.format("") in lead(dataclasses.replace(loaded, summary={"wall_s": 1.0}))
    with h5py.File(run.path / "checkpoint.h5", "w") as file:
        file["state/clock/drawn"] = [(1.0012, 0.2493)]
    drawn = " (drawn: 24.9 %, mean 1.001 times the given one)"
    assert expected.format(drawn) in lead(dataclasses.replace(loaded, summary={"wall_s": 1.0}))


def test_modes_have_a_page(tmp_path: Path) -> None:
    modes = tmp_path / "modes"
    modes.mkdir()
    (modes / "scene.toml").write_text(
        'scenario = "modes"\n[plate]\nsize = [0.01, 0.01, 0.002]\nmodules_through_thickness = 2\n'
        "[material]\nyoungs_modulus = 3e9\npoisson_ratio = 0.25\ndensity = 1e3\ndamage = false\n"
    )
    (modes / "modes.csv").write_text("mode,frequency_hz\n1,1234.5678\n")
    (modes / "summary.json").write_text('{"frequencies_hz": [1234.5678], "wall_s": 2.0}')
    text = write_report(modes).read_text(encoding="utf-8")
    assert "1.235 kHz" in text
    assert "<td>1234.6</td>" in text


def test_bad_input_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(tmp_path)]) == 2
    assert "is no run folder: it has no scene.toml" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "plotly", None)
    with pytest.raises(SceneError, match=r"taichi-ldem\[report\]"):
        template()
