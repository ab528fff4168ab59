"""Where a clamp begins on the lattice: the first frequency of a clamped plate by ``clamp.edge``.

    python -m studies.clamp_edge configs/modes.toml [--modules 3 4 6] [--edges 0 0.5]
        [--refine 2 3 | --reference HZ] [--set KEY=VALUE ...]

A clamp between circles holds nodes of a square lattice, so its edge is a staircase. With
``clamp.edge = "node"`` it holds the nodes between the circles; with "unbiased", those up to half a
module outside them, too. ``--edges`` gives this distance in modules: 0 and 0.5 are these two. The
reference is that of finite elements with the exact circle, on two meshes.
"""

import time
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from studies.frequencies import order
from taichi_ldem.scene import Scene, load_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.dynamics import Dynamics


def held(scene: Scene, dynamics: "Dynamics", edge: float) -> npt.NDArray[np.int32]:
    """Nodes of a scene's clamp whose circles are wider by a part of a module on both sides."""
    from taichi_ldem.solver.contact.kernels.rings import fixed_nodes

    clamp, beyond = scene.clamp, edge * scene.plate.spacing
    assert clamp is not None
    assert clamp.inner_diameter is not None
    through = clamp.kind == "rim"
    outer = np.inf if through or clamp.outer_diameter is None else clamp.outer_diameter / 2
    numbers = (clamp.inner_diameter / 2 - beyond, outer + beyond, scene.plate.size[2])
    return fixed_nodes(dynamics, numbers, through=through)


def frequencies(scene: Scene, edges: Sequence[float]) -> Iterator[tuple[float, float]]:
    """Lowest frequency of a scene's plate for each edge of its clamp, Hz; Taichi must run."""
    from taichi_ldem.scenarios.modes import build
    from taichi_ldem.solver import eigen

    dynamics, _ = build(scene)
    for edge in edges:
        operator = eigen.TangentOperator(dynamics, held(scene, dynamics, edge))
        yield edge, float(eigen.lowest(operator, 1).frequencies[0])


def reference(scene: Scene, refine: int) -> float:
    """The first bending frequency by finite elements, Hz."""
    from taichi_ldem.studies import finite_elements as fe

    part, constants = fe.scene_part(scene, refine), fe.scene_constants(scene)
    found, _, _ = fe.frequencies(part, constants, scene.material.density, fe.BENDING["SS"], 1)
    return float(found[0])


def table(errors: dict[float, dict[int, float]], modules: Sequence[int]) -> str:
    """Errors in percent and their order, as Markdown."""
    heads = ["circles wider by", *(f"{n} modules" for n in modules), "order"]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for edge, found in errors.items():
        cells = [f"{100 * found[n]:+.2f} %" if n in found else "" for n in modules]
        lines.append("| " + " | ".join([f"{edge:g} L", *cells, f"{order(found):.1f}"]) + " |")
    return "\n".join(lines)


def main() -> None:
    """Print the table, after each frequency a line."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--modules", type=int, nargs="+", default=[3, 4, 6])
    parser.add_argument("--edges", type=float, nargs="+", default=[0.0, 0.5], metavar="MODULES")
    parser.add_argument("--refine", type=int, nargs="+", default=[2, 3], help="meshes, finest last")
    parser.add_argument("--reference", type=float, metavar="HZ", help="instead of finite elements")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    options = parser.parse_args()
    base = load_scene(options.scene, options.settings)
    exact = [options.reference]
    if options.reference is None:
        exact = [reference(base, refine) for refine in options.refine]
    print(f"finite elements: {', '.join(f'{value:.2f}' for value in exact)} Hz", flush=True)
    from taichi_ldem.solver import backend

    backend.start(base.solver)
    errors: dict[float, dict[int, float]] = {edge: {} for edge in options.edges}
    for n in options.modules:
        scene = base.changed(f"plate.modules_through_thickness={n}")
        begun = time.perf_counter()
        for edge, value in frequencies(scene, options.edges):
            errors[edge][n] = value / exact[-1] - 1
            seconds = time.perf_counter() - begun
            print(
                f"{n} modules, {edge:g} L: {value:.2f} Hz, {100 * errors[edge][n]:+.3f} %, "
                f"{seconds:.0f} s",
                flush=True,
            )
    print(table(errors, options.modules))


if __name__ == "__main__":
    main()
