"""``ldem study ...``: the studies that are commands. No physics, and nothing heavy is imported."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Studies of the program itself: stability, error against run time.")

Workers = Annotated[
    int, typer.Option(min=0, help="processes at a time, a thread each (0: all cores)")
]


@app.callback()
def study() -> None:
    """Studies of the program itself: stability, error against run time."""


@app.command()
def extremes(
    out: Annotated[Path, typer.Option(metavar="DIR", help="where results go")] = Path(
        "outputs/extremes"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="the small form, some seconds")] = False,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="cases whose name contains this")
    ] = None,
    workers: Workers = 0,
) -> None:
    """Run stiff and extreme cases, each against what theory predicts."""
    from taichi_ldem.studies.extremes import run

    raise typer.Exit(run(out, quick=quick, only=only or (), workers=workers))
