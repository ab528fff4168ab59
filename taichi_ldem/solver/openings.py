"""Notches that open during a run.

At the first step that begins at a notch's time or later, its bars are removed, those excepted that
have failed by then. The energy that they held, and what they had dissipated, leaves the sums of the
lattice and is booked as energy that notches took: ``Ledger.opened``, ``notch_j`` in the history.
What modules with an energy of their volume lose is booked as fracture, as whenever they lose a bar.
"""

import math
import sys
from collections.abc import Mapping, Sequence
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
        at_start: the field of removed bars at the start; only where notches open.
        taken: energy that each took, J.
        done: number of openings so far.
    """

    name = "openings"

    def __init__(self, dynamics: Dynamics, energies: EnergySums, scene: Scene):
        self.dynamics, self.energies = dynamics, energies
        self.times = sorted({notch.opens_at for notch in scene.notch if notch.opens_at > 0})
        self.cuts: list[npt.NDArray[np.uint16]] = []
        if self.times:
            self.at_start = dynamics.removed.to_numpy()
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
            self._open(simulation.now, simulation.time_step)
        return self.done > before

    def _open(self, now: int, time_step: float) -> None:
        """Open the next notches at the displacement ``now``.

        Half of this step's kick belongs to the kinetic energy of a sample at its start, and the
        bars take no part in it. So they lose their energy V less what their forces would have done
        in half a step, V(u) - h V'(u), where h is half a step's way.
        """
        dynamics = self.dynamics
        place, velocity = np.zeros((2, dynamics.cell.sublattices, *dynamics.sites, 3))
        dynamics.get_displacement(now, place)
        dynamics.get_velocity(velocity)
        places = [place + share * time_step * velocity for share in (-0.5, 0.5)] + [place]
        before = self._held(now, places)
        self._cut(self.done)
        behind, ahead, here = before - self._held(now, places)
        self.taken[self.done] = here - 0.5 * (ahead - behind)
        self.done += 1

    def _held(self, now: int, places: Sequence[npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
        """Energy of all bars at some displacements, J; the last one stays."""
        found = []
        for place in places:
            self.dynamics.set_displacement(now, place)
            self.energies.potential(now)
            total = self.energies.total()
            found.append(total[STRAIN] + total[FRACTURE])
        return np.array(found)

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
        self.dynamics.removed.from_numpy(self.at_start)
        for number in range(self.done):
            self._cut(number)
