"""The lattice that can be stepped: its state with the kernels that act on it.

``bars`` holds pass 1 of the step, ``nodes`` pass 2, ``step`` what drives them, and ``exchange`` the
copies to and from the host. Each of them reads the fields of ``state`` and knows nothing of those
that come after it.

Numbers that a study varies (time step, stiffness, masses, law parameters) are kernel arguments or
small tables, so they never recompile anything; which features exist does.
"""

import taichi as ti

from taichi_ldem.model.cell import CENTRE, CORNER
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.model.material import Bars
from taichi_ldem.solver.access import NodeAccess
from taichi_ldem.solver.bar_forces import BarForces
from taichi_ldem.solver.bars import LatticeBars
from taichi_ldem.solver.bends import LawBends
from taichi_ldem.solver.exchange import Exchange
from taichi_ldem.solver.features import Features
from taichi_ldem.solver.nodes import NodeUpdate
from taichi_ldem.solver.parting import PartingFaces
from taichi_ldem.solver.state import State, field_apart, field_bytes, numpy_float
from taichi_ldem.solver.step import Step
from taichi_ldem.solver.tips import CrackTips
from taichi_ldem.solver.volume import ModuleVolumes

__all__ = ["CENTRE", "CORNER", "Dynamics", "Features", "field_apart", "field_bytes", "numpy_float"]


@ti.data_oriented
class Dynamics(State):
    """The fields of a lattice, its step, and what other parts of the solver need of both.

    Attributes:
        bars: forces, strains and damage of bars, for kernels.
        volumes: forces and energy of the modules' volumes, for kernels.
        nodes: forces on nodes and their integration, for kernels.
        access: single nodes, for kernels.
        driver: the step.
        exchange: copies to and from NumPy.
    """

    def __init__(
        self,
        lattice: Lattice,
        bars: Bars,
        density: float,
        features: Features,
        in_strips: bool | None = None,
        alone: bool = False,
    ):
        """Allocate all fields and fill them for a uniform material.

        Args:
            bars: stiffness and strength of the bar families.
            density: kg/m3.
            in_strips: whether the passes are driven in strips; None: as suits the backend.
            alone: whether one thread takes the step.
        """
        super().__init__(lattice, features, in_strips, alone)
        self.set_bars(bars)
        self.set_density(density)
        self.access = NodeAccess(self)
        self.bars = LatticeBars(self, self.access)
        self.tips = CrackTips(self, self.bars, self.access)
        bends = LawBends(self, self.bars, self.access)
        parting = PartingFaces(self, self.bars, self.tips)
        self.bar_forces = BarForces(self, self.bars, bends, parting)
        self.volumes = ModuleVolumes(self, self.bars)
        self.nodes = NodeUpdate(self, self.volumes)
        self.driver = Step(self, self.bar_forces, self.nodes, self.tips)
        self.exchange = Exchange(self, self.bars, self.access, self.driver)
        self._open_to_others()

    def _open_to_others(self) -> None:
        """Give the parts' functions that the rest of the solver uses a name here."""
        self.step, self.kick = self.driver.take, self.driver.kick
        self.whole_passes, self.take_alone = self.driver.whole_passes, self.driver.take_alone
        exchange, access = self.exchange, self.access
        self.set_displacement = exchange.set_displacement
        self.get_displacement = exchange.get_displacement
        self.set_velocity, self.get_velocity = exchange.set_velocity, exchange.get_velocity
        self.get_acceleration, self.get_force = exchange.get_acceleration, exchange.get_force
        self.new_broken, self.recorded_bits = exchange.new_broken, exchange.recorded_bits
        self.column_of, self.site_of = access.column_of, access.site_of
        self.node_mass, self.node_offset = access.mass, access.offset
        self.node_displacement, self.node_velocity = access.displacement, access.velocity
        self.put_node, self.add_damped = access.put, access.add_damping_loss
