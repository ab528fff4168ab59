"""The state of the plate at t = 0: its motion, and the strain that it begins with."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from taichi_ldem.scene import Scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

Floats = npt.NDArray[np.float64]


def set_off(simulation: "Simulation") -> None:
    """Give the plate its state at t = 0, with velocities half a step back, where gravity acts."""
    scene, dynamics = simulation.scene, simulation.dynamics
    if not scene.plate.moves and scene.start is None:
        return
    exists = dynamics.lattice.exists()[..., None]
    velocity = exists * np.array(scene.plate.velocity or (0.0, 0.0, 0.0))
    displacement = np.zeros_like(velocity)
    if scene.start is not None:
        place = dynamics.lattice.positions()
        velocity += exists * start_velocity(scene, place, dynamics.masses())
        displacement = exists * (place * np.array(scene.start.strain or (0.0, 0.0, 0.0)))
    simulation.start_from(displacement, velocity)


def start_velocity(scene: Scene, place: Floats, masses: Floats) -> Floats:
    """Velocities that the table [start] gives, m/s.

    Args:
        place: (..., 3) of the nodes at rest, m. masses: (...) of the nodes, kg.
    """
    start = scene.start
    assert start is not None
    velocity = np.zeros_like(place)
    velocity += np.array(start.velocity or (0.0, 0.0, 0.0))
    if start.rotation is not None:
        centre = np.average(place.reshape(-1, 3), axis=0, weights=masses.ravel())
        velocity += np.cross(np.array(start.rotation), place - centre)
    if start.expansion is not None:
        velocity[..., :2] += start.expansion * place[..., :2]
    return velocity
