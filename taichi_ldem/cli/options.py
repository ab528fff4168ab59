"""Arguments and options that several commands share, and how a scene is read with them.

Typer makes an option of every parameter of a command. This is the only reason why `ensemble` and
`render` have more than seven parameters; they pass on plain values or one object.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE.toml", show_default=False)]
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="run folder", show_default=False)]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="SECTION.KEY=VALUE", help="override a key of the scene"),
]
Out = Annotated[
    Path | None, typer.Option(metavar="DIR", help="run folder (default: outputs/SCENE)")
]
Force = Annotated[bool, typer.Option("--force", help="replace the run in DIR, and no other file")]
Resume = Annotated[
    bool,
    typer.Option("--resume", help="go on where a run of this scene is in DIR, start it otherwise"),
]
Arch = Annotated[str | None, typer.Option(help="cpu, cuda (or gpu) or vulkan")]
Precision = Annotated[str | None, typer.Option(help="f64 or f32")]
Threads = Annotated[int | None, typer.Option(help="CPU threads (default: all cores)")]
Figures = Annotated[
    bool,
    typer.Option(
        "--figures/--no-figures",
        help="draw figures and pictures at the end; `ldem plot` and `ldem render` draw them later",
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="print nothing on success")]


def read_scene(path: Path, settings: Sequence[str], options: Mapping[str, object]) -> "Scene":
    """A scene with its overrides; options override ``--set``, which overrides the file.

    Args:
        options: values by key of the scene, "section.key"; None where the option is absent.

    Raises:
        SceneError: the file, an override or a value is not acceptable.
    """
    from taichi_ldem.scene import load_scene

    given = [f"{key}={value}" for key, value in options.items() if value is not None]
    return load_scene(path, [*settings, *given])


def read_scene_to_run(
    path: Path, settings: Sequence[str] = (), options: Mapping[str, object] | None = None
) -> "Scene":
    """A scene, as ``read_scene`` gives it, whose material and lattice can be simulated in time.

    Raises:
        SceneError: also where bars of this size cannot dissipate the fracture energy.
    """
    from taichi_ldem.model.material import check

    scene = read_scene(path, settings, options or {})
    check(scene, path.name)
    return scene


def list_files(files: Sequence[Path]) -> None:
    """Print the names of files, a line each."""
    for file in files:
        typer.echo(file)
