"""Starts a scenario's run, or resumes it, as its entry in the registry says."""

from pathlib import Path

from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios import runner
from taichi_ldem.scenarios.drawing import Draw
from taichi_ldem.scenarios.registry import Scenario, entry_of, resumable
from taichi_ldem.scenarios.runner import Summary
from taichi_ldem.scene import Scene
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.provenance import WITHOUT_EFFECT, unequal


def run(
    entry: Scenario,
    scene: Scene,
    out: Path,
    *,
    force: bool = False,
    quiet: bool = False,
    draw: Draw | None = None,
) -> int:
    """Run a scene into a folder as a scenario does.

    Args:
        force: replace the run that the folder holds.
        quiet: print nothing on success.
        draw: draws figures and pictures at the end; None: no figures.

    Returns:
        the exit code, see ``errors.ExitCode``.

    Raises:
        SceneError: the scene or the folder is refused; nothing has been written then.
    """
    module = entry.load()
    if hasattr(module, "run"):
        return int(module.run(scene, out, force=force, quiet=quiet, draw=draw))
    return runner.run(scene, out, module.summary, force=force, quiet=quiet, draw=draw)


def go_on(
    entry: Scenario, scene: Scene, out: Path, *, quiet: bool = False, draw: Draw | None = None
) -> int:
    """Start a scene's run, or go on with it where a run of the same scene is in the folder.

    A run without a checkpoint is started anew; one that has finished is left as it is. Arguments
    and exit codes are those of ``run``.

    Raises:
        SceneError: the folder holds something else, or checkpoints of which none can be used.
    """
    folder = RunFolder(out)
    if not folder.begun:
        return run(entry, scene, out, quiet=quiet, draw=draw)
    if folder.scene_file.is_file():
        for key, mine, theirs in unequal(scene, folder.read_scene(), WITHOUT_EFFECT):
            raise SceneError(
                f"--resume: '{out}' holds a run of another scene: {key} = {theirs} there, {mine} "
                "here; give another folder with --out"
            )
    if folder.can_go_on:
        return runner.resume(out, summary_of(entry), scene=scene, quiet=quiet, draw=draw)
    return run(entry, scene, out, force=True, quiet=quiet, draw=draw)


def summary_of(entry: Scenario) -> Summary:
    """The function that computes the summary of a run which can be resumed.

    Raises:
        SceneError: runs of this scenario take no checkpoints.
    """
    if not entry.resumable:
        known = ", ".join(resumable())
        raise SceneError(f'scenario = "{entry.command}": cannot be resumed, only {known} can')
    summary: Summary = entry.load().summary
    return summary


def resume(out: Path, *, extend: float = 0.0, quiet: bool = False, draw: Draw | None = None) -> int:
    """Resume the run in a folder; arguments, exit codes and errors are ``runner.resume``'s.

    Raises:
        SceneError: also where the folder holds no run, or one that cannot be resumed.
    """
    folder = RunFolder(out)
    if not folder.scene_file.exists():
        raise SceneError(f"'{out}' is no run folder: it has no scene.toml")
    summary = summary_of(entry_of(folder.read_scene()))
    return runner.resume(out, summary, extend=extend, quiet=quiet, draw=draw)
