"""The commands that run a scene: one for each scenario of the registry, and `resume`."""

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from taichi_ldem.cli.options import (
    Arch,
    Figures,
    Folder,
    Force,
    Out,
    Precision,
    Quiet,
    Resume,
    SceneFile,
    Settings,
    Threads,
    read_scene,
    read_scene_to_run,
)
from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.registry import SCENARIOS, Option, Scenario

OPTIONS: dict[str, tuple[Any, Any]] = {
    "out": (Out, None),
    "force": (Force, False),
    "resume": (Resume, False),
    "arch": (Arch, None),
    "precision": (Precision, None),
    "threads": (Threads, None),
    "settings": (Settings, None),
    "quiet": (Quiet, False),
    "figures": (Figures, True),
}
"""Type and default of the options that the commands of all scenarios share."""

SOLVER = ("arch", "precision", "threads")
"""Those of them that set a key of the scene's table [solver]."""

ONLY_IN_TIME = ("arch", "precision")
"""Options without a meaning for a scenario that does not step in time."""

ONLY_RESUMABLE = ("resume",)
"""Options without a meaning for a scenario whose runs take no checkpoints."""


def register(app: typer.Typer) -> None:
    """Add the commands to an app."""
    for entry in SCENARIOS.values():
        app.command(entry.command)(make_command(entry))
    app.command()(resume)


def make_command(entry: Scenario) -> Callable[..., None]:
    """The command of a scenario, with the shared options and its own."""

    def command(scene_file: Path, **given: Any) -> None:
        run(entry, scene_file, given)

    own = {option.name: _type_of(option) for option in entry.options}
    shared = {
        name: option
        for name, option in OPTIONS.items()
        if (entry.in_time or name not in ONLY_IN_TIME)
        and (entry.resumable or name not in ONLY_RESUMABLE)
    }
    kind = inspect.Parameter.KEYWORD_ONLY
    scene = inspect.Parameter("scene_file", kind, annotation=SceneFile)
    options = [
        inspect.Parameter(name, kind, default=default, annotation=annotation)
        for name, (annotation, default) in {**shared, **own}.items()
    ]
    command.__signature__ = inspect.Signature([scene, *options])  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in (scene, *options)}
    command.__name__ = entry.command
    command.__doc__ = f"{entry.help}. Options override --set, which overrides the file."
    return command


def _type_of(option: Option) -> tuple[Any, Any]:
    """Type and default of a scenario's own option."""
    if option.key:
        return Annotated[int | None, typer.Option(help=option.help)], None
    return Annotated[bool, typer.Option(f"--{option.name}", help=option.help)], False


def run(entry: Scenario, scene_file: Path, given: dict[str, Any]) -> None:
    """Run a scene as a scenario does, unless the scene or the run folder is refused."""
    keys: dict[str, object] = {f"solver.{name}": given.get(name) for name in SOLVER}
    keys |= {option.key: given[option.name] for option in entry.options if option.key}
    settings, out = given["settings"] or (), given["out"]
    if entry.in_time:
        scene = read_scene_to_run(scene_file, settings, keys)
        _refuse_other_scenario(entry, scene.scenario, scene_file)
    else:
        scene = read_scene(scene_file, settings, keys)
    for option in entry.options:
        if option.runs and given[option.name]:
            module, _, function = option.runs.partition(":")
            instead = getattr(import_module(module), function)
            raise typer.Exit(instead(scene, out, scene_file.stem, quiet=given["quiet"]))
    folder = Path("outputs", scene_file.stem) if out is None else out

    _check_folder(entry, scene_file, folder, given)

    from taichi_ldem.api import draw_run
    from taichi_ldem.scenarios import launch

    how = {"quiet": given["quiet"], "draw": draw_run if given["figures"] else None}
    if given.get("resume"):
        raise typer.Exit(launch.go_on(entry, scene, folder, **how))
    raise typer.Exit(launch.run(entry, scene, folder, force=given["force"], **how))


def _check_folder(entry: Scenario, scene_file: Path, folder: Path, given: dict[str, Any]) -> None:
    """Refuse a folder before anything heavy is imported."""
    from taichi_ldem.storage.folder import RunFolder

    resume, force = given.get("resume"), given["force"]
    if resume and force:
        raise SceneError("--resume and --force exclude each other: one goes on, one starts anew")
    found = RunFolder(folder)
    if resume and found.can_go_on:
        return  # nothing is replaced
    again = force or bool(resume and found.begun)
    RunFolder.check(folder, force=again, files=entry.writes, source=scene_file)


def _refuse_other_scenario(entry: Scenario, scenario: str, scene_file: Path) -> None:
    if scenario != entry.command:
        raise SceneError(
            f'{scene_file.name}: scenario = "{scenario}": run it with `ldem {scenario}`'
        )


def resume(
    folder: Folder,
    extend: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="run on past the end, seconds of simulation"),
    ] = 0.0,
    quiet: Quiet = False,
    figures: Figures = True,
) -> None:
    """Go on with a run that was cut off, from its last checkpoint."""
    from taichi_ldem.api import draw_run
    from taichi_ldem.scenarios import launch

    draw = draw_run if figures else None
    raise typer.Exit(launch.resume(folder, extend=extend, quiet=quiet, draw=draw))
