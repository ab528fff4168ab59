"""Probes: mean displacements and velocities of some nodes, read at samples only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.errors import SceneError
from taichi_ldem.model import regions
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import Probe, Scene
from taichi_ldem.scene.values import show
from taichi_ldem.solver.dynamics import Dynamics, field_apart

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ProbeNodes:
    """The nodes of all probes.

    Attributes:
        nodes: (n,) numbers, flat over (sublattices, *S), those of a probe together.
        which: (n,) the probe. weights: (n,) of the node in the probe's mean.
    """

    nodes: npt.NDArray[np.int32]
    which: npt.NDArray[np.int64]
    weights: Floats

    @classmethod
    def of(cls, lattice: Lattice, masses: Floats, probes: Sequence[Probe]) -> "ProbeNodes":
        """The nodes of a scene's probes.

        Args:
            masses: (sublattices, *S) of the nodes, kg.

        Raises:
            SceneError: a probe without a node.
        """
        nodes, which, weights = [], [], []
        for n, probe in enumerate(probes):
            mass = np.where(_region(lattice, probe, n), masses, 0.0).ravel()
            own = np.flatnonzero(mass)
            nodes.append(own)
            which.append(np.full(len(own), n))
            weights.append(mass[own] / mass.sum())
        return cls(
            np.concatenate(nodes).astype(np.int32),
            np.concatenate(which),
            np.concatenate(weights),
        )


def _region(lattice: Lattice, probe: Probe, number: int) -> regions.Chosen:
    """The nodes of a probe.

    Raises:
        SceneError: there are none.
    """
    if probe.point is not None:
        return regions.nearest(lattice, probe.point)
    if probe.box is not None:
        key, value, region = "box", show(probe.box), regions.in_box(lattice, probe.box)
    else:
        assert probe.plane is not None
        assert probe.position is not None
        region = regions.near_plane(lattice, probe.plane, probe.position)
        key, value = "position", show(probe.position)
    if not region.any():
        raise SceneError(f"probe[{number}].{key} = {value}: holds no node of the plate")
    return region


@ti.data_oriented
class Probes:
    """The probes of a scene.

    Attributes:
        nodes: (n,) i32 numbers of the nodes.
        before: mean velocities half a step before a sample, m/s.
    """

    def __init__(self, dynamics: Dynamics, scene: Scene):
        self.dynamics = dynamics
        found = ProbeNodes.of(dynamics.lattice, dynamics.masses(), scene.probes)
        self.nodes = field_apart(ti.i32, len(found.nodes))
        self._take(found, scene)

    def place(self, scene: Scene) -> None:
        """Choose the nodes of another scene.

        Raises:
            ValueError: they need other fields.
        """
        found = ProbeNodes.of(self.dynamics.lattice, self.dynamics.masses(), scene.probes)
        if len(found.nodes) != self.nodes.shape[0]:
            raise ValueError(f"probes: need {len(found.nodes)} nodes, not {self.nodes.shape[0]}")
        self._take(found, scene)

    def _take(self, found: ProbeNodes, scene: Scene) -> None:
        self.found = found
        self.columns = [column for probe in scene.probes for column in probe.columns]
        self.nodes.from_numpy(found.nodes)
        self.before = np.zeros((len(scene.probes), 3))

    @ti.kernel
    def _gather(self, now: int, values: ti.types.ndarray()):
        nz, ny, nx = ti.static(self.dynamics.sites)
        for number in self.nodes:
            node = self.nodes[number]
            s, k = node // (nz * ny * nx), node // (ny * nx) % nz
            j, i = node // nx % ny, node % nx
            displacement = self.dynamics.node_displacement(now, s, k, j, i)
            velocity = self.dynamics.node_velocity(s, k, j, i)
            for axis in ti.static(range(3)):
                values[number, axis] = ti.cast(displacement[axis], ti.f64)
                values[number, 3 + axis] = ti.cast(velocity[axis], ti.f64)

    def _means(self, now: int) -> Floats:
        """(probes, 6) mean displacements and the latest mean velocities."""
        values = np.zeros((self.nodes.shape[0], 6))
        self._gather(now, values)
        weighted = self.found.weights[:, None] * values
        means = np.zeros((len(self.before), 6))
        np.add.at(means, self.found.which, weighted)
        return means

    def record(self, now: int) -> None:
        """Keep the velocities before a measured step."""
        self.before = self._means(now)[:, 3:]

    def observed(self, now: int) -> dict[str, float]:
        """Values of all columns at the start of a measured step that has been taken.

        Args:
            now: buffer of the displacement at that time.
        """
        means = self._means(now)
        means[:, 3:] = 0.5 * (self.before + means[:, 3:])
        return dict(zip(self.columns, means.ravel().tolist(), strict=True))
