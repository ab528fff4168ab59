"""The commands that show a scene or a run: `info`, `render`, `plot`, `report`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichi_ldem.cli.options import Folder, SceneFile, Settings, list_files, read_scene_to_run

if TYPE_CHECKING:
    from taichi_ldem.storage.folder import RunFolder


def register(app: typer.Typer) -> None:
    """Add the commands to an app."""
    for command in (info, render, plot, report):
        app.command()(command)


def info(
    scene_file: SceneFile,
    settings: Settings = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="also time a step, which takes a minute or more")
    ] = False,
    fields: Annotated[
        bool, typer.Option("--fields", help="also list the memory of every field")
    ] = False,
) -> None:
    """Print what a scene implies, without running it."""
    scene = read_scene_to_run(scene_file, settings or ())

    from rich.console import Console

    from taichi_ldem.scenarios.describe import describe
    from taichi_ldem.streams import refuse_lost

    Console().print(describe(scene, measure, fields))
    refuse_lost()


def render(
    folder: Folder,
    time: Annotated[
        list[float] | None,
        typer.Option(
            metavar="SECONDS", help="time of a snapshot (default: image times and the end)"
        ),
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
        float | None, typer.Option(help="direction of the camera, degrees from the -y axis")
    ] = None,
    elevation: Annotated[
        float | None, typer.Option(help="height of the camera, degrees above the plate")
    ] = None,
    section: Annotated[
        str | None,
        typer.Option(metavar="AXIS=METRES", help="cut the plate open, e.g. y=0"),
    ] = None,
    colour: Annotated[str | None, typer.Option(help="damage, velocity, energy or fragment")] = None,
    fps: Annotated[float, typer.Option(help="frames a second of a movie")] = 12.0,
    width: Annotated[int, typer.Option(help="width of a movie, pixels")] = 1120,
) -> None:
    """Draw the snapshots of a run again, or a movie.

    With a view, camera, section or colour of its own a snapshot is one picture, shot_MSms_VIEW.png.
    """
    from taichi_ldem.output.render.snapshots import render_run, render_shots_into
    from taichi_ldem.output.render.views import Shot, parse_section
    from taichi_ldem.storage.folder import RunFolder

    run = RunFolder.open(folder)
    given = {"view": view, "azimuth": azimuth, "elevation": elevation, "colour": colour}
    own: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    if section is not None:
        own["section"] = parse_section(section)
    shot = Shot(**own)
    if movie or out is not None:
        from taichi_ldem.output.movie import movie as make

        path = folder / "movie.mp4" if out is None else out
        if out is None:
            run.claim([path.name])
        count = make(run, path, shot, fps=fps, width=width)
        typer.echo(f"{path}: {count} pictures")
    elif own:
        list_files(render_shots_into(run, shot, time or None))
    else:
        list_files(render_run(run, time or None))
    refuse_damaged(run)


def plot(folder: Folder) -> None:
    """Draw the figures of a run again, or the figures and tables of an ensemble."""
    from taichi_ldem.ensemble.report import is_ensemble
    from taichi_ldem.ensemble.report import report as report_ensemble
    from taichi_ldem.output.figures.run import plot_run
    from taichi_ldem.storage.folder import RunFolder

    if is_ensemble(folder):
        list_files(report_ensemble(folder))
        return
    run = RunFolder.open(folder)
    list_files(plot_run(run))
    refuse_damaged(run)


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
    from taichi_ldem.storage.folder import RunFolder

    if page.has_members(folder):
        typer.echo(page.write_report(folder, out))
    else:
        typer.echo(write_report(folder, out, pictures=pictures))
        refuse_damaged(RunFolder(folder))


def refuse_damaged(run: "RunFolder") -> None:
    """End with an error after figures were drawn from damaged fields, which they say themselves.

    Raises:
        DamagedFile: values of the fields are impossible, or not finite.
    """
    from taichi_ldem.errors import DamagedFile
    from taichi_ldem.storage.fields import fault_of

    fault = fault_of(run.fields_file) if run.fields_file.exists() else ""
    if fault:
        raise DamagedFile(f"'{run.fields_file}' is damaged: {fault}; the figures say so")
