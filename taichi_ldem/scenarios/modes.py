"""Free oscillations: natural frequencies and shapes of a scene's lattice (Section 5.1)."""

import math
import resource
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
from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.describe import warnings
from taichi_ldem.scene import Clamp, Modes, Scene, scene_to_toml
from taichi_ldem.solver import backend
from taichi_ldem.storage.store import RunFolder, hexahedral_mesh, write_vectors

if TYPE_CHECKING:
    from taichi_ldem.solver.dynamics import Dynamics
    from taichi_ldem.solver.eigen import Modes as Solution

Array = npt.NDArray[np.float64]

STOPPED, INTERRUPTED = 3, 130


@dataclass(frozen=True)
class Mode:
    """One mode: number from 1, frequency (Hz), relative residual, name, number of its group."""

    number: int
    frequency: float
    residual: float
    name: Name
    group: int


def run(scene: Scene, out: Path, *, force: bool = False, quiet: bool = False) -> int:
    """Compute the modes of a scene into a folder.

    Returns:
        0; 3 where the solver did not converge; 130 after Ctrl-C: nothing but the scene is there
        then.

    Raises:
        SceneError: the scene or the folder is refused; nothing has been written then.
    """
    console = Console(quiet=quiet, highlight=False, markup=False, soft_wrap=True)
    RunFolder.check(out, force=force)
    started = time.perf_counter()
    linear, notes = linearised(scene)
    for line in notes + warnings(scene):
        console.print(f"note: {line}")
    backend.start(linear.solver)
    from taichi_ldem.solver import eigen

    dynamics, fixed = build(linear)
    count = (scene.modes or Modes()).count
    operator = eigen.TangentOperator(dynamics, fixed)
    console.print(f"{operator.size:,} degrees of freedom, {count} modes")
    folder = RunFolder.create(out, force=force)
    folder.write_scene(scene_to_toml(scene))

    def tell(line: str) -> None:
        console.print(f"{time.perf_counter() - started:6.1f} s  {line}")

    try:
        solution = eigen.lowest(operator, count, tell)
    except ValueError as error:
        raise SceneError(f"modes.count = {count}: {error}") from None
    except eigen.NotConverged as error:
        print(f"stopped: {error}", file=sys.stderr)
        return STOPPED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    named = name_modes(linear, dynamics, solution)
    write(folder, scene, dynamics, solution, named)
    folder.write_summary(
        {
            "frequencies_hz": solution.frequencies,
            "residuals": solution.residuals,
            "names": [str(mode.name) for mode in named],
            "groups": [mode.group for mode in named],
            "degrees_of_freedom": operator.size,
            "nodes": dynamics.lattice.nodes,
            "bars": dynamics.lattice.bars,
            "iterations": solution.iterations,
            "products": operator.applied,
            "wall_s": time.perf_counter() - started,
            "peak_memory_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        }
    )
    console.print(table(scene, named))
    console.print(f"{time.perf_counter() - started:.1f} s in all; results in {out}")
    return 0


def linearised(scene: Scene) -> tuple[Scene, list[str]]:
    """The scene whose modes are computed, and what was changed for it, a line each."""
    notes: list[str] = []
    changes: dict[str, Any] = {}
    if scene.clamp is not None and scene.clamp.kind == "rings":
        notes.append(
            "rings that may separate are not linear: taken as bonded (nodes of both faces between "
            "the circles fixed)"
        )
        changes["clamp"] = scene.clamp.model_copy(update={"kind": "bonded"})
    if scene.striker is not None:
        notes.append("the striker is left out")
        changes["striker"] = None
    if scene.material.damage:
        notes.append("bars are elastic, of whole stiffness")
        changes["material"] = scene.material.model_copy(update={"damage": False})
    if scene.solver.damping > 0:
        notes.append("damping is left out")
    if scene.solver.precision != "f64":
        notes.append("computed in f64")
    changes["solver"] = scene.solver.model_copy(update={"precision": "f64", "damping": 0.0})
    return scene.model_copy(update=changes), notes


def build(scene: Scene) -> "tuple[Dynamics, npt.NDArray[np.int32]]":
    """The lattice's fields and kernels, and its fixed nodes; Taichi must have been started."""
    from taichi_ldem.solver.build import build_dynamics
    from taichi_ldem.solver.contact.rings import RINGS

    dynamics, _ = build_dynamics(scene)
    rings = RINGS.build(dynamics, scene, 0.0)
    return dynamics, np.zeros(0, dtype=np.int32) if rings is None else rings.listed()


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
    """Radius of the circle that nodal diameters and circles refer to, m; None without one."""
    if scene.held and scene.clamp is not None and scene.clamp.inner_diameter is not None:
        return scene.clamp.inner_diameter / 2
    return scene.plate.diameter / 2 if scene.plate.diameter is not None else None


def mid_plane(dynamics: "Dynamics", shape: Array) -> tuple[Array, Array, Array]:
    """Grid lines x (nx,), y (ny,), m, and motion (ny, nx, 3) of the node plane at half height.

    Corner nodes where the number of modules is even, centre nodes where it is odd.
    """
    nz = dynamics.lattice.mask.shape[0]
    kind, layer = nz % 2, 1 + nz // 2
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
    """The folder's modes.csv, modes.md, modes.vtkhdf and modes.png."""
    lines = ["mode,frequency_hz,residual,kind,nodal_diameters,nodal_circles,group"]
    for mode in named:
        name = mode.name
        counts = ("" if n is None else str(n) for n in (name.diameters, name.circles))
        lines.append(
            f"{mode.number},{mode.frequency!r},{mode.residual:.3e},{name.kind},"
            f"{','.join(counts)},{mode.group}"
        )
    (folder.path / "modes.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder.path / "modes.md").write_text(table(scene, named) + "\n", encoding="utf-8")
    lattice = dynamics.lattice
    points, cells, sites = hexahedral_mesh(lattice.mask, lattice.spacing, lattice.origin)
    at = tuple((sites + 1).T)
    points = lattice.positions()[0][at]
    shapes = {f"mode_{m.number:02d}": s[0][at] for m, s in zip(named, solution.shapes, strict=True)}
    write_vectors(folder.path / "modes.vtkhdf", points, cells, shapes)
    planes = [mid_plane(dynamics, shape) for shape in solution.shapes]
    from taichi_ldem.output.figures.modes import plot_modes

    clamp = scene.clamp if scene.held else None
    plot_modes(folder.path / "modes.png", named, planes, _circles(clamp))


def _circles(clamp: Clamp | None) -> list[float]:
    if clamp is None:
        return []
    diameters = [clamp.inner_diameter, clamp.outer_diameter if clamp.kind != "rim" else None]
    return [d / 2 for d in diameters if d is not None]


def table(scene: Scene, named: list[Mode]) -> str:
    """The modes as a Markdown table, a row for each group, beside thin-plate theory.

    Where the clamp is the paper's, beside its Table 2 too.
    """
    theory, paper = _has_theory(scene), is_papers(scene)
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
    """Different numbers of a group: one for a degenerate one."""
    texts = list(dict.fromkeys(f"{number:.3f}" for number in numbers))
    return ", ".join(texts) if len(texts) <= 2 else f"{texts[0]} to {texts[-1]}"


def _has_theory(scene: Scene) -> bool:
    return scene.held


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
