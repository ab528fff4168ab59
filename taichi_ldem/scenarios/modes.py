"""Free oscillations: natural frequencies and shapes of a scene's lattice (Section 5.1)."""

import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from rich.console import Console

from taichi_ldem.analysis import modeshapes
from taichi_ldem.analysis.modeshapes import Name
from taichi_ldem.analysis.paper import NATURAL_FREQUENCIES_HZ
from taichi_ldem.errors import ExitCode, SceneError
from taichi_ldem.scenarios.describe import warnings
from taichi_ldem.scenarios.drawing import Draw
from taichi_ldem.scenarios.progress import make_console
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scene import Modes, Scene
from taichi_ldem.solver import backend
from taichi_ldem.solver.memory import peak_bytes, refuse_too_large
from taichi_ldem.storage import plate_shape
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.fields import hexahedral_mesh, write_vectors
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.provenance import provenance

if TYPE_CHECKING:
    from taichi_ldem.solver.dynamics import Dynamics
    from taichi_ldem.solver.eigen import Modes as Solution
    from taichi_ldem.solver.eigen import TangentOperator

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Mode:
    """One mode.

    Attributes:
        number: from 1, in ascending order of frequency.
        frequency: Hz.
        residual: relative.
        name: name of its shape.
        group: number of the group of modes with the same frequency, from 1.
    """

    number: int
    frequency: float
    residual: float
    name: Name
    group: int


@dataclass(frozen=True)
class Shapes:
    """The data of the figure of the modes.

    Attributes:
        modes: in ascending order of frequency.
        planes: for each mode the grid lines x, y (m) and the motion (ny, nx, 3) of the mid-plane.
        circles: radii of the clamp's circles, m.
    """

    modes: list[Mode]
    planes: list[tuple[Array, Array, Array]]
    circles: list[float]


def run(
    scene: Scene, out: Path, *, force: bool = False, quiet: bool = False, draw: Draw | None = None
) -> int:
    """Compute the modes of a scene into a folder.

    Args:
        force: replace the run that the folder holds.
        quiet: print nothing on success.
        draw: draws the figure of the shapes; None: no figure.

    Returns:
        DONE, STOPPED (the solver did not converge) or INTERRUPTED of ``ExitCode``. Without DONE the
        folder holds the scene only.

    Raises:
        SceneError: the scene or the folder is refused; nothing has been written then.
    """
    console = make_console(quiet)
    files = SCENARIOS["modes"].writes
    RunFolder.check(out, force=force, files=files)
    linear, notes = linearised(scene)
    body = plate_shape.read(scene)
    refuse_too_large(linear)
    for line in notes + warnings(scene):
        console.print(f"note: {line}")
    backend.start(linear.solver)
    from taichi_ldem.solver import eigen

    dynamics, fixed = build(linear)
    count = (scene.modes or Modes()).count
    operator = eigen.TangentOperator(dynamics, fixed)
    console.print(f"{operator.size:,} degrees of freedom, {count} modes")
    with RunFolder.held(out):
        folder = RunFolder.create(out, force=force, files=files)
        plate_shape.write_scene(folder, scene, body)
        folder.write_provenance(provenance(scene))
        try:
            return _solve(scene, linear, operator, folder, console, draw)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return ExitCode.INTERRUPTED


def _solve(
    scene: Scene,
    linear: Scene,
    operator: "TangentOperator",
    folder: RunFolder,
    console: Console,
    draw: Draw | None,
) -> int:
    """Compute the modes and write all about them; the exit code."""
    from taichi_ldem.solver import eigen

    started, count = time.perf_counter(), (scene.modes or Modes()).count

    def report(line: str) -> None:
        console.print(f"{time.perf_counter() - started:6.1f} s  {line}")

    try:
        solution = eigen.lowest(operator, count, report)
    except ValueError as error:
        raise SceneError(f"modes.count = {count}: {error}") from None
    except eigen.NotConverged as error:
        print(f"stopped: {error}", file=sys.stderr)
        return ExitCode.STOPPED
    folder = folder.now()
    named = name_modes(linear, operator.dynamics, solution)
    write(folder, scene, operator.dynamics, solution, named)
    if draw is not None:
        planes = [mid_plane(operator.dynamics, shape) for shape in solution.shapes]
        draw(folder, pictures=False, data=Shapes(named, planes, circles(scene)))
    folder.write_summary(_summary(operator, solution, named, time.perf_counter() - started))
    console.print(table(scene, named))
    console.print(f"{time.perf_counter() - started:.1f} s in all; results in {folder.path}")
    return ExitCode.DONE


def _summary(
    operator: "TangentOperator", solution: "Solution", named: list[Mode], wall: float
) -> dict[str, Any]:
    """The numbers of summary.json."""
    lattice = operator.dynamics.lattice
    return {
        "frequencies_hz": solution.frequencies,
        "residuals": solution.residuals,
        "names": [str(mode.name) for mode in named],
        "groups": [mode.group for mode in named],
        "degrees_of_freedom": operator.size,
        "nodes": lattice.nodes,
        "bars": lattice.bars,
        "iterations": solution.iterations,
        "products": operator.applied,
        "wall_s": wall,
        "peak_memory_bytes": peak_bytes(),
    }


def linearised(scene: Scene) -> tuple[Scene, list[str]]:
    """The linear scene whose modes are computed, and a line for each change of the scene."""
    notes: list[str] = []
    changes: dict[str, Any] = {}
    if scene.clamp is not None and scene.clamp.kind == "rings":
        notes.append(
            "rings that may separate are not linear: they are taken as bonded (nodes of both faces "
            "between the circles are fixed)"
        )
        changes["clamp"] = scene.clamp.model_copy(update={"kind": "bonded"})
    if scene.strikers:
        plural = len(scene.strikers) > 1
        notes.append("the strikers are left out" if plural else "the striker is left out")
        changes["strikers"] = ()
    if scene.material.damage:
        notes.append("bars are elastic and have their full stiffness")
        changes["material"] = scene.material.model_copy(update={"damage": False})
    if scene.solver.damping > 0:
        notes.append("damping is left out")
    if scene.solver.precision != "f64":
        notes.append("the computation is in f64")
    changes["solver"] = scene.solver.model_copy(update={"precision": "f64", "damping": 0.0})
    return scene.model_copy(update=changes), notes


def build(scene: Scene) -> "tuple[Dynamics, npt.NDArray[np.int32]]":
    """The lattice's fields and kernels, and its fixed nodes. Taichi must have been started."""
    from taichi_ldem.solver.build import build_dynamics
    from taichi_ldem.solver.contact.rings import RINGS

    dynamics, _ = build_dynamics(scene)
    rings = RINGS.build(dynamics, scene)
    held = None if rings is None else rings.layout.nodes
    return dynamics, np.zeros(0, dtype=np.int32) if held is None else held


def name_modes(scene: Scene, dynamics: "Dynamics", solution: "Solution") -> list[Mode]:
    """Each mode with its name and group."""
    mass = dynamics.masses()
    position = dynamics.lattice.positions()
    radius = reference_radius(scene)
    inside = np.hypot(position[..., 0], position[..., 1]) <= (radius or math.inf)
    first = solution.frequencies.max()
    names = []
    for shape, frequency in zip(solution.shapes, solution.frequencies, strict=True):
        energy = mass[..., None] * shape**2
        total = energy.sum()
        if frequency < 1e-3 * first:
            names.append(Name("rigid"))
        elif radius is None:
            names.append(Name("other"))
        elif energy[inside].sum() < 0.5 * total:
            names.append(Name("outside"))
        elif energy[..., 2].sum() < 0.5 * total:
            names.append(Name("in-plane"))
        else:
            x, y, motion = mid_plane(dynamics, shape)
            names.append(Name("plate", *modeshapes.nodal_lines(x, y, motion[..., 2], radius)))
    number = np.empty(len(names), dtype=int)
    for group, members in enumerate(modeshapes.groups(names, solution.frequencies), start=1):
        number[members] = group
    values = zip(solution.frequencies, solution.residuals, names, number, strict=True)
    return [Mode(n, float(f), float(r), s, int(g)) for n, (f, r, s, g) in enumerate(values, 1)]


def reference_radius(scene: Scene) -> float | None:
    """Radius of the circle to which nodal diameters and circles refer, m; None without one."""
    if scene.held and scene.clamp is not None and scene.clamp.inner_diameter is not None:
        return scene.clamp.inner_diameter / 2
    return scene.plate.diameter / 2 if scene.plate.diameter is not None else None


def mid_plane(dynamics: "Dynamics", shape: Array) -> tuple[Array, Array, Array]:
    """Grid lines x (nx,), y (ny,), m, and motion (ny, nx, 3) of the node plane at half height.

    Corner nodes where the number of modules is even, centre nodes where it is odd. A lattice
    without centre nodes has the corner nodes below half height then.
    """
    nz = dynamics.lattice.mask.shape[0]
    kind, layer = nz % dynamics.cell.sublattices, 1 + nz // 2
    stop = -1 - kind
    position = dynamics.lattice.grid()[kind, layer, 1:stop, 1:stop]
    return position[0, :, 0], position[:, 0, 1], shape[kind, layer, 1:stop, 1:stop]


def write(
    folder: RunFolder,
    scene: Scene,
    dynamics: "Dynamics",
    solution: "Solution",
    named: list[Mode],
) -> None:
    """Write modes.csv, modes.md and modes.vtkhdf into the folder."""
    lines = ["mode,frequency_hz,residual,kind,nodal_diameters,nodal_circles,group"]
    for mode in named:
        name = mode.name
        counts = ("" if n is None else str(n) for n in (name.diameters, name.circles))
        lines.append(
            f"{mode.number},{mode.frequency!r},{mode.residual:.3e},{name.kind},"
            f"{','.join(counts)},{mode.group}"
        )
    write_whole(folder.path / "modes.csv", ("\n".join(lines) + "\n").encode())
    write_whole(folder.path / "modes.md", (table(scene, named) + "\n").encode())
    lattice = dynamics.lattice
    points, cells, sites = hexahedral_mesh(lattice.mask, lattice.spacing, lattice.origin)
    at = tuple((sites + 1).T)
    points = lattice.positions()[0][at]
    shapes = {f"mode_{m.number:02d}": s[0][at] for m, s in zip(named, solution.shapes, strict=True)}
    write_vectors(folder.path / "modes.vtkhdf", points, cells, shapes)


def circles(scene: Scene) -> list[float]:
    """Radii of the circles between or within which a scene's clamp holds the plate, m."""
    clamp = scene.clamp
    if clamp is None or not scene.held:
        return []
    diameters = [clamp.inner_diameter, clamp.outer_diameter if clamp.kind != "rim" else None]
    return [d / 2 for d in diameters if d is not None]


def table(scene: Scene, named: list[Mode]) -> str:
    """The modes as a Markdown table, a row for each group, with thin-plate theory where it applies.

    Where plate and clamp are the paper's, its Table 2 is added.
    """
    theory, paper = scene.held, is_papers(scene)
    heads = ["mode", "name", "frequency [kHz]", "residual"]
    heads += ["thin plate [kHz]"] if theory else []
    heads += ["paper's LDEM [kHz]", "paper's Rayleigh-Ritz [kHz]"] if paper else []
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for group in sorted({mode.group for mode in named}):
        members = [mode for mode in named if mode.group == group]
        name = members[0].name
        cells = [
            ", ".join(str(mode.number) for mode in members),
            f"{name}{f' x {len(members)}' if len(members) > 1 else ''}",
            _values([1e-3 * mode.frequency for mode in members]),
            f"{max(mode.residual for mode in members):.0e}",
        ]
        if theory:
            cells.append(f"{1e-3 * thin_plate(scene, name):.3f}" if name.kind == "plate" else "")
        if paper:
            printed = None
            if name.kind == "plate":
                printed = NATURAL_FREQUENCIES_HZ.get((name.diameters, name.circles))  # type: ignore[arg-type]
            cells += ["", ""] if printed is None else [f"{1e-3 * v:.2f}" for v in printed]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _values(numbers: list[float]) -> str:
    """The frequencies of a group, without repetitions: one number for a degenerate group."""
    texts = list(dict.fromkeys(f"{number:.3f}" for number in numbers))
    return ", ".join(texts) if len(texts) <= 2 else f"{texts[0]} to {texts[-1]}"


def thin_plate(scene: Scene, name: Name) -> float:
    """Frequency of the thin disc clamped at the scene's inner circle, Hz."""
    m, radius = scene.material, reference_radius(scene)
    assert radius is not None
    return modeshapes.thin_plate_frequency(
        name, radius, scene.plate.size[2], m.youngs_modulus, m.poisson_ratio, m.density
    )


def is_papers(scene: Scene) -> bool:
    """Whether plate and clamp are those of the paper's test, whatever the material."""
    clamp = scene.clamp
    return (
        clamp is not None
        and clamp.kind in ("rings", "bonded")
        and np.allclose(scene.plate.size, (0.0928, 0.0928, 0.0032), rtol=0.01)
        and (clamp.inner_diameter, clamp.outer_diameter) == (0.076, 0.09)
    )
