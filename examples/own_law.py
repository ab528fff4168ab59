"""Define a softening law, and pull a block apart at a plane to measure what that costs.

The branch is a parabola: at the peak strain eps, a bar carries ((eps_f - eps)/(eps_f - eps_p))^2 of
its force at eps_p.
Everything is in units of eps_p and EA eps_p (see taichi_ldem/solver/laws.py); the area under the
whole law must be K_r/2, so that a bar costs G_f A^f: 1/2 + (failure - 1)/3 = K_r/2.
"""

import numpy as np
import taichi as ti

from taichi_ldem import Scene, Simulation
from taichi_ldem.solver.energy import FRACTURE
from taichi_ldem.solver.laws import Law, register


@ti.func
def softening(peak, failure, _):
    """Force over EA eps_p at peak strain 1 < peak < failure."""
    remaining = (failure - peak) / (failure - 1)
    return remaining * remaining


@ti.func
def area(peak, failure, _):
    """Integral of the branch from 1 to peak."""
    remaining = (failure - peak) / (failure - 1)
    return (failure - 1) / 3 * (1 - remaining * remaining * remaining)


def parameters(ductility: float) -> tuple[float, float]:
    """K_r -> peak strain at failure; the second parameter is not used."""
    return 1 + 1.5 * (ductility - 1), 0.0


register("parabolic", Law(softening, area, parameters))

scene = Scene(
    scenario="impact",
    plate={"size": (0.9e-3, 0.9e-3, 0.9e-3), "modules_through_thickness": 3},
    material={
        "youngs_modulus": 3.35e9,
        "poisson_ratio": 0.25,
        "density": 1190.0,
        "fracture_energy": 1034.0,
        "failure_strain": 0.0175,
        "law": "parabolic",
    },
    solver={"duration": 1e-5},
)
with Simulation(scene) as simulation:
    engine, spacing = simulation.engine, scene.plate.spacing
    dynamics = engine.dynamics
    beyond = dynamics.lattice.positions()[..., 0] > 0.1 * spacing  # between two planes of nodes
    for opening in spacing * np.geomspace(1e-4, 0.5, 40):
        displacement = np.zeros((*beyond.shape, 3))
        displacement[beyond, 0] = opening
        dynamics.set_displacement(0, displacement)
        dynamics.get_acceleration(0)  # evaluates every bar
    engine.energies.potential(0)
    fracture = engine.energies.total()[FRACTURE]
area_of_crack = scene.plate.size[1] * scene.plate.size[2]
print(f"dissipated: {fracture / area_of_crack:.3f} J/m2, given: {scene.material.fracture_energy}")
