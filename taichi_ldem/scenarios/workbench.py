"""Where runs get their simulations: a new one each, or one that a process keeps for all its runs.

Building a simulation means to start Taichi and to load or compile its kernels, which takes as long
as thousands of steps of a small plate. A process that makes many runs (a member of an ensemble
after the other) therefore keeps its simulation and puts it back to t = 0 with the numbers of the
next scene.
"""

from typing import TYPE_CHECKING

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene
from taichi_ldem.solver import backend
from taichi_ldem.solver.memory import refuse_too_large

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


class NeedsOtherKernels(Exception):
    """A scene cannot be run in this process, which has kept the simulation of another one."""


class Workbench:
    """Builds the simulations of this process.

    Attributes:
        keeps: whether a simulation is kept for the next run.
    """

    def __init__(self) -> None:
        self.keeps = False
        self._kept: Simulation | None = None

    def build(self, scene: Scene) -> "Simulation":
        """A simulation of a scene at t = 0, with its kernels compiled.

        Raises:
            SceneError: the scene is refused.
            NeedsOtherKernels: a simulation has been kept that cannot be that of this scene.
        """
        if self._kept is not None:
            try:
                self._kept.reset(scene)
            except SceneError:
                raise
            except ValueError as error:
                raise NeedsOtherKernels(str(error)) from None
            return self._kept
        refuse_too_large(scene)
        backend.start(scene.solver)
        from taichi_ldem.solver.simulation import Simulation

        simulation = Simulation(scene)
        simulation.compile()
        if self.keeps:
            self._kept = simulation
        return simulation


WORKBENCH = Workbench()
"""The workbench of this process."""
