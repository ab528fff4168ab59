"""The nodes that loads act on, and their shares in them; NumPy only."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import SceneError
from taichi_ldem.model import regions
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import Load
from taichi_ldem.scene.values import show

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LoadNodes:
    """The nodes of all loads, each once, and for each node the loads that act on it.

    Attributes:
        nodes: (n,) numbers, ascending, flat over (sublattices, *S).
        first: (n + 1,) the first entry of each node.
        which: (entries,) the load; a node's forces come before its prescribed motions.
        shares: (entries,) force on the node over the load's value: a share, or an area in m2.
        weights: (entries,) of the node in means over the load's region.
        areas: of the surface that a traction acts on, m2, by load; 0 for other kinds.
    """

    nodes: npt.NDArray[np.int32]
    first: npt.NDArray[np.int32]
    which: npt.NDArray[np.int32]
    shares: Floats
    weights: Floats
    areas: tuple[float, ...]

    @classmethod
    def of(cls, lattice: Lattice, masses: Floats, loads: Sequence[Load]) -> "LoadNodes":
        """The nodes of a scene's loads.

        Args:
            masses: (sublattices, *S) of the nodes, kg.

        Raises:
            SceneError: a region without a node or a surface, or a node with two motions.
        """
        numbers, which, shares, weights, areas = [], [], [], [], []
        for n, load in enumerate(loads):
            region = region_of(lattice, load, f"load[{n}]")
            area = 0.0
            weight = np.where(region, masses, 0.0)
            if load.kind == "traction":
                weight = regions.areas(lattice, region, load.face)
                area = float(weight.sum())
                if not area:
                    raise SceneError(f"{_place(load, f'load[{n}]')}: holds no surface of the plate")
            own = np.flatnonzero(weight)
            mean = weight.ravel()[own] / weight.sum()
            numbers.append(own)
            which.append(np.full(len(own), n))
            shares.append(weight.ravel()[own] if load.kind == "traction" else mean)
            weights.append(mean)
            areas.append(area)
        number, load_of = np.concatenate(numbers), np.concatenate(which)
        moved = np.array([load.prescribes for load in loads])[load_of]
        order = np.lexsort((load_of, moved, number))
        nodes, counts = np.unique(number, return_counts=True)
        _refuse_two_motions(loads, number[order], load_of[order], moved[order])
        return cls(
            nodes.astype(np.int32),
            np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
            load_of[order].astype(np.int32),
            np.concatenate(shares)[order],
            np.concatenate(weights)[order],
            tuple(areas),
        )

    @property
    def node_of(self) -> npt.NDArray[np.int64]:
        """(entries,) place of each entry's node in ``nodes``."""
        return np.repeat(np.arange(len(self.nodes)), np.diff(self.first))


def region_of(lattice: Lattice, load: Load, key: str) -> regions.Chosen:
    """The nodes of a load's region.

    Raises:
        SceneError: there are none.
    """
    if load.face is None:
        assert load.box is not None
        region = regions.in_box(lattice, load.box)
    else:
        region = regions.on_face(lattice, load.face)
        if load.inner_diameter is not None or load.outer_diameter is not None:
            inner = 0.5 * (load.inner_diameter or 0.0)
            outer = np.inf if load.outer_diameter is None else 0.5 * load.outer_diameter
            ring = regions.between_circles(lattice, load.face, load.centre, inner, outer)
            region = region & ring
    if not region.any():
        raise SceneError(f"{_place(load, key)}: holds no node of the plate")
    return region


def _place(load: Load, key: str) -> str:
    """The keys of a load's region with their values."""
    given = {n: getattr(load, n) for n in ("face", "box", "inner_diameter", "outer_diameter")}
    parts = [f"{n} = {show(value)}" for n, value in given.items() if value is not None]
    return f"{key}.{', '.join(parts)}"


def _refuse_two_motions(
    loads: Sequence[Load],
    number: npt.NDArray[np.integer[Any]],
    which: npt.NDArray[np.integer[Any]],
    moved: npt.NDArray[np.bool_],
) -> None:
    """Refuse loads that prescribe the motion of one node twice along a direction.

    Motions at right angles, of nodes that are free across them, go together.

    Raises:
        SceneError: such a node.
    """
    number, which = number[moved], which[moved]
    for apart in range(1, len(loads)):
        same = number[apart:] == number[:-apart]
        for a, b in sorted(set(zip(which[:-apart][same], which[apart:][same], strict=True))):
            held = "held" in (loads[a].lateral, loads[b].lateral)
            if held or abs(np.dot(loads[a].unit, loads[b].unit)) > 1e-9:
                raise SceneError(
                    f"load[{b}].{loads[b].kind}: load[{a}] prescribes the motion of some of its "
                    "nodes already; let their regions not overlap, or take directions at right "
                    'angles with lateral = "free"'
                )
