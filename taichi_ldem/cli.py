"""The command line: a command a scenario, `resume`, `info`, `render`, `plot`. No physics.

Heavy modules are imported inside the commands, Taichi only once the scene and the run folder are
known to be good: help and refusals are quick.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_ldem.studies.commands import app as studies

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

# Typer's own copy of Click's class, or Click's: which of the two depends on Typer's version
UsageError: Any = typer.BadParameter.__mro__[1]

app = typer.Typer(
    help="Lattice discrete elements for brittle plates under impact.",
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(studies, name="study")

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE.toml", show_default=False)]
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="run folder", show_default=False)]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="SECTION.KEY=VALUE", help="override a key of the scene"),
]


Out = Annotated[
    Path | None, typer.Option(metavar="DIR", help="run folder (default: outputs/SCENE)")
]
Force = Annotated[bool, typer.Option("--force", help="overwrite the run in DIR")]
Arch = Annotated[str | None, typer.Option(help="cpu, cuda (or gpu) or vulkan")]
Precision = Annotated[str | None, typer.Option(help="f64 or f32")]
Threads = Annotated[int | None, typer.Option(help="CPU threads (default: all cores)")]
Quiet = Annotated[bool, typer.Option("--quiet", help="print nothing on success")]


@app.command()
def impact(
    scene_file: SceneFile,
    out: Out = None,
    force: Force = False,
    arch: Arch = None,
    precision: Precision = None,
    threads: Threads = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Run a falling-weight test; options override --set, which overrides the file."""
    options = {"arch": arch, "precision": precision, "threads": threads}
    scene, folder = _prepare("impact", scene_file, out, force, settings, options)

    from taichi_ldem.scenarios.impact import run

    raise typer.Exit(run(scene, folder, force=force, quiet=quiet))


@app.command()
def tension(
    scene_file: SceneFile,
    out: Out = None,
    force: Force = False,
    arch: Arch = None,
    precision: Precision = None,
    threads: Threads = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Pull a specimen apart; options as for impact."""
    options = {"arch": arch, "precision": precision, "threads": threads}
    scene, folder = _prepare("tension", scene_file, out, force, settings, options)

    from taichi_ldem.scenarios.tension import run

    raise typer.Exit(run(scene, folder, force=force, quiet=quiet))


@app.command()
def bend(
    scene_file: SceneFile,
    out: Out = None,
    force: Force = False,
    arch: Arch = None,
    precision: Precision = None,
    threads: Threads = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Run a notched three-point bending test; options as for impact."""
    options = {"arch": arch, "precision": precision, "threads": threads}
    scene, folder = _prepare("bend", scene_file, out, force, settings, options)

    from taichi_ldem.scenarios.bend import run

    raise typer.Exit(run(scene, folder, force=force, quiet=quiet))


@app.command()
def wave(
    scene_file: SceneFile,
    out: Out = None,
    force: Force = False,
    arch: Arch = None,
    precision: Precision = None,
    threads: Threads = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Send a pulse through a bar or a plate; options as for impact."""
    options = {"arch": arch, "precision": precision, "threads": threads}
    scene, folder = _prepare("wave", scene_file, out, force, settings, options)

    from taichi_ldem.scenarios.wave import run

    raise typer.Exit(run(scene, folder, force=force, quiet=quiet))


@app.command()
def modes(
    scene_file: SceneFile,
    count: Annotated[int | None, typer.Option(help="number of modes, from the lowest")] = None,
    out: Out = None,
    force: Force = False,
    threads: Threads = None,
    settings: Settings = None,
    quiet: Quiet = False,
) -> None:
    """Natural frequencies and shapes of any scene's lattice, without its striker and damage."""
    options = {"modes.count": count, "solver.threads": threads}
    given = [f"{key}={value}" for key, value in options.items() if value is not None]

    from taichi_ldem.scene import load_scene
    from taichi_ldem.store import RunFolder

    scene = load_scene(scene_file, [*(settings or ()), *given])
    folder = Path("outputs", scene_file.stem) if out is None else out
    RunFolder.check(folder, force=force)

    from taichi_ldem.scenarios.modes import run

    raise typer.Exit(run(scene, folder, force=force, quiet=quiet))


@app.command()
def resume(
    folder: Folder,
    extend: Annotated[
        float, typer.Option(metavar="SECONDS", help="run on past the end, seconds of simulation")
    ] = 0.0,
    quiet: Annotated[bool, typer.Option("--quiet", help="print nothing on success")] = False,
) -> None:
    """Go on with a run that was cut off, from its last checkpoint."""
    from taichi_ldem.scenarios.resumable import resume

    raise typer.Exit(resume(folder, extend=extend, quiet=quiet))


@app.command()
def ensemble(
    scene_file: SceneFile,
    cv: Annotated[
        str | None,
        typer.Option(metavar="CV,CV,...", help="of the fracture energy; 0: homogeneous specimen"),
    ] = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="FIRST:END", help="0:4 is 0 to 3; or 1,5,7")
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="SECTION.KEY=V1,V2,...", help="any other key of the scene"),
    ] = None,
    settings: Settings = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="default: outputs/SCENE_ensemble")
    ] = None,
    local: Annotated[
        int | None,
        typer.Option(min=1, help="members at a time here (default: cores / threads)"),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="run on a Dask cluster instead")
    ] = None,
    threads: Annotated[int, typer.Option(min=1, help="CPU threads of each member")] = 1,
    timeout: Annotated[
        float | None, typer.Option(min=1e-3, metavar="SECONDS", help="of one attempt at a member")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with the ensemble in DIR")
    ] = False,
    precision: Precision = None,
    quiet: Quiet = False,
) -> None:
    """Run a scene many times: seeds, variabilities and any keys, one process a run."""
    from taichi_ldem.ensemble import plan, run
    from taichi_ldem.material import check
    from taichi_ldem.scene import SceneError

    if local is not None and scheduler is not None:
        raise SceneError("--local and --scheduler exclude each other")
    given = [] if precision is None else [f"solver.precision={precision}"]
    given = [*(settings or ()), *given]
    members = plan.make_plan(scene_file, cv=cv, seeds=seeds, vary=vary or (), settings=given)
    for member in members.members:
        check(member.scene)
    folder = run.default_folder(scene_file) if out is None else out
    code = run.run(
        members,
        folder,
        resume=resume,
        local=local,
        scheduler=scheduler,
        threads=threads,
        timeout=timeout,
        quiet=quiet,
    )
    raise typer.Exit(code)


@app.command()
def info(
    scene_file: SceneFile,
    settings: Settings = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="time a step, too: takes a minute or more")
    ] = False,
) -> None:
    """Print what a scene implies, without running it."""
    scene = _load(scene_file, settings or ())

    from rich.console import Console

    from taichi_ldem.describe import describe

    Console().print(describe(scene, measure))


@app.command()
def render(
    folder: Folder,
    time: Annotated[
        list[float] | None,
        typer.Option(metavar="SECONDS", help="of a snapshot (default: image times and the end)"),
    ] = None,
) -> None:
    """Draw the snapshots of a run again."""
    from taichi_ldem.render import render_run
    from taichi_ldem.store import RunFolder

    _list(render_run(RunFolder.open(folder), time or None))


@app.command()
def plot(folder: Folder) -> None:
    """Draw the figures of a run again, or the figures and tables of an ensemble."""
    from taichi_ldem.ensemble.report import is_ensemble, report
    from taichi_ldem.plots import plot_run
    from taichi_ldem.store import RunFolder

    _list(report(folder) if is_ensemble(folder) else plot_run(RunFolder.open(folder)))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    0: done; 1: a file could not be read or written; 2: bad input; 3: stopped by the run-time
    guard; 4: a run could no longer write its files; 130: interrupted; 143: terminated. Errors are
    one line on stderr.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        # outside of its standalone mode Typer returns the code of typer.Exit
        return int(app(list(arguments) or ["--help"], "ldem", standalone_mode=False) or 0)
    except UsageError as error:
        return _complain(" ".join(error.format_message().split()), 2)
    except typer.Abort:
        return 130
    except OSError as error:
        return _complain(str(error), 1)
    except ValueError as error:
        from taichi_ldem.scene import SceneError

        if not isinstance(error, SceneError):
            raise
        return _complain(str(error), 2)


def _prepare(
    command: str,
    scene_file: Path,
    out: Path | None,
    force: bool,
    settings: Sequence[str] | None,
    options: dict[str, str | int | None],
) -> "tuple[Scene, Path]":
    """The scene and the run folder of a command that runs one, both known to be good."""
    given = [f"solver.{key}={value}" for key, value in options.items() if value is not None]
    scene = _load(scene_file, [*(settings or ()), *given])
    if scene.scenario != command:
        from taichi_ldem.scene import SceneError

        name = scene.scenario
        raise SceneError(f'{scene_file.name}: scenario = "{name}": run it with `ldem {name}`')
    folder = Path("outputs", scene_file.stem) if out is None else out

    from taichi_ldem.store import RunFolder

    RunFolder.check(folder, force=force)
    return scene, folder


def _load(path: Path, settings: Sequence[str]) -> "Scene":
    from taichi_ldem.material import check
    from taichi_ldem.scene import load_scene

    scene = load_scene(path, settings)
    check(scene)
    return scene


def _list(files: Sequence[Path]) -> None:
    for file in files:
        typer.echo(file)


def _complain(message: str, code: int) -> int:
    print(f"error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
