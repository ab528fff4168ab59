"""Probes: mean motions of some nodes, and mean strains and stresses of modules, at samples only."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import Probe, Scene
from taichi_ldem.scene.loads import OF_NODES
from taichi_ldem.solver.dynamics import Dynamics, field_apart
from taichi_ldem.solver.probe_regions import region_of

if TYPE_CHECKING:
    from taichi_ldem.solver.module_probes import ProbeModules

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
        """The nodes of a scene's probes that record a motion.

        Args:
            masses: (sublattices, *S) of the nodes, kg.

        Raises:
            SceneError: a probe without a node.
        """
        nodes, which, weights = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
        for n, probe in enumerate(probes):
            if {*probe.quantities}.isdisjoint(OF_NODES):
                continue
            mass = np.where(region_of(lattice, probe, n, "node"), masses, 0.0).ravel()
            own = np.flatnonzero(mass)
            nodes.append(own)
            which.append(np.full(len(own), n))
            weights.append(mass[own] / mass.sum())
        return cls(
            np.concatenate(nodes).astype(np.int32),
            np.concatenate(which),
            np.concatenate(weights),
        )


@ti.data_oriented
class Motions:
    """Mean displacements and velocities of the nodes of probes.

    Attributes:
        nodes: (n,) i32 numbers of the nodes.
        before: (probes, 3) mean velocities half a step before a sample, m/s.
    """

    def __init__(self, dynamics: Dynamics, found: ProbeNodes):
        self.dynamics = dynamics
        self.nodes = field_apart(ti.i32, len(found.nodes))
        self.take(found)

    def take(self, found: ProbeNodes) -> None:
        """Choose the nodes.

        Raises:
            ValueError: they need other fields.
        """
        if len(found.nodes) != self.nodes.shape[0]:
            raise ValueError(f"probes: need {len(found.nodes)} nodes, not {self.nodes.shape[0]}")
        self.found = found
        self.nodes.from_numpy(found.nodes)
        self.before = np.zeros((1 + found.which.max(), 3))

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

    def means(self, now: int) -> Floats:
        """(probes, 6) mean displacements and velocities at a sample."""
        means = self._means(now)
        means[:, 3:] = 0.5 * (self.before + means[:, 3:])
        return means


class Probes:
    """The probes of a scene.

    Attributes:
        motions: of the nodes; None where no probe records a motion.
        modules: of the probes that record strain or stress, by the number of the probe.
        parts: readings of these modules; None where no probe has needed them.
    """

    def __init__(self, dynamics: Dynamics, scene: Scene):
        self.dynamics = dynamics
        self.parts: Any = None
        found = self._nodes(scene)
        self.motions = Motions(dynamics, found) if len(found.nodes) else None
        self._take(scene)

    def _nodes(self, scene: Scene) -> ProbeNodes:
        return ProbeNodes.of(self.dynamics.lattice, self.dynamics.masses(), scene.probes)

    def place(self, scene: Scene) -> None:
        """Choose the nodes and the modules of another scene.

        Raises:
            ValueError: they need other fields.
        """
        found = self._nodes(scene)
        if (len(found.nodes) > 0) != (self.motions is not None):
            raise ValueError("probes: no motions can be added or taken away")
        if self.motions is not None:
            self.motions.take(found)
        self._take(scene)

    def _take(self, scene: Scene) -> None:
        self.probes = scene.probes
        self.modules: dict[int, ProbeModules] = {}
        if any({*probe.quantities} - {*OF_NODES} for probe in scene.probes):
            from taichi_ldem.solver.module_probes import PartReadings, modules_of

            if self.parts is None:
                self.parts = PartReadings(self.dynamics)
            self.modules = modules_of(self.parts, scene.probes)

    def counts(self, number: int) -> tuple[int, int]:
        """Numbers of the nodes and of the modules of a probe."""
        motions, modules = self.motions, self.modules.get(number)
        nodes = 0 if motions is None else int(np.count_nonzero(motions.found.which == number))
        return nodes, 0 if modules is None else len(modules.weights)

    def record(self, now: int) -> None:
        """Keep the velocities before a measured step."""
        if self.motions is not None:
            self.motions.record(now)

    def observed(self, now: int) -> dict[str, float]:
        """Values of all columns at the start of a measured step that has been taken.

        Args:
            now: buffer of the displacement at that time.
        """
        moved = np.zeros((0, 6)) if self.motions is None else self.motions.means(now)
        found: dict[str, float] = {}
        for n, probe in enumerate(self.probes):
            means = {} if n not in self.modules else self.modules[n].means(now)
            if not {*probe.quantities}.isdisjoint(OF_NODES):
                means |= {"displacement": moved[n, :3], "velocity": moved[n, 3:]}
            for quantity, values in means.items():
                columns = probe.columns_of(quantity)
                found |= dict(zip(columns, values.tolist(), strict=bool(columns)))
        return found
