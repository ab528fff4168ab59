"""Order of convergence by kind of boundary: natural frequencies compared with known ones.

    python -m studies.boundaries [--modules 2 3 4 6]

A centre node next to a face of the lattice has lost the bar that would cross the face. Strain along
the face's normal is therefore carried by fewer bars in a layer whose depth is a number of modules,
which causes an error of first order, whether the face is free or fixed. For strains without that
component the error is of second order, as in the bulk.

- *Bending stiffness* of a plate without edges for uniform curvature, exact: a cylinder or a sphere
  strains the plate along its thickness, a saddle and a twist do not (nu (k_x + k_y) = 0).
- *Thickness modes* of a plate without edges, exact: stretch and shear, faces free or fixed.
- *A cube fixed on all six faces*, which are planes of nodes: no face is free, jagged or singular.
- *A plate between square rings* whose sides are planes of nodes: as the paper's, without stairs.
"""

import itertools
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from taichi_ldem.model import material as mat
from taichi_ldem.model.cell import MODULE
from taichi_ldem.scene import Scene, Solver, parse_scene

if TYPE_CHECKING:
    from taichi_ldem.studies.finite_elements import Part

Array = npt.NDArray[np.float64]

PMMA = {"youngs_modulus": 3.35e9, "poisson_ratio": 0.25, "density": 1190.0, "damage": False}
THICKNESS, SIDE = 3.2e-3, 96e-3
INNER, OUTER = 38.4e-3, 44.8e-3
"""Half sides of the square rings, m: planes of nodes for two, three, four and six modules through
3.2 mm, as is the middle of the plate's side."""
CUBE = 3.2e-3
SHAPES = {"cylinder": (1.0, 0.0, 0.0), "sphere": (1.0, 1.0, 0.0), "saddle": (1.0, -1.0, 0.0)}
SHAPES |= {"twist": (0.0, 0.0, 1.0)}
"""Curvatures w_xx, w_yy, w_xy of a plate, up to a sign."""


# -- a plate without edges: all nodes of a layer move alike ----------------------------------------


def layer_bars(modules: int, nu: float) -> Iterator[tuple[int, int, float, Array, Array]]:
    """Bars of one column of modules of edge 1 with E = 1 that the plate repeats, faces free.

    Args:
        modules: through the thickness.

    Yields:
        layers of both ends (corner nodes from 0 to ``modules``, then centre nodes), stiffness over
        length, vector, place of its start.
    """
    stiffness = mat.axial_stiffness(1.0, nu, 1.0)
    for bar, vector in enumerate(MODULE.vectors):
        (first, _), (last, _) = MODULE.ends[bar]
        spring = stiffness[MODULE.family[bar]] / float(np.linalg.norm(vector))
        for k in range(modules + 1 - first):
            start = np.array([first, first, 2 * k + first]) / 2
            end = round(start[2] + vector[2] - last / 2)
            if 0 <= end <= modules - last:
                on_face = bar < 3 and vector[2] == 0 and k in (0, modules)
                share = 0.5 if on_face else 1.0
                layers = k + first * (modules + 1), end + last * (modules + 1)
                yield *layers, share * spring, vector, start


def bending_stiffness(modules: int, curvature: tuple[float, float, float], nu: float) -> float:
    """Stiffness of a plate without edges over the thin plate's, for uniform curvature.

    Energies per area: D/2 ((k_x + k_y)^2 - 2 (1 - nu) (k_x k_y - k_xy^2)).

    Args:
        curvature: k_x, k_y, k_xy in one unit.
    """
    kx, ky, kxy = curvature

    def thin(place: Array) -> Array:  # the energy of Kirchhoff's plate
        x, y, z = place - [0.0, 0.0, modules / 2]
        bowl = 0.5 * kx * x * x + 0.5 * ky * y * y + kxy * x * y
        return np.array([(kx * x + kxy * y) * z, (kxy * x + ky * y) * z, -bowl])

    layers = 2 * modules + 1
    matrix, load = np.zeros((3 * layers, 3 * layers)), np.zeros(3 * layers)
    energy = 0.0
    for one, two, spring, vector, start in layer_bars(modules, nu):
        along = vector / np.linalg.norm(vector)
        row = np.zeros((layers, 3))
        row[two] += along
        row[one] -= along
        given = float(along @ (thin(start + vector) - thin(start)))
        matrix += spring * np.outer(row, row)
        load += spring * given * row.ravel()
        energy += 0.5 * spring * given**2
    response = np.linalg.lstsq(matrix, -load, rcond=None)[0]  # the layers may move together
    energy += 0.5 * float(load @ response)
    form = (kx + ky) ** 2 - 2 * (1 - nu) * (kx * ky - kxy**2)
    return energy / (0.5 * modules**3 / 12 / (1 - nu**2) * form)


def thickness_frequency(modules: int, axis: int, fixed: bool, nu: float) -> float:
    """First frequency of a plate without edges whose layers move along an axis, over the solid's.

    Half a wave fits in the thickness, with both faces free or both fixed: omega = pi c / H.

    Args:
        axis: 2 is stretch, 0 is shear.
    """
    layers = 2 * modules + 1
    matrix = np.zeros((layers, layers))
    for one, two, spring, vector, _ in layer_bars(modules, nu):
        share = spring * vector[axis] ** 2 / float(vector @ vector)
        for a, b, sign in ((one, one, 1), (two, two, 1), (one, two, -1), (two, one, -1)):
            matrix[a, b] += sign * share
    mass = np.full(layers, 0.5)  # of density 1
    mass[[0, modules]] = 0.25
    free = np.setdiff1d(np.arange(layers), [0, modules]) if fixed else np.arange(layers)
    root = np.sqrt(mass[free])
    values = np.linalg.eigvalsh(matrix[np.ix_(free, free)] / np.outer(root, root))
    c11, _, c44 = mat.elastic_constants(1.0, nu)
    speed = np.sqrt(c11 if axis == 2 else c44)
    return float(np.sqrt(values[0 if fixed else 1]) / (np.pi * speed / modules))


# -- bodies with faces held ------------------------------------------------------------------------


def fixed_cube(cells: int) -> "Part":
    """Finite elements of a cube that is fixed on all faces, ``cells`` along a side of an eighth."""
    from taichi_ldem.studies import finite_elements as fe

    part = fe.free_plate((CUBE, CUBE, CUBE), (cells, cells, cells))
    return fe.Part(part.mesh, part.half, None, on_cube)


def square_rings(refine: int) -> "Part":
    """Finite elements of the plate between square rings; ``refine``: 1, 2, ... per side."""
    from skfem import MeshHex, MeshHex2

    from taichi_ldem.studies import finite_elements as fe

    inside = INNER * fe.graded(5 * refine, 1 / fe.GRADING)
    under = INNER + (OUTER - INNER) * fe.graded(refine + 1, fe.GRADING)[1:]
    flat = np.concatenate([inside, under, [SIDE / 2]])
    thick = THICKNESS / 2 * fe.graded(refine + 1, 1 / fe.GRADING)
    mesh = MeshHex2.from_mesh(MeshHex.init_tensor(flat, flat, thick))

    def held(places: Array) -> npt.NDArray[np.bool_]:
        return on_square_rings(places + np.array([[0.0], [0.0], [THICKNESS / 2]]))

    return fe.Part(mesh, (SIDE / 2, SIDE / 2, THICKNESS / 2), None, held)


def on_cube(places: Array) -> npt.NDArray[np.bool_]:
    """Whether places (3, n), m from its middle, lie on a face of the cube."""
    held: npt.NDArray[np.bool_] = np.abs(places).max(axis=0) > CUBE / 2 * (1 - 1e-6)
    return held


def on_square_rings(places: Array) -> npt.NDArray[np.bool_]:
    """Whether places (3, n), m, lie under the rings on either face of the plate."""
    face = np.abs(places[2] - THICKNESS / 2) > THICKNESS / 2 * (1 - 1e-6)
    along = np.abs(places[:2]).max(axis=0)
    held: npt.NDArray[np.bool_] = face & (along > INNER * (1 - 1e-6)) & (along < OUTER * (1 + 1e-6))
    return held


def scene_of(size: tuple[float, float, float], modules: int) -> Scene:
    """The free body on the lattice."""
    plate = {"size": size, "modules_through_thickness": modules}
    return parse_scene({"scenario": "modes", "plate": plate, "material": PMMA})


def lowest_frequency(
    scene: Scene, held: Callable[[Array], npt.NDArray[np.bool_]], below: float = 0.0
) -> float:
    """Lowest frequency of a scene's body with some nodes fixed, Hz; Taichi must have been started.

    Args:
        held: which places (3, n), m, are fixed. below: where the plate's lower face is for it, m.
    """
    from taichi_ldem.scenarios.modes import build
    from taichi_ldem.solver import eigen

    dynamics, _ = build(scene)
    places = dynamics.lattice.positions().reshape(-1, 3).T + np.array([[0.0], [0.0], [below]])
    fixed = np.flatnonzero(held(places) & dynamics.lattice.exists().ravel())
    return float(eigen.lowest(eigen.TangentOperator(dynamics, fixed), 1).frequencies[0])


def cube_errors(modules: Sequence[int]) -> tuple[dict[int, float], float]:
    """Relative errors of the cube's lowest frequency by size, and its finite elements' own."""
    rough, exact = (_reference(fixed_cube(cells)) for cells in (4, 6))
    size = (CUBE, CUBE, CUBE)
    found = {n: lowest_frequency(scene_of(size, n), on_cube, -CUBE / 2) for n in modules}
    return {n: value / exact - 1 for n, value in found.items()}, rough / exact - 1


def ring_errors(modules: Sequence[int]) -> tuple[dict[int, float], float]:
    """Relative errors of the plate's lowest frequency by size, and its finite elements' own."""
    rough, exact = (_reference(square_rings(refine)) for refine in (2, 3))
    size = (SIDE, SIDE, THICKNESS)
    found = {n: lowest_frequency(scene_of(size, n), on_square_rings) for n in modules}
    return {n: value / exact - 1 for n, value in found.items()}, rough / exact - 1


def _reference(part: "Part") -> float:
    from taichi_ldem.studies import finite_elements as fe

    e, nu, density = (PMMA[key] for key in ("youngs_modulus", "poisson_ratio", "density"))
    constants = mat.elastic_constants(float(e), float(nu))
    found, _, _ = fe.frequencies(part, constants, float(density), fe.BENDING["SS"], 1)
    return float(found[0])


def table(name: str, errors: dict[int, float], mesh: float | None) -> str:
    """A Markdown row: errors in percent and the order between neighbouring sizes."""
    sizes = sorted(errors)
    orders = [
        f"{np.log(errors[a] / errors[b]) / np.log(b / a):.2f}"
        for a, b in itertools.pairwise(sizes)
        if errors[a] * errors[b] > 0
    ]
    cells = [", ".join(f"{n}: {100 * errors[n]:+.3f}" for n in sizes), ", ".join(orders)]
    cells.append("exact" if mesh is None else f"{100 * mesh:+.3f}")
    return f"| {name} | " + " | ".join(cells) + " |"


def main() -> None:
    """Print all tables."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--modules", type=int, nargs="+", default=[2, 3, 4, 6])
    parser.add_argument("--cube", type=int, nargs="+", default=[4, 6, 8, 12])
    options = parser.parse_args()
    from taichi_ldem.solver import backend

    backend.start(Solver(duration=1.0))
    print("| what | modules: error [%] | order | change of the reference [%] |")
    print("|---|---|---|---|")
    for name, curvature in SHAPES.items():
        off = {n: bending_stiffness(n, curvature, 0.25) - 1 for n in (3, 4, 6, 8, 12, 24)}
        print(table(f"bending stiffness, {name}", off, None), flush=True)
    for name, axis in (("stretch", 2), ("shear", 0)):
        for fixed in (False, True):
            off = {n: thickness_frequency(n, axis, fixed, 0.25) - 1 for n in (3, 4, 6, 8, 12, 24)}
            kind = "fixed" if fixed else "free"
            print(table(f"thickness {name}, faces {kind}", off, None), flush=True)
    print(table("cube, all faces fixed", *cube_errors(options.cube)), flush=True)
    print(table("plate between square rings", *ring_errors(options.modules)), flush=True)


if __name__ == "__main__":
    main()
