"""Where a clamp begins on the lattice: the first frequency of a clamped plate by ``clamp.edge``.

    python -m studies.clamp_edge configs/modes.toml [--modules 3 4 6] [--edges 0 0.5]
        [--stairs] [--refine 2 3 | --reference HZ] [--set KEY=VALUE ...]

A clamp between circles holds nodes of a square lattice, so its edge is a staircase. With
``clamp.edge = "node"`` it holds the nodes between the circles; with "unbiased", those up to half a
module outside them, too. ``--edges`` gives this distance in modules: 0 and 0.5 are these two. The
reference is that of finite elements with the exact circle, on two meshes.

The stairs of one circle are one case of many. With ``--stairs`` each edge e counts as the unbiased
clamp of another circle, of the radius R - (e - 1/2) L, and is compared with finite elements of that
radius. The mean over edges spread evenly from 0 to 1 is free of the chance of a single circle:

    python -m studies.clamp_edge configs/modes.toml --stairs --edges 0.1 0.3 0.5 0.7 0.9
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


def inner(scene: Scene) -> float:
    """Diameter of the circle within which the scene's clamp leaves the plate free, m."""
    assert scene.clamp is not None
    assert scene.clamp.inner_diameter is not None
    return scene.clamp.inner_diameter


def held(scene: Scene, dynamics: "Dynamics", edge: float) -> npt.NDArray[np.int32]:
    """Nodes of a scene's clamp whose circles are wider by a part of a module on both sides."""
    from taichi_ldem.solver.contact.kernels.rings import fixed_nodes

    clamp, beyond = scene.clamp, edge * scene.plate.spacing
    assert clamp is not None
    through = clamp.kind == "rim"
    outer = np.inf if through or clamp.outer_diameter is None else clamp.outer_diameter / 2
    numbers = (inner(scene) / 2 - beyond, outer + beyond, scene.plate.size[2])
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


def steepness(scene: Scene, refine: int) -> float:
    """d ln f / d ln R of the first frequency over the clamp's radius, by finite elements."""
    sides = [0.98 * inner(scene), 1.02 * inner(scene)]
    found = [reference(scene.changed(f"clamp.inner_diameter={side!r}"), refine) for side in sides]
    return float(np.log(found[1] / found[0]) / np.log(sides[1] / sides[0]))


def over_stairs(
    errors: dict[float, float], spacing_over_radius: float, exponent: float
) -> tuple[float, float]:
    """Error of the unbiased clamp, averaged over circles that differ by a part of a module.

    Args:
        errors: of the first frequency, relative to the circle of the scene, by edge in modules.
        spacing_over_radius: L / R.
        exponent: d ln f / d ln R.

    Returns:
        Mean and standard deviation of the errors, each relative to its own circle.
    """
    own = [
        (1 + error) / (1 - (edge - 0.5) * spacing_over_radius) ** exponent - 1
        for edge, error in errors.items()
    ]
    return float(np.mean(own)), float(np.std(own, ddof=1))


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
    parser.add_argument("--stairs", action="store_true", help="edges are circles; see above")
    parser.add_argument("--refine", type=int, nargs="+", default=[2, 3], help="meshes, finest last")
    parser.add_argument("--reference", type=float, metavar="HZ", help="instead of finite elements")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    options = parser.parse_args()
    base = load_scene(options.scene, options.settings)
    exact = [options.reference]
    if options.reference is None:
        exact = [reference(base, refine) for refine in options.refine]
    print(f"finite elements: {', '.join(f'{value:.2f}' for value in exact)} Hz", flush=True)
    exponent = steepness(base, options.refine[0]) if options.stairs else 0.0
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
        if options.stairs:
            found = {edge: errors[edge][n] for edge in options.edges}
            mean, scatter = over_stairs(found, 2 * scene.plate.spacing / inner(scene), exponent)
            print(f"{n} modules, unbiased: {100 * mean:+.3f} +- {100 * scatter:.3f} % a circle")
    print(table(errors, options.modules))


if __name__ == "__main__":
    main()
