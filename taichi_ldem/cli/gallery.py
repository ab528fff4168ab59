"""The command `gallery`."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to an app."""
    app.command()(gallery)


def gallery(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="problems (default: all)", show_default=False),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="coarser lattices and fewer runs: minutes")
    ] = False,
    only_list: Annotated[
        bool, typer.Option("--list", help="print the problems' names and run nothing")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="default: outputs/gallery, with --quick outputs/gallery_quick"
        ),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=0, help="processes at a time, which share the cores (0: all cores)")
    ] = 0,
) -> None:
    """Run the literature's benchmark problems, each next to its published reference."""
    from taichi_ldem.gallery import command

    if only_list:
        typer.echo("\n".join(command.listed()))
        raise typer.Exit()
    folder = out or Path("outputs", "gallery_quick" if quick else "gallery")
    code = command.run(names or (), folder, quick=quick, workers=workers, tell=typer.echo)
    raise typer.Exit(code)
