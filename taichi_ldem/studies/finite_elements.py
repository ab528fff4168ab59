"""Natural frequencies of a plate by three-dimensional finite elements, to verify the lattice.

Triquadratic hexahedra with 27 nodes and consistent mass (scikit-fem), an eighth of the plate with
the symmetries on its three planes. The mesh of a clamped plate follows both circles, so the clamp
is exact where the lattice's is a staircase. The solid is cubic (C11, C12, C44), isotropic for nu =
0.25 with Eq. (2).

    python -m taichi_ldem.studies.finite_elements configs/modes.toml [--refine 2] [--count 12]
"""

import math
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.analysis import modeshapes
from taichi_ldem.analysis.modeshapes import Name
from taichi_ldem.errors import SceneError
from taichi_ldem.model import material
from taichi_ldem.scene import Scene, load_scene

Array = npt.NDArray[np.float64]

CORE = 0.45
"""Radius of the mesh's square core over the inner radius."""

SQUARENESS = 0.5, 0.8
"""Share of the square in the core's outline, and half its side over the core's radius."""

GRADING = 10.0
"""Ratio of the largest to the smallest element side towards the clamp's inner edge, where stress is
singular, along the radius and through the thickness."""

QUADRATURE = 6
"""Degree that is integrated exactly in each direction: four points."""


@dataclass(frozen=True)
class Part:
    """An eighth of a plate.

    Attributes:
        mesh: scikit-fem mesh with quadratic geometry, z from the mid-plane to a face.
        half: sides x, y of the quarter and half the thickness, m.
        circles: radii between which the face is fixed, m; None without rings.
        fixed: (n,) whether places (3, n), m, are fixed otherwise; None: none is.
    """

    mesh: Any
    half: tuple[float, float, float]
    circles: tuple[float, float] | None
    fixed: Callable[[Array], npt.NDArray[np.bool_]] | None = None


# -- meshes
# ------------------------------------------------------------------------------------------


def free_plate(size: Sequence[float], cells: tuple[int, int, int]) -> Part:
    """A free rectangular plate, in ``cells`` elements of an eighth."""
    from skfem import MeshHex, MeshHex2

    half = (size[0] / 2, size[1] / 2, size[2] / 2)
    lines = [np.linspace(0, side, n + 1) for side, n in zip(half, cells, strict=True)]
    return Part(MeshHex2.from_mesh(MeshHex.init_tensor(*lines)), half, None)


def clamped_plate(size: Sequence[float], inner: float, outer: float, refine: int) -> Part:
    """A square plate fixed on its faces between two circles.

    Args:
        inner, outer: radii, m. refine: 1, 2, ...: elements per side.
    """
    half = (size[0] / 2, size[1] / 2, size[2] / 2)
    rings = (5 * refine, 3 * refine, refine + 1)
    radii = _ring_radii(inner, outer, rings)
    mesh = _round(half, radii, sum(rings), refine)
    return Part(mesh, half, (inner, outer))


def clamped_disc(radius: float, thickness: float, refine: int) -> Part:
    """A disc fixed at its rim, through its whole thickness; m."""
    half = (radius, radius, thickness / 2)
    count = 5 * refine
    radii = CORE * radius + (1 - CORE) * radius * graded(count, 1 / GRADING)
    mesh = _round(half, radii, count, refine)

    def rim(places: Array) -> npt.NDArray[np.bool_]:
        held: npt.NDArray[np.bool_] = np.hypot(places[0], places[1]) > radius * (1 - 1e-6)
        return held

    return Part(mesh, half, (radius, radius), rim)


def _round(half: tuple[float, float, float], radii: Array, levels: int, refine: int) -> Any:
    """Mesh of an eighth whose elements follow circles of some radii, and a square beyond them.

    Stress is singular at the clamp only: most elements stand along the radius.

    Args:
        levels: of elements around the core, those beyond the circles included.
    """
    from skfem import MeshHex2, MeshQuad

    count = 2 * refine + 1
    line = np.linspace(0, 1, count + 1)
    core = MeshQuad.init_tensor(line, line)
    # in the plane of the parameters: squares around the core, cut along the diagonal
    wedge = MeshQuad.init_tensor(1 + np.arange(levels + 1.0), line)
    right = MeshQuad(np.stack([wedge.p[0], wedge.p[0] * wedge.p[1]]), wedge.t)
    above = MeshQuad(right.p[::-1].copy(), right.t[::-1].copy())
    flat = (core + right + above).with_boundaries({})
    mesh = MeshHex2.from_mesh(_extrude(flat, graded(2 * refine, 1 / GRADING)))
    places = np.array(mesh.doflocs)
    x, y = _to_plate(places[0], places[1], radii, len(radii) - 1, half[0])
    return MeshHex2(np.stack([x, y, half[2] * places[2]]), mesh.t)


def _extrude(flat: Any, heights: Array) -> Any:
    from skfem import MeshHex

    n = flat.p.shape[1]
    points = np.concatenate([np.vstack([flat.p, np.full(n, z)]) for z in heights], axis=1)
    # scikit-fem's hexahedron: vertices in the order of 111, 110, 101, 011, 100, 010, 001, 000
    cells = []
    for layer in range(len(heights) - 1):
        a, b, c, d = flat.t + layer * n  # around the quadrilateral
        low, high = (a, b, c, d), (a + n, b + n, c + n, d + n)
        cells.append(np.stack([high[2], low[2], high[1], high[3], low[1], low[3], high[0], low[0]]))
    return MeshHex(points, np.concatenate(cells, axis=1))


def _ring_radii(inner: float, outer: float, rings: tuple[int, int, int]) -> Array:
    """Radii of the mesh's circles, m, from the core to the outer one, finest at the inner."""
    first = CORE * inner + (1 - CORE) * inner * graded(rings[0], 1 / GRADING)[1:]
    second = inner + (outer - inner) * graded(rings[1], GRADING)[1:]
    return np.concatenate([[CORE * inner], first, second])


def graded(count: int, ratio: float) -> Array:
    """Places from 0 to 1 of ``count`` intervals, the last ``ratio`` times as long as the first."""
    steps = np.geomspace(1.0, ratio, count)
    return np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])


def _to_plate(x: Array, y: Array, radii: Array, last: int, half: float) -> tuple[Array, Array]:
    """Places in the quarter plate of points in the plane of the parameters.

    A square of half side 1 is the core; those of 2 to 1 + last become circles, those beyond go
    over into the plate's edge.
    """
    m = np.maximum(x, y)
    share = np.divide(np.minimum(x, y), m, out=np.zeros_like(m), where=m > 0)
    angle = math.pi / 4 * share
    end = max(m.max(), 2.0 + last)  # beyond the mesh where nothing is outside the circles
    rho = np.where(m < 1, m * radii[0], np.interp(m - 1, np.arange(last + 1), radii))
    square = SQUARENESS[0] * np.clip(2 - m, 0, 1)
    along = rho * (square * SQUARENESS[1] + (1 - square) * np.cos(angle))
    across = rho * (square * SQUARENESS[1] * share + (1 - square) * np.sin(angle))
    out = np.clip((m - 1 - last) / (end - 1 - last), 0, 1)
    along = (1 - out) * along + out * half
    across = (1 - out) * across + out * half * np.tan(angle)
    turned = y > x
    return np.where(turned, across, along), np.where(turned, along, across)


# -- eigenvalues
# ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Symmetry:
    """Whether motion is mirrored (True) or reversed (False) by the planes x = 0, y = 0, z = 0."""

    mirrored: tuple[bool, bool, bool]


def matrices(part: Part, constants: tuple[float, float, float], density: float) -> Any:
    """Stiffness, consistent mass and basis.

    Args:
        constants: C11, C12, C44, Pa. density: kg/m3.
    """
    from skfem import Basis, BilinearForm, ElementHex2, ElementVector
    from skfem.helpers import ddot, dot, sym_grad, trace

    c11, c12, c44 = constants
    basis = Basis(part.mesh, ElementVector(ElementHex2()), intorder=QUADRATURE)

    @BilinearForm
    def stiffness(u: Any, v: Any, _: Any) -> Any:
        e, d = sym_grad(u), sym_grad(v)
        axial = sum(e[i, i] * d[i, i] for i in range(3))
        return c12 * trace(e) * trace(d) + 2 * c44 * ddot(e, d) + (c11 - c12 - 2 * c44) * axial

    @BilinearForm
    def mass(u: Any, v: Any, _: Any) -> Any:
        return density * dot(u, v)

    return stiffness.assemble(basis), mass.assemble(basis), basis


def fixed_freedoms(part: Part, basis: Any, symmetry: Symmetry) -> npt.NDArray[np.bool_]:
    """Degrees of freedom that the clamp or a plane of symmetry holds."""
    places = basis.doflocs
    component = np.empty(places.shape[1], dtype=int)
    for axis in range(3):
        component[_component(basis, axis)] = axis
    slack = 1e-9 * part.half[0]
    held = np.zeros(places.shape[1], dtype=bool)
    for axis, mirrored in enumerate(symmetry.mirrored):
        on = np.abs(places[axis]) < slack
        held |= on & ((component == axis) == mirrored)
    if part.circles is not None:
        radius = np.hypot(places[0], places[1])
        inner, outer = part.circles
        face = np.abs(places[2] - part.half[2]) < slack
        held |= face & (radius > inner - 1e-6 * inner) & (radius < outer + 1e-6 * outer)
    if part.fixed is not None:
        held |= part.fixed(places)
    return held


def _component(basis: Any, axis: int) -> Any:
    """Numbers of the degrees of freedom of one component of the displacement."""
    dofs = basis.dofs
    parts = [dofs.nodal_dofs, dofs.edge_dofs, dofs.facet_dofs, dofs.interior_dofs]
    return np.concatenate([part[axis::3].ravel() for part in parts])


def frequencies(
    part: Part,
    constants: tuple[float, float, float],
    density: float,
    symmetry: Symmetry,
    count: int,
    system: Any = None,
) -> tuple[Array, Array, Any]:
    """Lowest frequencies (Hz) with a symmetry, their vectors over all freedoms, and the basis.

    Args:
        system: result of ``matrices``; None: it is computed.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh, splu

    k, m, basis = matrices(part, constants, density) if system is None else system
    free = np.flatnonzero(~fixed_freedoms(part, basis, symmetry))
    k, m = k[free][:, free].tocsc(), m[free][:, free].tocsc()
    # a free plate has rigid motions: shift by far less than a frequency
    shift = -1e-6 * constants[0] / density / max(part.half) ** 2
    factor = splu(
        (k - shift * m).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    inverse = LinearOperator(k.shape, matvec=factor.solve, dtype=np.float64)
    values, vectors = eigsh(k, count, m, sigma=shift, OPinv=inverse)
    whole = np.zeros((basis.N, count))
    whole[free] = vectors
    return np.sqrt(np.maximum(values, 0)) / (2 * math.pi), whole, basis


BENDING = {
    "SS": Symmetry((True, True, False)),
    "SA": Symmetry((True, False, False)),
    "AA": Symmetry((False, False, False)),
}
"""Motions reversed by the mid-plane. SA represents AS too, which has the same frequencies."""

IN_PLANE = {
    "SS": Symmetry((True, True, True)),
    "SA": Symmetry((True, False, True)),
    "AA": Symmetry((False, False, True)),
}


def plate_modes(
    part: Part,
    constants: tuple[float, float, float],
    density: float,
    count: int,
    bending: bool = True,
) -> list[tuple[float, Name]]:
    """Frequencies (Hz) and names of a plate's modes, ascending, ``count`` of each symmetry.

    Modes of SA appear twice, as they occur in pairs.
    """
    system = matrices(part, constants, density)
    found: list[tuple[float, Name]] = []
    for name, symmetry in (BENDING if bending else IN_PLANE).items():
        values, vectors, basis = frequencies(part, constants, density, symmetry, count, system)
        for value, vector in zip(values, vectors.T, strict=True):
            what = name_mode(part, basis, vector, symmetry) if bending else Name("in-plane")
            found += [(float(value), what)] * (2 if name == "SA" else 1)
    return sorted(found, key=lambda item: item[0])


def name_mode(part: Part, basis: Any, vector: Array, symmetry: Symmetry) -> Name:
    """Name of a bending mode from its deflection of the mid-plane."""
    from scipy.interpolate import griddata

    if part.circles is None:
        return Name("other")
    dofs = _component(basis, 2)
    places = basis.doflocs[:, dofs]
    at = np.abs(places[2]) < 1e-9 * part.half[0]
    w = vector[dofs][at]
    x, y = places[0][at], places[1][at]
    beyond = np.abs(w[np.hypot(x, y) > part.circles[1]])
    if beyond.max(initial=0.0) > np.abs(w).max() / 2:
        return Name("outside")
    line = np.linspace(0, part.circles[0], 61)
    quarter = griddata((x, y), w, tuple(np.meshgrid(line, line)), method="linear", fill_value=0.0)
    signs = [1 if mirrored else -1 for mirrored in symmetry.mirrored[:2]]
    right = np.concatenate([signs[1] * quarter[:0:-1], quarter])
    whole = np.concatenate([signs[0] * right[:, :0:-1], right], axis=1)
    full = np.concatenate([-line[:0:-1], line])
    return Name("plate", *modeshapes.nodal_lines(full, full, whole, part.circles[0]))


def scene_constants(scene: Scene) -> tuple[float, float, float]:
    """C11, C12, C44 of a scene's lattice, Pa."""
    m = scene.material
    return material.elastic_constants(m.youngs_modulus, m.poisson_ratio, scene.plate.stiffness)


def scene_part(scene: Scene, refine: int) -> Part:
    """The mesh of a scene's plate: held by bonded rings or at its rim, or free.

    Raises:
        SceneError: a plate that is not square.
    """
    size, clamp = scene.plate.actual_size, scene.clamp
    if scene.plate.shape != "rectangle" or not math.isclose(size[0], size[1]):
        raise SceneError(f"plate.size = {list(size)}: the mesh is for square plates")
    if clamp is None or not scene.held:
        thickness = refine + 1
        n = [max(2, round(2 * refine * side / size[2] / 2)) for side in size[:2]]
        return free_plate(size, (n[0], n[1], thickness))
    assert clamp.inner_diameter is not None
    if clamp.kind == "rim":
        return clamped_disc(clamp.inner_diameter / 2, size[2], refine)
    assert clamp.outer_diameter is not None
    return clamped_plate(size, clamp.inner_diameter / 2, clamp.outer_diameter / 2, refine)


def main() -> None:
    """Print the modes of a scene's plate."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--refine", type=int, default=2, help="elements per side of the mesh")
    parser.add_argument("--count", type=int, default=12, help="modes of each symmetry")
    parser.add_argument("--in-plane", action="store_true", help="modes in the plane instead")
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    options = parser.parse_args()
    scene = load_scene(options.scene, options.settings)
    part = scene_part(scene, options.refine)
    found = plate_modes(
        part, scene_constants(scene), scene.material.density, options.count, not options.in_plane
    )
    print(f"{part.mesh.t.shape[1]} elements, {3 * part.mesh.doflocs.shape[1]} degrees of freedom")
    for frequency, name in found:
        print(f"{1e-3 * frequency:9.4f} kHz  {name}")


if __name__ == "__main__":
    main()
