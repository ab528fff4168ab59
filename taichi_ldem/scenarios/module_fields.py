"""Strain, stress and damage of the modules, as a run stores them where its scene asks for them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from taichi_ldem.analysis.strain import green_strain, mean_gradient, module_volumes, swelling
from taichi_ldem.analysis.stress import (
    ModuleSums,
    as_components,
    largest_principal,
    volumetric_stress,
)

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

Array = npt.NDArray[np.float64]


class ModuleFields:
    """Works out quantities of the modules at the last sampled step.

    Args:
        names: of the quantities, as in ``output.fields``.
        points: (P, 3) corners at rest, m. hexahedra: (C, 8) their numbers, modules in the order of
            the mask's sites.
    """

    def __init__(
        self,
        simulation: "Simulation",
        names: Sequence[str],
        points: Array,
        hexahedra: npt.NDArray[np.int64],
    ):
        self.simulation, self.names = simulation, names
        self.points, self.hexahedra = points, hexahedra
        if self._of_bars:
            from taichi_ldem.solver.readings import BarReadings

            self.readings = BarReadings(simulation.dynamics)

    @property
    def _of_bars(self) -> bool:
        return bool({*self.names} - {"strain"})

    def at_sample(self, displacement: Array, corners: Array) -> dict[str, npt.NDArray[np.floating]]:
        """The quantities by name, (C,) or (C, 6) each.

        Args:
            displacement: (sublattices, *S, 3) of all nodes. corners: (P, 3) of the points.
        """
        if not self.names:
            return {}
        gradient = mean_gradient(self.points, self.hexahedra, corners)
        found = {"strain": as_components(green_strain(gradient))}
        if self._of_bars:
            found |= self._bars(displacement, swelling(gradient))
        return {name: found[name] for name in self.names}

    def _bars(self, displacement: Array, swollen: Array) -> dict[str, Array]:
        """Stress and damage, which follow from the forces and the history of the bars."""
        s, dynamics = self.simulation, self.simulation.dynamics
        sums = ModuleSums(dynamics.lattice, displacement, self.readings.layers(1 - s.now))
        volume = module_volumes(self.points, self.hexahedra)
        stress = sums.stress(volume, swollen)
        if dynamics.features.volumetric:
            stress = stress + volumetric_stress(self.moduli_left(swollen), swollen)
        return {
            "stress": stress,
            "principal_stress": largest_principal(stress),
            "damage": sums.damage,
        }

    def moduli_left(self, swollen: Array) -> Array:
        """(C,) lambda - mu that modules have left at a swelling J - 1, Pa.

        The rule is that of the kernels, ``ModuleVolumes.share``; a test compares both.
        """
        dynamics = self.simulation.dynamics
        modulus = dynamics.volumetric * dynamics.of_modules(dynamics.volume_modulus)
        if dynamics.features.history:
            damage = dynamics.of_modules(dynamics.volume_damage)
            whole = (dynamics.volumetric > 0) & (swollen < 0) & (damage < 1)
            modulus *= np.where(whole, 1.0, 1 - damage)
        return modulus
