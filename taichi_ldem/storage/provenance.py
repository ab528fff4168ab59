"""Where a result comes from: the scene's hash, versions, source, machine and command line."""

from __future__ import annotations

import functools
import hashlib
import json
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from taichi_ldem import __version__
from taichi_ldem.machine import processor_name
from taichi_ldem.scene import Scene

PACKAGES = ("taichi", "numpy", "scipy", "h5py", "pydantic")

WITHOUT_EFFECT = ("solver.threads", "output.checkpoint_interval")
"""Keys of a scene that change no result, and so are not in its hash."""


def canonical(scene: Scene) -> dict[str, Any]:
    """All keys of a scene, defaults included, as ``{"section.key": value}`` without nesting."""
    flat: dict[str, Any] = {}
    for name, value in scene.model_dump(mode="json", by_alias=True, exclude_none=True).items():
        if isinstance(value, dict):
            flat |= {f"{name}.{key}": item for key, item in value.items()}
        else:
            flat[name] = value
    if "plate.file_sha256" in flat:  # a file is known by its contents, wherever it lies
        flat = {key: value for key, value in flat.items() if key not in ("plate.mask", "plate.stl")}
    return {key: _positive_zero(flat[key]) for key in sorted(flat)}


def _positive_zero(value: Any) -> Any:
    """The same value without negative zeros, which are equal to zero and written otherwise."""
    if isinstance(value, dict):
        return {key: _positive_zero(item) for key, item in sorted(value.items())}
    if isinstance(value, list):
        return [_positive_zero(item) for item in value]
    return value + 0.0 if isinstance(value, float) else value


def scene_hash(scene: Scene) -> str:
    """SHA-256 of a scene's canonical form: equal for scenes that give the same results."""
    effective = {key: value for key, value in canonical(scene).items() if key not in WITHOUT_EFFECT}
    text = json.dumps(effective, separators=(",", ":"), sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def unequal(one: Scene, other: Scene, but: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Keys in which two scenes differ, with both values as text; some keys are left out."""
    mine, theirs = canonical(one), canonical(other)
    for key in sorted((mine.keys() | theirs.keys()) - set(but)):
        if mine.get(key) != theirs.get(key):
            yield key, _show(mine.get(key)), _show(theirs.get(key))


def _show(value: Any) -> str:
    return "absent" if value is None else json.dumps(value)[:64]


def provenance(scene: Scene) -> dict[str, Any]:
    """Facts that identify a run in its files; git's state only where this is a checkout."""
    return {
        "scene_sha256": scene_hash(scene),
        "version": __version__,
        "git": _git(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
        "platform": platform.platform(),
        "cpu": processor_name(),
        "command": shlex.join(sys.argv).encode(errors="backslashreplace").decode(),
    }


def changed_machine(then: Any, now: dict[str, Any]) -> str | None:
    """Differences from a run's record in what results depend on to the last bit; None without any.

    Args:
        then: record of an earlier process of the run; anything, as it comes from a file.
    """
    if not isinstance(then, dict):
        return None
    packages = then.get("packages")
    taichi = packages.get("taichi") if isinstance(packages, dict) else None
    was = {"CPU": then.get("cpu"), "taichi": taichi}
    here = {"CPU": now["cpu"], "taichi": now["packages"]["taichi"]}
    changed = [key for key in was if was[key] != here[key]]
    other = [f"{key} {was[key] or 'unknown'}, now {here[key]}" for key in changed]
    return "; ".join(other) or None


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


@functools.cache
def _git() -> str | None:
    """Commit of the source, with "+changes" where files differ from it."""
    here = Path(__file__).resolve().parents[1]

    def ask(*words: str) -> str:
        command = ["git", "-C", str(here), *words]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
        return done.stdout.strip()

    try:
        # a package that is installed below somebody else's repository is not part of it
        ask("ls-files", "--error-unmatch", "storage/provenance.py")
        changed = ask("status", "--porcelain", "--untracked-files=no", "--", ".")
        return ask("rev-parse", "HEAD") + ("+changes" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None
