"""Damaged folders: every reading command ends with one line, without a traceback and a hang.

``pytest -m slow tests/robustness/test_folders.py`` takes 2100 mutations, the plain run 5.
"""

import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from support.members import SCENE
from support.mutations import damage
from support.paths import ROOT
from support.synthetic import synthetic_run

from taichi_ldem.cli import main
from taichi_ldem.ensemble import attempt
from taichi_ldem.ensemble.attempt import FINISHED, Outcome, write_outcome
from taichi_ldem.ensemble.plan import ATTEMPTS, MEMBERS, make_plan, write_plan
from taichi_ldem.ensemble.report import report as report_ensemble
from taichi_ldem.output.figures import draw
from taichi_ldem.storage import checkpoint as cp

LIMIT_S = 30


class Accepted(Exception):
    """A command has read all files and would begin to compute."""


def make_run(path: Path) -> None:
    """A run folder with all kinds of files."""
    run = synthetic_run(path, layers=1)
    run.write_provenance({"version": "1", "scene_sha256": "ab", "packages": {"taichi": "1.7"}})
    state = {"clock/step_number": np.array(7), "clock/drawn": np.zeros((0, 2))}
    history = [{"time_s": 0.1 * n, "broken_bars": n} for n in range(3)]
    checkpoint = cp.Checkpoint(run.read_scene(), state, history, 0.2, 1.0, 3, 0)
    (path / cp.LATEST).write_bytes(cp.encode(checkpoint))
    run.claim(["force.png"])
    (path / "force.png").write_bytes(b"picture")


def make_ensemble(path: Path) -> None:
    """An ensemble of two members that have finished."""
    plan = make_plan(SCENE, vary=["striker.velocity=2,3"])
    path.mkdir()
    write_plan(plan, path, 1)
    (path / ATTEMPTS).mkdir()
    for member in plan.members:
        synthetic_run(path / MEMBERS / member.name, layers=1)
        write_outcome(path, Outcome(member.name, 1, FINISHED))
    report_ensemble(path)


def make_paper(path: Path) -> None:
    """A reproduction of some items, whose runs are those of the folders beside it."""
    shutil.copytree(path.parent / "run", path / "runs" / "impact")
    shutil.copytree(path.parent / "ensemble", path / "runs" / "ensemble")
    (path / "paper.json").write_text('{"quick": false}')


MAKERS: dict[str, Callable[[Path], None]] = {
    "run": make_run,
    "ensemble": make_ensemble,
    "paper": make_paper,
}
COMMANDS = {
    "run": (
        ["plot"],
        ["report"],
        ["render"],
        ["resume"],
        ["render", "--time", "1", "--view", "cut"],
    ),
    "ensemble": (
        ["report"],
        ["plot"],  # writes the tables again
        ["ensemble", str(SCENE), "--vary", "striker.velocity=2,3", "--resume", "--out"],
    ),
    "paper": (["paper", "--resume", "--only", "fig11,fig12,fig16", "--out"],),
}


def _save(figure: Figure, path: Path, **_: object) -> None:
    """A picture of two pixels instead of the figure."""
    Image.new("RGB", (2, 2)).save(path, "PNG")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of each kind, undamaged."""
    place = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", _save)
        for name, make in MAKERS.items():
            make(place / name)
    return place


class Paper:
    """Stands in for the painter: pictures without anything on them."""

    def paint(self, triangles: Any, colours: Any, aspect: float) -> Any:
        assert np.isfinite(triangles).all()
        return np.ones((max(1, round(40 * aspect)), 40, 3))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands without what takes long: drawing, the page's script, and Taichi."""
    from taichi_ldem.output.render import __main__ as child
    from taichi_ldem.output.report import write
    from taichi_ldem.scenarios import runner

    def accepted(*_: object) -> None:
        raise Accepted

    def process(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        if "taichi_ldem.output.render" not in command:
            raise Accepted
        return subprocess.CompletedProcess(command, child.main(command[3:]), "", "")

    monkeypatch.setattr(Figure, "savefig", _save)
    monkeypatch.setattr(child, "Painter", Paper)
    monkeypatch.setattr(child, "vulkan_device", lambda: True)
    monkeypatch.setattr(subprocess, "run", process)
    monkeypatch.setattr(write, "_plotly", lambda: "")
    monkeypatch.setattr(runner.WORKBENCH, "build", accepted)
    monkeypatch.setattr(attempt, "_start", accepted)  # in a thread: its attempt has failed then
    monkeypatch.chdir(ROOT)


@pytest.fixture
def limited() -> Iterator[None]:
    """A command that hangs raises instead."""

    def late(*_: object) -> None:
        raise AssertionError(f"no end within {LIMIT_S} s")

    old = signal.signal(signal.SIGALRM, late)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, old)


def run(words: list[str], folder: Path) -> int | None:
    """A command's exit code; None where it would begin to compute."""
    signal.alarm(LIMIT_S)
    try:
        at = 1 if words[0] in ("plot", "report", "render", "resume") else len(words)
        return main([*words[:at], str(folder), *words[at:]])
    except Accepted:
        return None
    finally:
        signal.alarm(0)


def verify(words: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> int | None:
    code = run(words, folder)
    errors = capsys.readouterr().err.splitlines()
    said = [line for line in errors if line.startswith("error: ")]
    assert code in (None, 0, 1, 2, 5), code
    assert len(said) == (code in (1, 2)), errors
    assert not any("Traceback" in line for line in errors), errors
    return code


@pytest.mark.usefixtures("quick", "limited")
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("kind", "count"),
    [
        *(("run", 2), ("ensemble", 1), ("paper", 2)),
        *(pytest.param(kind, 700, marks=pytest.mark.slow) for kind in MAKERS),
    ],
)
def test_damaged_folders(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, count: int
) -> None:
    folder = tmp_path / kind
    shutil.copytree(whole / kind, folder)
    for words in COMMANDS[kind]:
        assert verify(words, folder, capsys) in (0, None)
    suffixes = (".json", ".csv", ".toml", ".vtkhdf", ".h5", ".md")
    files = sorted(p.relative_to(whole / kind) for p in (whole / kind).rglob("*.*"))
    files = [file for file in files if file.suffix in suffixes]
    rng = np.random.default_rng(11)
    codes = []
    for number in range(count):
        file = files[number % len(files)]
        damage(folder / file, rng)
        for words in COMMANDS[kind]:
            try:
                codes.append(verify(words, folder, capsys))
            except BaseException as error:
                error.add_note(f"{kind}, mutation {number}: {words[0]} with {file}")
                raise
        restore(folder / file, whole / kind / file)


def restore(file: Path, whole: Path) -> None:
    if file.is_dir() and not file.is_symlink():
        shutil.rmtree(file)
    else:
        file.unlink(missing_ok=True)
    shutil.copyfile(whole, file)


def replaced(old: str, new: str) -> Callable[[Path], None]:
    """Another text in a file."""

    def change(path: Path) -> None:
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8", errors="surrogatepass")

    return change


def piped(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def second_column(values: list[str]) -> Callable[[Path], None]:
    """Other times in a history, one after the other and again from the first."""

    def change(path: Path) -> None:
        head, *lines = path.read_text().splitlines()
        pieces = [line.partition(",")[2] for line in lines]
        rows = [f"{values[n % len(values)]},{rest}" for n, rest in enumerate(pieces)]
        path.write_text("\n".join([head, *rows]) + "\n")

    return change


def unequal(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        file["BrokenBars/bar"].resize(5, axis=0)


def not_finite(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        file["VTKHDF/CellData/broken_fraction"][-1] = np.nan


DAMAGES: list[tuple[str, Callable[[Path], None], str]] = [
    ("history.csv", replaced("striker_force_n", "force"), "has no column 'striker_force_n'"),
    ("history.csv", replaced("strain_j", "strain"), "has no column 'strain_j'"),
    ("history.csv", second_column(["0.0"]), "is not later than the line before"),
    ("history.csv", second_column(["nan"]), "time_s = nan"),
    ("history.csv", replaced(",1.065,", ",nan,"), "nan, which no run writes there"),
    ("history.csv", piped, "a pipe or a device, not a file"),
    ("summary.json", replaced("605.0", "9" * 400), "a whole number of 400 digits"),
    ("summary.json", replaced("605.0", "[" * 5000 + "]" * 5000), "nested too deeply"),
    ("summary.json", replaced("605.0", '"\\ud800"'), "half of a character"),
    ("summary.json", replaced("605.0", '"many"'), "first_peak_force_n is no number"),
    ("summary.json", piped, "a pipe or a device, not a file"),
    ("run.json", replaced("processes", "runs"), "has no list of processes"),
    ("run.json", piped, "a pipe or a device, not a file"),
    ("fields.vtkhdf", piped, "a pipe or a device, not a file"),
    ("fields.vtkhdf", unequal, "its lists of broken bars have"),
    ("fields.vtkhdf", not_finite, "values of broken_fraction are not finite"),
    ("scene.toml", piped, "a pipe or a device, not a file"),
    ("scene.toml", replaced("[plate]", "[plate"), "not valid TOML"),
]


@pytest.mark.usefixtures("quick", "limited")
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("command", "file", "change", "what"),
    [(("plot", "report")[n % 2], *case) for n, case in enumerate(DAMAGES)],
    ids=[what[:40] for _, _, what in DAMAGES],
)
def test_a_damaged_file_is_named(
    whole: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    command: str,
    file: str,
    change: Callable[[Path], None],
    what: str,
) -> None:
    shutil.copytree(whole / "run", tmp_path / "run")
    change(tmp_path / "run" / file)
    assert run([command], tmp_path / "run") == 1
    (line,) = (text for text in capsys.readouterr().err.splitlines() if "warning" not in text)
    assert line.startswith("error: ")
    assert file in line
    assert what in line


@pytest.mark.usefixtures("quick", "limited")
@pytest.mark.parametrize(
    ("file", "change"),
    [("run.json", piped), ("scene.toml", piped), ("run.json", replaced("{", "["))],
)
def test_a_run_is_resumed_from_whole_files_only(
    whole: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    file: str,
    change: Callable[[Path], None],
) -> None:
    words, folder = ["resume", "--extend", "0.001"], tmp_path / "run"
    shutil.copytree(whole / "run", folder)
    assert run(words, folder) is None  # it would go on
    change(folder / file)
    assert run(words, folder) == 1
    assert file in capsys.readouterr().err


@pytest.mark.usefixtures("quick", "limited")
def test_a_mark_before_the_texts_of_a_folder_is_passed_over(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(whole / "run", folder)
    for name in ("scene.toml", "history.csv", "summary.json", "run.json"):
        (folder / name).write_bytes(b"\xef\xbb\xbf" + (folder / name).read_bytes())
    assert [run([command], folder) for command in ("plot", "report")] == [0, 0]


@pytest.mark.usefixtures("quick", "limited")
def test_figures_from_damaged_fields_say_so(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(whole / "run", folder)
    unequal(folder / "fields.vtkhdf")
    not_finite(folder / "fields.vtkhdf")
    said: dict[str, bool] = {}
    drawn: list[bool] = []

    def save(figure: Figure, path: Any, **_: object) -> None:
        texts = " ".join(text.get_text() for text in figure.texts)
        drawn.append("fields.vtkhdf is damaged: " in texts)
        _save(figure, path)
        if isinstance(path, (str, Path)):
            said[Path(path).name] = drawn[-1]

    def write(path: Path, content: bytes) -> None:
        said[path.name] = drawn[-1]  # figures go to memory first
        path.write_bytes(content)

    monkeypatch.setattr(Figure, "savefig", save)
    monkeypatch.setattr(draw, "write_whole", write)
    assert run(["plot"], folder) == run(["render", "--time", "0.01"], folder) == 1
    assert {name for name, found in said.items() if found} == {
        *("crack_map.png", "cracks.png", "crack_growth.png"),
        *(f"crack_10ms_{view}.png" for view in ("below", "above", "cut")),
    }
    assert run(["report", "--pictures", "0"], folder) == 1
    assert "fields.vtkhdf is damaged: " in (folder / "report.html").read_text()
