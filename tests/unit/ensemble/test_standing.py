"""One process that makes the attempts of a worker: it is reused, replaced, and may be killed."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from taichi_ldem.ensemble import standing
from taichi_ldem.ensemble.standing import OTHER, Standing

SERVER = f"""
import json, os, sys
served = 0
for line in sys.stdin:
    order = json.loads(line)
    with open(order["out"], "a") as file:
        print(os.getpid(), *order["arguments"], file=file)
    deed = order["arguments"][0]
    if deed == "die":
        os.kill(os.getpid(), 9)
    if deed == "hang":
        import time
        time.sleep(60)
    if deed == "leave":
        sys.exit(0)
    if deed == "signalled":
        import time
        print(143, flush=True)
        time.sleep(0.2)
        sys.exit(0)
    if deed == "other" and served > 0:
        print("{OTHER}", flush=True)
        break
    served += 1
    print(3 if deed == "three" else 0, flush=True)
"""
"""A server without ``ldem``: it does what the first argument says."""


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Standing]:
    script = tmp_path / "server.py"
    script.write_text(SERVER)
    monkeypatch.setattr(standing, "SERVER", (sys.executable, "-I", "-S", str(script)))
    made = Standing()
    yield made
    made.close()


def _order(worker: Standing, tmp_path: Path, *arguments: str) -> int:
    return worker.order(arguments, tmp_path / "out", tmp_path / "err").wait(20)


def _processes(tmp_path: Path) -> list[str]:
    return [line.split()[0] for line in (tmp_path / "out").read_text().splitlines()]


def test_one_process_executes_order_after_order(worker: Standing, tmp_path: Path) -> None:
    assert [_order(worker, tmp_path, deed) for deed in ("one", "three", "two")] == [0, 3, 0]
    assert len(set(_processes(tmp_path))) == 1


def test_a_member_that_needs_other_kernels_gets_a_new_process(
    worker: Standing, tmp_path: Path
) -> None:
    assert _order(worker, tmp_path, "one") == 0
    assert _order(worker, tmp_path, "other") == 0
    first, refused, again = _processes(tmp_path)
    assert first == refused != again


def test_a_killed_process_takes_only_its_own_order_with_it(
    worker: Standing, tmp_path: Path
) -> None:
    assert _order(worker, tmp_path, "die") == -signal.SIGKILL
    assert _order(worker, tmp_path, "one") == 0
    assert len(set(_processes(tmp_path))) == 2


def test_an_order_that_takes_too_long_can_be_ended(worker: Standing, tmp_path: Path) -> None:
    ordered = worker.order(["hang"], tmp_path / "out", tmp_path / "err")
    with pytest.raises(subprocess.TimeoutExpired):
        ordered.wait(0.05)
    os.killpg(ordered.pid, signal.SIGKILL)
    assert ordered.wait(20) == ordered.returncode == -signal.SIGKILL


def test_ldem_itself_executes_orders(tmp_path: Path) -> None:
    """Exit codes and what is printed are those of the command: without a run, to be quick."""
    worker = Standing()
    out, err = tmp_path / "out", tmp_path / "err"
    assert worker.order(["--help"], out, err).wait(30) == 0
    assert "Usage" in out.read_text()
    assert worker.order(["impact", "absent.toml"], out, err).wait(30) == 2
    assert err.read_text().startswith("error: ")
    worker.close()


def test_a_signalled_process_is_not_given_the_next_order(worker: Standing, tmp_path: Path) -> None:
    """It answers 143 and is about to end: the next order goes to another one."""
    assert _order(worker, tmp_path, "signalled") == 143
    assert _order(worker, tmp_path, "one") == 0
    assert len(set(_processes(tmp_path))) == 2


def test_a_process_that_ends_without_an_answer_has_failed(worker: Standing, tmp_path: Path) -> None:
    assert _order(worker, tmp_path, "leave") == 1
    assert _order(worker, tmp_path, "one") == 0
