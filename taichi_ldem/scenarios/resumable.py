"""The scenarios that ``ldem resume`` goes on with, and how each sums up its run."""

from functools import partial
from pathlib import Path

from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios import bend, impact, runner, tension
from taichi_ldem.scenarios.runner import Summary
from taichi_ldem.scene import load_scene
from taichi_ldem.storage.store import RunFolder


def summary_of(scenario: str, folder: RunFolder) -> Summary:
    """The summary that a scenario's ``run`` gives to ``runner.run``.

    Raises:
        SceneError: a scenario whose runs take no checkpoints.
    """
    known: dict[str, Summary] = {
        "impact": partial(impact.summary, folder),
        "tension": tension.summary,
        "bend": bend.summary,
    }
    if scenario not in known:
        raise SceneError(f'scenario = "{scenario}": cannot be resumed, only {", ".join(known)} can')
    return known[scenario]


def resume(out: Path, *, extend: float = 0.0, quiet: bool = False) -> int:
    """Go on with the run in a folder; arguments, exit codes and errors are ``runner.resume``'s."""
    folder = RunFolder(out)
    if not folder.scene_file.is_file():
        raise SceneError(f"'{out}' is no run folder: it has no scene.toml")
    summary = summary_of(load_scene(folder.scene_file).scenario, folder)
    return runner.resume(out, summary, extend=extend, quiet=quiet)
