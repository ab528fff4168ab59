"""Many runs one after the other: the memory of a process that makes them must not grow.

Two dozen scenes that differ in the striker's speed run in one process and then in a pool, each in
a folder of its own. The resident memory after each run is printed:

    python -m studies.many SCENE.toml outputs/many --count 24 --workers 2
"""

import multiprocessing
import os
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from functools import partial
from pathlib import Path

SETTLED = 4
"""Runs after which a process has imported and compiled what it needs."""


def resident_bytes() -> int:
    """Resident memory of this process now (Linux), bytes."""
    import resource

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize()


def one(scene: Path, out: Path, settings: Sequence[str], number: int) -> tuple[int, int, int]:
    """Run a scene with a striker a little faster for each number; process, memory, exit code."""
    from taichi_ldem.cli import main

    speed = f"striker.velocity={2.0 + 0.25 * number}"
    words = [word for text in (*settings, speed) for word in ("--set", text)]
    code = main(["impact", str(scene), "--out", str(out / f"{number}"), "--quiet", *words])
    return os.getpid(), resident_bytes(), code


def growth(records: Sequence[tuple[int, int, int]]) -> dict[int, list[int]]:
    """Memory after each run by process, bytes.

    Raises:
        RuntimeError: a run failed.
    """
    memory: dict[int, list[int]] = {}
    for process, size, code in records:
        if code:
            raise RuntimeError(f"a run ended with exit code {code}")
        memory.setdefault(process, []).append(size)
    return memory


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its numbers."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], dest="settings")
    given = parser.parse_args(arguments)
    # spawned: a fork would take Taichi's threads along without their stacks
    context = multiprocessing.get_context("spawn")
    for name, workers in (("one process", 1), ("pool", given.workers)):
        task = partial(one, given.scene, given.out / name.replace(" ", "-"), given.settings)
        with context.Pool(workers) as pool:
            records = pool.map(task, range(given.count), chunksize=1)
        for process, sizes in growth(records).items():
            sizes_in_mb = ", ".join(f"{size / 1e6:.0f}" for size in sizes)
            print(f"{name}, process {process}: {sizes_in_mb} MB", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
