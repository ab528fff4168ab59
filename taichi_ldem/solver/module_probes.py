"""Mean strains and stresses of the modules of probes.

Only the modules in the probe's box are looked at, so that a probe costs little in a large plate.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.analysis.strain import module_volumes
from taichi_ldem.model import regions
from taichi_ldem.model.lattice import Part
from taichi_ldem.scene import Probe
from taichi_ldem.scene.loads import OF_NODES
from taichi_ldem.solver.dynamics import Dynamics
from taichi_ldem.solver.module_fields import ModuleFields
from taichi_ldem.solver.probe_regions import region_of
from taichi_ldem.solver.readings import BarReadings
from taichi_ldem.storage.fields import hexahedral_mesh

Floats = npt.NDArray[np.float64]


@ti.data_oriented
class PartReadings:
    """Reads the nodes and bars in parts of a lattice, for all probes.

    Attributes:
        bars: readings of the bars.
    """

    def __init__(self, dynamics: Dynamics):
        self.dynamics, self.bars = dynamics, BarReadings(dynamics)

    @ti.kernel
    def _copy(self, now: int, z: int, y: int, x: int, values: ti.types.ndarray()):
        shape = (values.shape[1], values.shape[2], values.shape[3])
        for k, j, i in ti.ndrange(*[(1, n - 1) for n in shape]):
            for s in ti.static(range(self.dynamics.cell.sublattices)):
                moved = self.dynamics.node_displacement(now, s, z + k, y + j, x + i)
                for axis in ti.static(range(3)):
                    values[s, k, j, i, axis] = ti.cast(moved[axis], ti.f64)

    def displacement(self, now: int, part: Part) -> Floats:
        """(sublattices, *S, 3) of a part's nodes, m; zero at its ghosts.

        Args:
            now: buffer of the displacement.
        """
        values = np.zeros((part.cell.sublattices, *part.sites, 3))
        self._copy(now, *part.first, values)
        return values


class ProbeModules:
    """The modules of one probe.

    Attributes:
        weights: (n,) share of the volume of all, in the order of the mask's sites.
    """

    def __init__(self, readings: PartReadings, chosen: npt.NDArray[np.bool_], names: Sequence[str]):
        """Find the box around some modules.

        Args:
            chosen: (nz, ny, nx) True for the modules. names: of the quantities.
        """
        dynamics = readings.dynamics
        self.readings, self.part = readings, Part.around(dynamics.lattice, chosen)
        part = self.part
        _, cells, sites = hexahedral_mesh(part.mask, part.spacing, part.origin)
        self.corners = tuple((sites + 1).T)
        points = part.positions()[0][self.corners]
        self.fields = ModuleFields(dynamics, names, points, cells, part, readings.bars)
        box = zip(part.first, part.mask.shape, strict=True)
        self.own = chosen[tuple(slice(n, n + count) for n, count in box)][part.mask]
        volume = module_volumes(points, cells)[self.own]
        self.weights = volume / volume.sum()

    def means(self, now: int) -> dict[str, Floats]:
        """(6,) the mean of each quantity.

        Args:
            now: buffer of the displacement.
        """
        moved = self.readings.displacement(now, self.part)
        found = self.fields.at_sample(now, moved, moved[0][self.corners])
        return {name: self.weights @ values[self.own] for name, values in found.items()}


def modules_of(readings: PartReadings, probes: Sequence[Probe]) -> dict[int, ProbeModules]:
    """The modules of the probes that record something of them, by the number of the probe.

    Raises:
        SceneError: a probe without a module.
    """
    places = regions.Modules(readings.dynamics.lattice)
    found = {}
    for number, probe in enumerate(probes):
        names = [quantity for quantity in probe.quantities if quantity not in OF_NODES]
        if names:
            chosen = region_of(places, probe, number, "centre of a module")
            found[number] = ProbeModules(readings, chosen, names)
    return found
