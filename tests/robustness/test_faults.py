"""Faults of the machine while a run goes on: one line, an exit code, and what was kept."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from support.command import COMMAND, SCENE, WITHOUT_VULKAN, ldem

from taichi_ldem.storage import checkpoint as cp
from taichi_ldem.storage.compare import differences
from taichi_ldem.storage.fields import read_broken_bars, read_times
from taichi_ldem.storage.folder import RunFolder

UNWRITABLE = 4


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "small.toml"
    file.write_text(SCENE.replace("8e-5", "4e-5") + "checkpoint_interval = 1e-3\n")
    return file


def _start(
    scene: Path,
    out: Path,
    *words: str,
    before: Callable[[], None] | None = None,
    prefix: Sequence[str] = (),
) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*prefix, *COMMAND, "impact", str(scene), "--out", str(out), "--quiet", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=WITHOUT_VULKAN,
        preexec_fn=before,
    )


def _wait_for_rows(out: Path, rows: int) -> None:
    history, deadline = out / "history.csv", time.monotonic() + 300
    while time.monotonic() < deadline:
        if history.exists() and history.read_bytes().count(b"\n") > rows:
            return
        time.sleep(0.002)
    raise AssertionError("the run never began")


def _one_line(errors: str) -> str:
    (line,) = errors.splitlines()
    return line


def _limit(size: int) -> Callable[[], None]:
    def limit() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return limit


def test_a_disk_that_fills_up(scene: Path, tmp_path: Path) -> None:
    """A limit on a file's size is the disk full that needs no disk: EFBIG instead of ENOSPC."""
    out = tmp_path / "run"
    process = _start(scene, out, before=_limit(400_000))  # the fields grow beyond it
    _, errors = process.communicate(timeout=300)
    assert process.returncode == UNWRITABLE
    line = _one_line(errors)
    assert "File too large" in line
    assert f"{out}/" in line
    folder = RunFolder.open(out)
    assert not (out / "summary.json").exists()
    assert not list(out.glob("*.tmp"))
    folder.read_history()
    if (out / "fields.vtkhdf").exists():
        read_times(out / "fields.vtkhdf")


@pytest.mark.slow
def test_a_full_disk_stops_the_run_and_its_checkpoint_stands(scene: Path, tmp_path: Path) -> None:
    code = """
import errno, sys
from taichi_ldem.storage import durable
from taichi_ldem.cli import main
write, left = durable._write_all, [int(sys.argv.pop(1))]
def full(file, content, at):
    left[0] -= len(content)
    if left[0] < 0:
        write(file, content[:len(content) // 2], at)
        raise OSError(errno.ENOSPC, "No space left on device")
    write(file, content, at)
durable._write_all = full
sys.exit(main(sys.argv[1:]))
"""
    out = tmp_path / "run"
    words = ["impact", str(scene), "--out", str(out), "--quiet"]
    command = [sys.executable, "-c", code, "4000000", *words]
    done = subprocess.run(command, capture_output=True, text=True, env=WITHOUT_VULKAN)
    assert done.returncode == UNWRITABLE, done.stderr
    line = _one_line(done.stderr)
    assert "No space left on device" in line
    assert line.endswith("goes on from the last checkpoint")
    cp.decode((out / cp.LATEST).read_bytes())
    assert not list(out.glob("*.tmp"))
    done = ldem("resume", str(out), "--quiet")
    assert done.returncode == 0, done.stderr
    end = RunFolder.open(out).read_history()["time_s"][-1]
    assert end == pytest.approx(4e-5, rel=1e-3)


def test_a_folder_that_vanishes(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = _start(scene, out, "--set", "solver.duration=1e-2")
    _wait_for_rows(out, 3)
    # like `rm -rf`, which a run that goes on writing may fill again meanwhile
    while out.exists():
        shutil.rmtree(out, ignore_errors=True)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == UNWRITABLE
    line = _one_line(errors)
    assert "No such file or directory" in line
    assert "no checkpoint to go on from" in line
    assert not out.exists()


@pytest.mark.slow
def test_a_folder_that_becomes_read_only(scene: Path, tmp_path: Path) -> None:
    without: list[str] = []
    if os.geteuid() == 0:  # root writes where it must not, unless it gives that up
        if shutil.which("setpriv") is None:
            pytest.skip("root, and no setpriv")
        without = ["setpriv", "--bounding-set=-dac_override"]
    out = tmp_path / "run"
    process = _start(scene, out, "--set", "solver.duration=1e-2", prefix=without)
    _wait_for_rows(out, 3)
    out.chmod(0o500)
    _, errors = process.communicate(timeout=300)
    out.chmod(0o700)
    assert process.returncode == UNWRITABLE
    assert "Permission denied" in _one_line(errors)
    cp.decode((out / cp.LATEST).read_bytes())


def test_a_second_process_and_a_stale_lock(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = _start(scene, out, "--set", "solver.duration=1e-2")
    _wait_for_rows(out, 3)
    try:
        for words in (("impact", str(scene), "--out", str(out), "--force"), ("resume", str(out))):
            done = ldem(*words)
            assert done.returncode == 2
            assert f"is in use by process {process.pid} on" in _one_line(done.stderr)
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert (out / "run.lock").exists()
    text = (out / "scene.toml").read_text()
    (out / "scene.toml").write_text(text.replace("duration = 0.01", "duration = 4e-5"))
    done = ldem("resume", str(out), "--quiet")
    # done, or refused because the checkpoint lies behind the new end: but not locked
    assert "in use" not in done.stderr
    assert done.returncode in (0, 2)


def test_a_lattice_larger_than_memory_is_refused_before_anything_is_taken(scene: Path) -> None:
    def limit() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))

    out = scene.parent / "large"
    large = (
        "--set",
        "plate.size=[0.2, 0.2, 0.0192]",
        "--set",
        "plate.modules_through_thickness=36",
    )
    process = _start(scene, out, *large, before=limit)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    line = _one_line(errors)
    assert "375 x 375 x 36 modules need about " in line
    assert " bytes of memory" in line
    assert "take fewer modules" in line
    assert not out.exists()


@pytest.mark.slow
def test_a_run_whose_contact_never_happens_says_so(scene: Path, tmp_path: Path) -> None:
    far = ("--set", "striker.gap=0.01", "--set", "solver.duration=5e-6")
    settings = ("--set", "output.field_interval=0")
    done = ldem("impact", str(scene), "--out", str(tmp_path / "far"), "--quiet", *far, *settings)
    assert done.returncode == 0
    reason = "it has come 4e-05 m of striker.gap = 0.01"
    assert f"warning: the striker never touched the plate: {reason}" in done.stderr


@pytest.mark.slow
def test_nobody_reads_what_a_run_prints(scene: Path, tmp_path: Path) -> None:
    """`ldem impact ... 2>&1 | head -3`: exit code 1 and no checkpoint before."""
    out = tmp_path / "run"
    words = ["impact", str(scene), "--out", str(out), "--set", "solver.duration=1e-5"]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    process = subprocess.Popen([*COMMAND, *words], env=WITHOUT_VULKAN, **streams)  # type: ignore
    assert process.stdout is not None
    for _ in range(3):
        process.stdout.readline()
    process.stdout.close()
    assert process.wait(300) == 0
    assert (out / "checkpoint.h5").is_file()
    assert (out / "summary.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("ignored", [False, True], ids=["hang_up", "nohup"])
def test_a_terminal_that_closes(scene: Path, tmp_path: Path, ignored: bool) -> None:
    import pty

    out = tmp_path / "run"
    words = ["impact", str(scene), "--out", str(out)]
    words += ["--set", "solver.duration=2e-5"] if ignored else ["--set", "solver.duration=1e-2"]
    process, terminal = pty.fork()
    if not process:
        signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else signal.SIG_DFL)
        os.execve(sys.executable, [*COMMAND, *words], WITHOUT_VULKAN)
    _wait_for_rows(out, 3)
    os.close(terminal)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    assert code == (0 if ignored else 129)
    assert (out / "checkpoint.h5").is_file()
    assert (out / "summary.json").is_file() == ignored


@pytest.mark.slow
def test_a_run_whose_folder_is_renamed_and_its_successor(scene: Path, tmp_path: Path) -> None:
    """The first run wrote its checkpoints, fields and broken bars into the second's folder."""
    out, moved, whole = (tmp_path / name for name in ("run", "moved", "whole"))
    assert _start(scene, whole).wait(300) == 0
    first = _start(scene, out)
    _wait_for_rows(out, 3)
    out.rename(moved)
    second = _start(scene, out, "--set", "striker.velocity=6.0")
    _, said = first.communicate(timeout=300)
    assert first.returncode == second.wait(300) == 0
    assert f"'{out}' is another folder now: this run is in '{moved}'" in said
    assert differences(whole, moved) == []
    bars = RunFolder.open(out).read_history()["broken_bars"][-1]
    assert len(read_broken_bars(out / "fields.vtkhdf").bar) == bars
    at = cp.decode((out / cp.LATEST).read_bytes())
    assert at.scene.striker is not None
    assert at.scene.striker.velocity == 6.0
