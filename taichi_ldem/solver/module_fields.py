"""Strain, stress and damage of modules, for the fields and the probes that ask for them."""

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
from taichi_ldem.model.lattice import Lattice, Part

if TYPE_CHECKING:
    from taichi_ldem.solver.dynamics import Dynamics
    from taichi_ldem.solver.readings import BarReadings

Array = npt.NDArray[np.float64]


class ModuleFields:
    """Works out quantities of the modules of a lattice, or of a part of it.

    Args:
        names: of the quantities: strain, stress, principal_stress, damage.
        points: (P, 3) corners at rest, m. hexahedra: (C, 8) their numbers, modules in the order of
            the mask's sites.
        part: the modules lie in it; None: in the whole lattice.
        readings: of the bars, which probes share; None: some of its own, where they are needed.
    """

    def __init__(
        self,
        dynamics: "Dynamics",
        names: Sequence[str],
        points: Array,
        hexahedra: npt.NDArray[np.int64],
        part: Part | None = None,
        readings: "BarReadings | None" = None,
    ):
        self.dynamics, self.names, self.part = dynamics, names, part
        self.points, self.hexahedra = points, hexahedra
        if self._of_bars:
            from taichi_ldem.solver.readings import BarReadings

            self.readings = BarReadings(dynamics) if readings is None else readings

    @property
    def _of_bars(self) -> bool:
        return bool({*self.names} - {"strain"})

    def at_sample(
        self, now: int, displacement: Array, corners: Array
    ) -> dict[str, npt.NDArray[np.floating]]:
        """The quantities by name, (C,) or (C, 6) each.

        Args:
            now: buffer of the displacement. displacement: (sublattices, *S, 3) of all nodes.
            corners: (P, 3) of the points.
        """
        if not self.names:
            return {}
        gradient = mean_gradient(self.points, self.hexahedra, corners)
        found = {"strain": as_components(green_strain(gradient))}
        if self._of_bars:
            found |= self._bars(now, displacement, swelling(gradient))
        return {name: found[name] for name in self.names}

    def _bars(self, now: int, displacement: Array, swollen: Array) -> dict[str, Array]:
        """Stress and damage, which follow from the forces and the history of the bars."""
        lattice: Lattice = self.dynamics.lattice if self.part is None else self.part
        sums = ModuleSums(lattice, displacement, self.readings.layers(now, self.part))
        volume = module_volumes(self.points, self.hexahedra)
        stress = sums.stress(volume, swollen)
        if self.dynamics.features.volumetric:
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
        dynamics = self.dynamics
        modulus = dynamics.volumetric * self._of_part(dynamics.of_modules(dynamics.volume_modulus))
        if dynamics.features.history:
            damage = self._of_part(dynamics.of_modules(dynamics.volume_damage))
            whole = (dynamics.volumetric > 0) & (swollen < 0) & (damage < 1)
            modulus *= np.where(whole, 1.0, 1 - damage)
        return modulus

    def _of_part(self, values: Array) -> Array:
        """(C,) of the values of all modules."""
        if self.part is None:
            return values
        spread = np.zeros(self.dynamics.lattice.mask.shape)
        spread[self.dynamics.lattice.mask] = values
        sizes = zip(self.part.first, self.part.mask.shape, strict=True)
        return spread[tuple(slice(n, n + count) for n, count in sizes)][self.part.mask]
