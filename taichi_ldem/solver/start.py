"""The state of the plate at t = 0: its motion, and the strain that it begins with.

Velocities lie half a step before displacements. The plate sets off with those that the forces of
t = 0 turn into the given ones: bars and gravity act in ``Simulation.start_from``, loads here.
"""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from taichi_ldem.scene import Scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

Floats = npt.NDArray[np.float64]


def set_off(simulation: "Simulation") -> None:
    """Give the plate its state at t = 0, before any body is placed."""
    if simulation.scene.plate.moves or simulation.scene.start is not None:
        _give_start(simulation)
    if any(load.value * load.factor_at_start for load in simulation.scene.loads):
        _kick_back(simulation)


def _give_start(simulation: "Simulation") -> None:
    """Set displacements and velocities."""
    scene, dynamics = simulation.scene, simulation.dynamics
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


def _kick_back(simulation: "Simulation") -> None:
    """Take half a step of the forces that loads exert at t = 0 from the velocities."""
    from taichi_ldem.solver.contact.load_nodes import LoadNodes

    scene, dynamics = simulation.scene, simulation.dynamics
    masses, half_step = dynamics.masses(), 0.5 * simulation.time_step
    found = LoadNodes.of(dynamics.lattice, masses, scene.loads)
    forces = [0.0 if q.prescribes else q.value * q.factor_at_start for q in scene.loads]
    pull = (np.array(forces)[found.which] * found.shares)[:, None]
    node = found.nodes[found.node_of]
    units = np.array([load.unit for load in scene.loads])[found.which]
    drag = 1 - 0.5 * scene.solver.damping * half_step
    velocity = dynamics.get_velocity()
    change = half_step / drag * pull * units / masses.ravel()[node][:, None]
    np.subtract.at(velocity.reshape(-1, 3), node, change)
    dynamics.set_velocity(velocity)
