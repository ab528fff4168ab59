"""Notches that open during a run.

At the first step that begins at a notch's time or later, its bars are removed, those excepted that
have failed by then. The energy that they held, and what they had dissipated, leaves the sums of the
lattice and is booked as energy that notches took: ``Ledger.opened``, ``notch_j`` in the history.
What modules with an energy of their volume lose is booked as fracture, as whenever they lose a bar.
"""

import math
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.scene import Scene
from taichi_ldem.solver.build import notch_cuts
from taichi_ldem.solver.dynamics import Dynamics
from taichi_ldem.solver.energy import FRACTURE, STRAIN, EnergySums

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


class Openings:
    """The notches of a scene that open after the start, together where they have one time.

    Attributes:
        times: of the openings, in rising order, s.
        cuts: bars that each removes, one bit a bar.
        taken: energy that each took, J.
        done: number of openings so far.
    """

    name = "openings"

    def __init__(self, dynamics: Dynamics, energies: EnergySums, scene: Scene):
        self.dynamics, self.energies = dynamics, energies
        self.times = sorted({notch.opens_at for notch in scene.notch if notch.opens_at > 0})
        self.cuts: list[npt.NDArray[np.uint16]] = []
        if self.times:
            cuts = list(notch_cuts(scene, dynamics.lattice))
            for time in self.times:
                together = [
                    cut
                    for notch, cut in zip(scene.notch, cuts, strict=True)
                    if notch.opens_at == time
                ]
                self.cuts.append(np.bitwise_or.reduce(together))
        self.taken = np.zeros(len(self.times))
        self.done = 0

    @property
    def energy(self) -> float:
        """Energy that notches have taken so far, J."""
        return float(self.taken.sum())

    def steps_until(self, simulation: "Simulation") -> int:
        """Steps that can be taken before the next opening; 0 or less where it is due."""
        if self.done == len(self.times):
            return sys.maxsize
        at = math.ceil(self.times[self.done] / simulation.time_step * (1 - 1e-12))
        return at - simulation.step_number

    def open_due(self, simulation: "Simulation") -> bool:
        """Open the notches whose time has come before a step; whether there are any."""
        before = self.done
        while self.steps_until(simulation) <= 0:
            self._open(simulation.now)
        return self.done > before

    def _open(self, now: int) -> None:
        """Open the next notches at the displacement ``now``."""
        before = self._held(now)
        self._cut(self.done)
        self.taken[self.done] = before - self._held(now)
        self.done += 1

    def _held(self, now: int) -> float:
        self.energies.potential(now)
        total = self.energies.total()
        return float(total[STRAIN] + total[FRACTURE])

    def _cut(self, number: int) -> None:
        self.dynamics.remove(self.cuts[number] & ~self.dynamics.failed_bits())

    def saved_state(self) -> dict[str, npt.NDArray[Any]]:
        """How many openings there were, and the energy that each took."""
        return {"taken": self.taken.copy(), "done": np.array(self.done)}

    def restore_state(self, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Continue from ``saved_state``, after the lattice has been restored.

        A bar that failed before its notch opened has failed still, and one that was removed has not
        failed since: the same bars are removed as before.
        """
        self.taken, self.done = saved["taken"].copy(), int(saved["done"])
        if not 0 <= self.done <= len(self.times):
            raise ValueError("'openings' are not of this scene")
        for number in range(self.done):
            self._cut(number)
