"""Runs the strips of a toughness study, each group in a process, and reports on all that is there.

A strip that has been run is not run again, so the study can be cut and goes on where it was.
"""

import contextlib
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene, scene_to_toml
from taichi_ldem.studies.toughness.plan import Strip, strips
from taichi_ldem.studies.toughness.report import report
from taichi_ldem.studies.toughness.strip import Reading

QUICK = ((0.0, 45.0), (), 1)
"""Angles, refinements and seeds of the quick form."""


def run(
    base: Scene,
    out: Path,
    *,
    angles: Sequence[float] = (),
    refinements: Sequence[float] | None = None,
    seeds: int = 3,
    quick: bool = False,
    workers: int = 0,
) -> int:
    """Run what is missing and write ``toughness.md``, ``toughness.csv`` and figures.

    Args:
        base: scene of a strip; its table [[notch]] is the crack's plane.
        angles, refinements, seeds: those of ``plan.strips``.
        quick: two angles, one strip each, the scene's modules.
        workers: processes at a time, which share the cores; 0: as many as there are cores.

    Returns:
        the exit code: that of a strip that failed, if one did.

    Raises:
        SceneError: the scene is no strip, or the folder holds the strips of another one.
    """
    wanted = _wanted(base, angles, refinements, seeds, quick)
    _claim(out, base)
    groups: dict[str, list[Strip]] = defaultdict(list)
    for strip in wanted:
        groups[strip.group].append(strip)
    results = out / "strips.jsonl"
    started = time.monotonic()
    cores = os.cpu_count() or 1
    processes = max(1, min(workers or cores, len(groups)))
    run_group = partial(_run, base=base, threads=max(1, cores // processes), results=results)
    with ThreadPoolExecutor(processes) as pool:
        codes = list(pool.map(run_group, groups.values()))
    found = {Strip.named(name): reading for name, reading in _read(results).items()}
    report(base, found, out)
    done = sum(strip in found for strip in wanted)
    print(f"{done} of {len(wanted)} strips, {time.monotonic() - started:.0f} s; see {out}")
    return max(codes, default=0)


def _claim(out: Path, base: Scene) -> None:
    """Make the folder and keep the scene there."""
    kept, text = out / "scene.toml", scene_to_toml(base)
    if kept.exists() and kept.read_text(encoding="utf-8") != text:
        raise SceneError(f"--out {out}: holds the strips of another scene; name another folder")
    out.mkdir(parents=True, exist_ok=True)
    kept.write_text(text, encoding="utf-8")


def _wanted(
    base: Scene,
    angles: Sequence[float],
    refinements: Sequence[float] | None,
    seeds: int,
    quick: bool,
) -> list[Strip]:
    if quick:
        return strips(base, *QUICK)
    options = {"angles": tuple(angles) or None, "refinements": refinements}
    given = {name: value for name, value in options.items() if value is not None}
    return strips(base, seeds=seeds, **given)


def _run(group: list[Strip], base: Scene, threads: int, results: Path) -> int:
    """Run the strips of a group that have no result; the exit code."""
    done = _read(results)
    files = []
    for strip in group:
        if strip.name in done:
            continue
        try:
            scene = strip.scene(base, threads)
        except SceneError as error:
            print(f"left out: {error}", flush=True)
            continue
        files.append(results.with_name(f"{strip.name}.toml"))
        files[-1].write_text(scene_to_toml(scene), encoding="utf-8")
    if not files:
        return 0
    command = [sys.executable, "-m", "taichi_ldem.studies.toughness.strip", str(results)]
    ended = subprocess.run([*command, *map(str, files)], capture_output=True, text=True)
    if ended.returncode:
        print(f"{group[0].group}: {ended.stderr.strip()[-500:]}", file=sys.stderr, flush=True)
        return ended.returncode
    print(group[0].group, flush=True)
    return 0


def _read(results: Path) -> dict[str, Reading]:
    """Results by the strip's name; a line that was cut off is none."""
    found = {}
    lines = results.read_text(encoding="utf-8").splitlines() if results.exists() else []
    for line in lines:
        with contextlib.suppress(json.JSONDecodeError):
            row = json.loads(line)
            name = row.pop("name")
            found[name] = Reading(**row)
    return found
