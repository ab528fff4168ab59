"""The harness that cuts runs off, tried on programs that are honest, and on some that are not."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from studies import kills

HONEST = """
import os, signal, sys, time

words = sys.argv[1:]
out = words[words.index("--out") + 1]
for number, code in ((signal.SIGTERM, 143), (signal.SIGHUP, 129)):
    signal.signal(number, lambda *_, code=code: os._exit(code))
os.makedirs(out, exist_ok=True)
folder = os.path.abspath(out)
os.chdir(out)  # goes on here, whatever the folder is called
fresh = "--force" in words or not os.path.exists("history.csv")
rows = [] if fresh else open("history.csv").read().split()
for number in range(len(rows), 120):
    with open(WHERE, "a" if number else "w") as history:
        history.write(f"{NUMBER}\\n")
    if "--quiet" not in words:
        try:
            print(number, flush=True)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    time.sleep(0.003)
"""
SOUND = HONEST.replace("WHERE", "'history.csv'").replace("NUMBER", "number")


def _differences(one: Path, two: Path) -> list[str]:
    same = (one / "history.csv").read_bytes() == (two / "history.csv").read_bytes()
    return [] if same else ["history.csv"]


def _tally(
    program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **counts: int
) -> kills.Tally:
    monkeypatch.setattr(kills, "differences", _differences)
    monkeypatch.setattr(kills, "_reached", lambda folder: 0.0)
    killer = kills.Killer(tmp_path / "scene.toml", tmp_path, ["solver.threads=1"], seed=0)
    file = tmp_path / "program.py"
    file.write_text(program)
    killer.command = [sys.executable, "-S", "-E", str(file)]
    killer.rng = SimpleNamespace(  # type: ignore[assignment]
        random=lambda: 1.0, uniform=lambda low, high: 0.02, shuffle=lambda kinds: None
    )
    names = {"kill": kills.KILL, "term": kills.TERM, "hang_up": kills.HANG_UP}
    names |= {"pipe": kills.PIPE, "rename": kills.RENAME}
    return killer.run({names[name]: count for name, count in counts.items()})


def test_a_run_that_keeps_what_it_has_passes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tally = _tally(SOUND, tmp_path, monkeypatch, kill=2, term=1, hang_up=1, pipe=1, rename=1)
    assert tally.differences == []
    assert tally.runs >= 1
    codes = {kind: code for kind, _, code in tally.signals}
    assert codes == {
        "SIGKILL": -9,
        "SIGTERM": 143,
        "SIGHUP": 129,
        "broken pipe": 143,
        "rename": 143,
    }
    assert all(0 < seconds < 5 for seconds in tally.resumes)


@pytest.mark.parametrize(
    ("where", "number", "counts", "fault"),
    [
        # the rows after a restart are others
        ("'history.csv'", "number if not rows else -number", {"kill": 1}, "history.csv"),
        # it looks its folder up again by its name, where another run's is by now
        (
            "os.path.join(folder, 'history.csv')",
            "number",
            {"rename": 1},
            "written into another run's folder: ",
        ),
    ],
    ids=["other rows", "other folder"],
)
def test_a_run_that_does_not_is_found_out(
    where: str,
    number: str,
    counts: dict[str, int],
    fault: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    program = HONEST.replace("WHERE", where).replace("NUMBER", number)
    tally = _tally(program, tmp_path, monkeypatch, **counts)
    assert any(line.startswith(fault) for line in tally.differences)


def test_an_exit_code_that_is_not_the_signals_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = SOUND.replace("143", "3")
    tally = _tally(program, tmp_path, monkeypatch, term=1)
    assert any(
        line.startswith("SIGTERM, impact ") and "code 3" in line for line in tally.differences
    )


def test_the_command_fails_where_anything_differs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    found = kills.Tally(signals=[("SIGKILL", 1e-3, -9)], resumes=[2.0], runs=1)
    monkeypatch.setattr(kills.Killer, "run", lambda self, counts: found)
    words = [str(tmp_path / "scene.toml"), str(tmp_path)]
    assert kills.main(words) == 0
    assert "1 signals, 1 runs compared" in capsys.readouterr().out
    found.differences.append("history.csv")
    assert kills.main(words) == 1
    assert '["history.csv"]' in capsys.readouterr().out
    found.differences, found.runs = [], 0  # nothing was compared, so nothing was shown
    assert kills.main(words) == 1
