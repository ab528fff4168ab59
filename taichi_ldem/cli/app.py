"""The command line: a command a scenario, `resume`, `info`, `render`, `plot`, `report`.

No physics here. Heavy modules are imported inside the commands, Taichi only once the scene and the
run folder are known to be good: help and refusals are quick.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_ldem.cli.study import app as studies

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
    series: Annotated[
        bool,
        typer.Option(
            "--series",
            help="run eight beams of other widths and notches: the fracture energy as a slope;"
            " what is finished in DIR is not run again",
        ),
    ] = False,
) -> None:
    """Run a notched three-point bending test, or a series of them; options as for impact."""
    options = {"arch": arch, "precision": precision, "threads": threads}
    if series:
        scene = _scene("bend", scene_file, settings, options)

        from taichi_ldem.studies import bending

        beams = [bending.Specimen(*beam, scene.plate.spacing) for beam in bending.SPECIMENS]
        folder = Path("outputs", f"{scene_file.stem}_series") if out is None else out
        raise typer.Exit(bending.series(beams, scene, folder, ["--quiet"] if quiet else []))
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
    from taichi_ldem.storage.store import RunFolder

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
    from taichi_ldem.errors import SceneError
    from taichi_ldem.model.material import check

    if local is not None and scheduler is not None:
        raise SceneError("--local and --scheduler exclude each other")
    given = [] if precision is None else [f"solver.precision={precision}"]
    given = [*(settings or ()), *given]
    members = plan.make_plan(scene_file, cv=cv, seeds=seeds, vary=vary or (), settings=given)
    for member in members.members:
        check(member.scene, scene_file.name)
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
    fields: Annotated[bool, typer.Option("--fields", help="memory of every field, too")] = False,
) -> None:
    """Print what a scene implies, without running it."""
    scene = _load(scene_file, settings or ())

    from rich.console import Console

    from taichi_ldem.scenarios.describe import describe

    Console().print(describe(scene, measure, fields))


@app.command()
def render(
    folder: Folder,
    time: Annotated[
        list[float] | None,
        typer.Option(metavar="SECONDS", help="of a snapshot (default: image times and the end)"),
    ] = None,
    movie: Annotated[
        bool, typer.Option("--movie", help="a movie of all stored fields instead of snapshots")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="the movie, .mp4 or .gif (default: DIR/movie.mp4)"),
    ] = None,
    view: Annotated[str | None, typer.Option(help="below, above or cut")] = None,
    azimuth: Annotated[
        float | None, typer.Option(help="of the camera, degrees from the -y axis")
    ] = None,
    elevation: Annotated[
        float | None, typer.Option(help="of the camera, degrees above the plate")
    ] = None,
    section: Annotated[
        str | None,
        typer.Option(metavar="AXIS=METRES", help="cut the plate open, e.g. y=0"),
    ] = None,
    colour: Annotated[str | None, typer.Option(help="damage, velocity or energy")] = None,
    fps: Annotated[float, typer.Option(help="pictures a second of a movie")] = 12.0,
    width: Annotated[int, typer.Option(help="of a movie, pixels")] = 1120,
) -> None:
    """Draw the snapshots of a run again, or a movie.

    With a view, camera, section or colour of its own a snapshot is one picture, shot_MSms_VIEW.png.
    """
    from taichi_ldem.output.render.snapshots import render_run
    from taichi_ldem.output.render.views import Shot, parse_section
    from taichi_ldem.storage.store import RunFolder

    run = RunFolder.open(folder)
    given = {"view": view, "azimuth": azimuth, "elevation": elevation, "colour": colour}
    own: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    if section is not None:
        own["section"] = parse_section(section)
    shot = Shot(**own)
    if movie or out is not None:
        from taichi_ldem.output.movie import movie as make

        path = folder / "movie.mp4" if out is None else out
        count = make(run, path, shot, fps=fps, width=width)
        typer.echo(f"{path}: {count} pictures")
    elif own:
        from taichi_ldem.output.render.snapshots import render_shots_into

        _list(render_shots_into(run, shot, time or None))
    else:
        _list(render_run(run, time or None))


@app.command()
def plot(folder: Folder) -> None:
    """Draw the figures of a run again, or the figures and tables of an ensemble."""
    from taichi_ldem.ensemble.report import is_ensemble, report
    from taichi_ldem.output.figures.run import plot_run
    from taichi_ldem.storage.store import RunFolder

    _list(report(folder) if is_ensemble(folder) else plot_run(RunFolder.open(folder)))


@app.command()
def report(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="folder of a run or an ensemble", show_default=False),
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="the page (default: DIR/report.html)")
    ] = None,
    pictures: Annotated[
        int, typer.Option(help="times at which the plate is drawn, at most", min=0)
    ] = 12,
) -> None:
    """Write one HTML page about a run or an ensemble; it opens from disk, without a network."""
    from taichi_ldem.ensemble import page
    from taichi_ldem.output.report.run import write_report

    if page.has_members(folder):
        typer.echo(page.write_report(folder, out))
    else:
        typer.echo(write_report(folder, out, pictures=pictures))


@app.command()
def paper(
    quick: Annotated[
        bool, typer.Option("--quick", help="coarser lattices, minutes instead of hours")
    ] = False,
    resume: Annotated[bool, typer.Option("--resume", help="go on in the same folder")] = False,
    only: Annotated[
        str | None, typer.Option(metavar="KEY,KEY,...", help="e.g. fig11,table3")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR")] = Path("outputs", "paper"),
) -> None:
    """Recompute the paper's figures and tables, each beside the printed values."""
    from taichi_ldem.reproduction.paper import reproduce

    code = reproduce(out, quick=quick, resume=resume, only=only, tell=typer.echo)
    raise typer.Exit(code)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    0: done; 1: a file could not be read or written; 2: bad input; 3: stopped by the run-time
    guard; 4: a run could no longer write its files; 5: members of an ensemble did not finish;
    130: interrupted; 143: terminated. Errors are one line on stderr.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        # outside of its standalone mode Typer returns the code of typer.Exit
        return int(app(list(arguments) or ["--help"], "ldem", standalone_mode=False) or 0)
    except UsageError as error:
        return _complain(" ".join(error.format_message().split()) + _hint(error), 2)
    except typer.Abort:
        return 130
    except OSError as error:
        return _complain(str(error), 1)
    except ValueError as error:
        from taichi_ldem.errors import SceneError

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
    scene = _scene(command, scene_file, settings, options)
    folder = Path("outputs", scene_file.stem) if out is None else out

    from taichi_ldem.storage.store import RunFolder

    RunFolder.check(folder, force=force)
    return scene, folder


def _scene(
    command: str,
    scene_file: Path,
    settings: Sequence[str] | None,
    options: dict[str, str | int | None],
) -> "Scene":
    given = [f"solver.{key}={value}" for key, value in options.items() if value is not None]
    scene = _load(scene_file, [*(settings or ()), *given])
    if scene.scenario != command:
        from taichi_ldem.errors import SceneError

        name = scene.scenario
        raise SceneError(f'{scene_file.name}: scenario = "{name}": run it with `ldem {name}`')
    return scene


def _load(path: Path, settings: Sequence[str]) -> "Scene":
    from taichi_ldem.model.material import check
    from taichi_ldem.scene import load_scene

    scene = load_scene(path, settings)
    check(scene, path.name)
    return scene


def _hint(error: Any) -> str:
    """What to write for an option that is a key of the scene."""
    option, context = getattr(error, "option_name", None), getattr(error, "ctx", None)
    options = [name for p in context.command.params for name in p.opts] if context else []
    if not option or "--set" not in options:
        return ""

    from taichi_ldem.scene import key_for

    key = key_for(str(option))
    return f"; keys of the scene: --set {key or 'SECTION.KEY'}={'...' if key else 'VALUE'}"


def _list(files: Sequence[Path]) -> None:
    for file in files:
        typer.echo(file)


def _complain(message: str, code: int) -> int:
    print(f"error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
