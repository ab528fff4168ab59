"""The command `paper`."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    """Add the command to an app."""
    app.command()(paper)


def paper(
    quick: Annotated[
        bool, typer.Option("--quick", help="coarser lattices, minutes instead of hours")
    ] = False,
    resume: Annotated[bool, typer.Option("--resume", help="continue in the same folder")] = False,
    only: Annotated[
        str | None, typer.Option(metavar="KEY,KEY,...", help="e.g. fig11,table3")
    ] = None,
    out: Annotated[Path, typer.Option(metavar="DIR")] = Path("outputs", "paper"),
) -> None:
    """Recompute the paper's figures and tables, each next to the printed values."""
    from taichi_ldem.reproduction.paper import reproduce

    code = reproduce(out, quick=quick, resume=resume, only=only, tell=typer.echo)
    raise typer.Exit(code)
