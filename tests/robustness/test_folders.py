"""Damaged folders: every reading command ends with one line, without a traceback and a hang."""

import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from support.members import SCENE
from support.mutations import damage
from support.paths import ROOT
from support.synthetic import synthetic_run

from taichi_ldem.cli import main
from taichi_ldem.ensemble.attempt import FINISHED, Outcome, write_outcome
from taichi_ldem.ensemble.plan import ATTEMPTS, MEMBERS, make_plan, write_plan
from taichi_ldem.ensemble.report import report as report_ensemble
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
    """A reproduction of two items, all of whose runs have finished."""
    make_run(path / "runs" / "impact")
    make_ensemble(path / "runs" / "ensemble")
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
        ["plot"],
        ["report"],
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
    monkeypatch.setattr(runner, "_build", accepted)
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
@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("count", [3, pytest.param(2000, marks=pytest.mark.slow)])
def test_damaged_folders(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, count: int
) -> None:
    folder = tmp_path / kind
    shutil.copytree(whole / kind, folder)
    for words in COMMANDS[kind]:
        assert verify(words, folder, capsys) in (0, None)
    suffixes = (".json", ".csv", ".toml", ".vtkhdf", ".h5", ".md")
    files = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.suffix in suffixes)
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
