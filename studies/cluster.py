"""An ensemble on a Dask cluster one of whose two workers is killed in the middle.

A scheduler and two workers are started by hand, as processes of this machine; once both run a
member, one worker gets SIGKILL. Every member must finish, none may be run to its end twice, and
all results must be those of the same ensemble run without Dask, to the last bit:

    python -m studies.cluster SCENE.toml outputs/cluster --vary striker.velocity=4,5
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from pathlib import Path

from taichi_ldem.ensemble.attempt import FINISHED, RUNNING, Outcome, read_attempts
from taichi_ldem.ensemble.conduct import reached_time
from taichi_ldem.ensemble.plan import MEMBERS, Plan, read_plan
from taichi_ldem.storage.compare import differences

PATIENCE = 120.0
"""Limit on the seconds until the cluster, or both members, have started."""


@contextlib.contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and workers with one place each; its address and the workers."""
    contact_file = folder / "scheduler.json"
    contact_file.unlink(missing_ok=True)
    module = (sys.executable, "-m", "distributed.cli.dask_scheduler")
    words = (
        "--port",
        "0",
        "--host",
        "127.0.0.1",
        "--no-dashboard",
        "--scheduler-file",
        str(contact_file),
    )
    processes: list[subprocess.Popen[bytes]] = []
    with open(folder / "dask.log", "wb") as log:
        try:
            processes.append(subprocess.Popen([*module, *words], stdout=log, stderr=log))
            address = _address(contact_file)
            command = (sys.executable, "-m", "distributed.cli.dask_worker", address)
            place = ["--no-nanny", "--nthreads", "1", "--no-dashboard"]
            place += ["--host", "127.0.0.1", "--local-directory", str(folder)]
            for _ in range(workers):
                processes.append(subprocess.Popen([*command, *place], stdout=log, stderr=log))
            yield address, processes[1:]
        finally:
            for process in reversed(processes):
                process.terminate()
            for process in processes:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(10)
                process.kill()  # a worker without its scheduler may wait for ever
                process.wait()


def _address(file: Path) -> str:
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        with contextlib.suppress(OSError, ValueError, KeyError):
            return str(json.loads(file.read_text(encoding="utf-8"))["address"])
        time.sleep(0.1)
    raise RuntimeError("Dask's scheduler did not start")


def command(words: Sequence[str], out: Path) -> list[str]:
    """The ensemble's command."""
    return [sys.executable, "-m", "taichi_ldem.cli", "ensemble", *words, "--out", str(out)]


def kill_one(workers: Sequence[subprocess.Popen[bytes]], out: Path) -> str:
    """Wait until as many members step as there are workers, kill the first; its member's name."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        time.sleep(0.1)
        if not (out / "ensemble.toml").is_file():
            continue
        running = stepping(out, read_plan(out))
        if len(running) == len(workers):
            name = next(o.name for o in running if o.process == workers[0].pid)
            os.kill(workers[0].pid, signal.SIGKILL)
            return name
    raise RuntimeError("the members did not start")


def stepping(out: Path, plan: Plan) -> list[Outcome]:
    """Attempts that run and whose member has begun to step."""
    found = []
    for member in plan.members:
        attempts = read_attempts(out, member.name)
        history = out / MEMBERS / member.name / "history.csv"
        if attempts and attempts[-1].state == RUNNING and reached_time(history) > 0:
            found.append(attempts[-1])
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study, print its numbers; 1 where a member did not finish or anything differed."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene")
    parser.add_argument("out", type=Path)
    given, options = parser.parse_known_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    out, plain = given.out / "distributed", given.out / "local"
    with cluster(given.out, 2) as (address, workers):
        words = command([given.scene, *options, "--scheduler", address], out)
        conductor = subprocess.Popen(words)
        try:
            name = kill_one(workers, out)
            at = reached_time(out / MEMBERS / name / "history.csv")
            print(f"worker {workers[0].pid} killed; it ran {name}, at {1e3 * at:.4f} ms")
            code = conductor.wait()
        finally:
            conductor.kill()
            conductor.wait()
    code = code or subprocess.run(command([given.scene, *options], plain), check=False).returncode
    print(f"exit code {code}")
    plan = read_plan(out)
    found: list[str] = []
    for member in plan.members:
        attempts = read_attempts(out, member.name)
        for o in attempts:
            words = [f"attempt {o.number}", f"worker {o.process}", o.how, o.state, o.reason]
            print(f"{member.name}: " + ", ".join(word for word in words if word))
        ended = sum(o.state == FINISHED for o in attempts)
        if ended != 1:
            found.append(f"{member.name} was run {ended} times to its end")
        here, there = (folder / MEMBERS / member.name for folder in (out, plain))
        found += [f"{member.name}: {line}" for line in differences(here, there)]
    print("differences between Dask and local:", json.dumps(found) if found else "none")
    return 1 if code or found else 0


if __name__ == "__main__":
    sys.exit(main())
