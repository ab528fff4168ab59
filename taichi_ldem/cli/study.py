"""``ldem study ...``: the studies that are commands. No physics, and nothing heavy is imported."""

from pathlib import Path
from typing import Annotated

import typer

from taichi_ldem.cli.options import Settings, read_scene

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
    quick: Annotated[bool, typer.Option("--quick", help="ten cases, some seconds")] = False,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="cases whose name contains this")
    ] = None,
    workers: Workers = 0,
) -> None:
    """Run stiff and extreme cases, each against what theory predicts."""
    from taichi_ldem.studies.extremes.study import run

    raise typer.Exit(run(out, quick=quick, only=only or (), workers=workers))


@app.command()
def convergence(
    scene_file: Annotated[Path, typer.Argument(metavar="SCENE.toml", show_default=False)],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="where runs go (default: outputs/SCENE)")
    ] = None,
    modules: Annotated[
        list[int] | None,
        typer.Option(metavar="N", help="modules through the thickness; repeatable"),
    ] = None,
    reference: Annotated[
        int | None, typer.Option(metavar="N", help="modules of the reference")
    ] = None,
    seeds: Annotated[int, typer.Option(min=2, help="places of a cracking scene's striker")] = 4,
    force: Annotated[bool, typer.Option("--force", help="remove another scene's runs")] = False,
) -> None:
    """Measure error against run time; a study that was interrupted continues."""
    from taichi_ldem.studies.convergence.study import run

    folder = Path("outputs", scene_file.stem) if out is None else out
    raise typer.Exit(
        run(
            scene_file, folder, modules=modules or (), reference=reference, seeds=seeds, force=force
        )
    )


@app.command()
def toughness(
    scene_file: Annotated[Path, typer.Argument(metavar="SCENE.toml", show_default=False)],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="where results go (default: outputs/SCENE)")
    ] = None,
    angle: Annotated[
        list[float] | None,
        typer.Option(metavar="DEGREES", help="of the crack to a lattice plane; repeatable"),
    ] = None,
    refine: Annotated[
        list[float] | None,
        typer.Option(metavar="X", help="number of modules over the scene's; repeatable"),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="places of the notch within a module")] = 3,
    quick: Annotated[bool, typer.Option("--quick", help="two strips only")] = False,
    settings: Settings = None,
    workers: Annotated[
        int, typer.Option(min=0, help="processes at a time, which share the cores (0: all cores)")
    ] = 0,
) -> None:
    """Measure what a crack costs over its direction and the module size; a study continues."""
    from taichi_ldem.studies.toughness.study import run

    folder = Path("outputs", scene_file.stem) if out is None else out
    raise typer.Exit(
        run(
            read_scene(scene_file, settings or (), {}),
            folder,
            angles=angle or (),
            refinements=refine,
            seeds=seeds,
            quick=quick,
            workers=workers,
        )
    )
