"""The command `ensemble`."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from taichi_ldem.cli.options import Precision, Quiet, SceneFile, Settings


def register(app: typer.Typer) -> None:
    """Add the command to an app."""
    app.command()(ensemble)


def ensemble(
    scene_file: SceneFile,
    cv: Annotated[
        str | None,
        typer.Option(metavar="CV,CV,...", help="CVs of the fracture energy; 0: homogeneous"),
    ] = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="FIRST:END", help="seeds; 0:4 is 0 to 3; or 1,5,7")
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
    slurm: Annotated[
        int | None,
        typer.Option(min=1, metavar="JOBS", help="run in so many SLURM jobs instead"),
    ] = None,
    threads: Annotated[int, typer.Option(min=1, help="CPU threads of each member")] = 1,
    timeout: Annotated[
        float | None,
        typer.Option(min=1e-3, metavar="SECONDS", help="limit of one attempt at a member"),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="continue the ensemble in DIR")] = False,
    precision: Precision = None,
    figures: Annotated[
        bool,
        typer.Option(
            "--figures/--no-figures", help="figures and pictures of each member (default: none)"
        ),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Run a scene many times: seeds, variabilities and any keys, several at a time."""
    from taichi_ldem.ensemble import plan
    from taichi_ldem.ensemble.run import How, default_folder, run
    from taichi_ldem.errors import SceneError
    from taichi_ldem.model.material import check

    if sum(place is not None for place in (local, scheduler, slurm)) > 1:
        raise SceneError("--local, --scheduler and --slurm exclude each other")
    given = [] if precision is None else [f"solver.precision={precision}"]
    given = [*(settings or ()), *given]
    members = plan.make_plan(scene_file, cv=cv, seeds=seeds, vary=vary or (), settings=given)
    for member in members.members:
        check(member.scene, scene_file.name)
    folder = default_folder(scene_file) if out is None else out
    how = How(local=local, scheduler=scheduler, slurm=slurm, threads=threads)
    how = replace(how, timeout=timeout, figures=figures)
    raise typer.Exit(run(members, folder, how, resume=resume, quiet=quiet))
