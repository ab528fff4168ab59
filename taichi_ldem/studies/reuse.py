"""A simulation used again: another scene of the same lattice, without compiling anything anew.

A kernel of the step takes seconds to compile, and numbers are its arguments, so a study of many
small scenes that differ in numbers alone puts one simulation back to its first step.
"""

from typing import TYPE_CHECKING

import numpy as np

from taichi_ldem.model import disorder
from taichi_ldem.model.material import check
from taichi_ldem.solver import stability

if TYPE_CHECKING:
    from taichi_ldem.model.lattice import Lattice
    from taichi_ldem.scene import Scene
    from taichi_ldem.solver.simulation import Simulation


def renew(simulation: "Simulation", scene: "Scene", lattice: "Lattice | None" = None) -> None:
    """Put a simulation back to t = 0, at rest and whole, with the numbers of another scene.

    Args:
        simulation: built for a scene with the same plate, tables and switches.
        lattice: another body cut from the same prism of modules (only without rings).

    Raises:
        SceneError: the other scene is refused, as building it would be.
    """
    dynamics, bars = simulation.dynamics, check(scene)
    simulation.scene, simulation.damping = scene, scene.solver.damping
    if lattice is not None:
        dynamics.lattice = lattice
        dynamics.code.from_numpy(dynamics.lanes.spread(lattice.code))
    dynamics.set_bars(bars)
    dynamics.set_density(scene.material.density)
    drawn = disorder.draw(scene, dynamics.lattice)
    if dynamics.features.strength:
        assert drawn.strength is not None
        dynamics.set_strength(drawn.strength)
    if dynamics.features.modulus:
        assert drawn.youngs_modulus is not None
        dynamics.set_modulus(drawn.youngs_modulus)
    if dynamics.features.density:
        assert drawn.density is not None
        dynamics.set_own_density(scene.material.density, drawn.density)
    simulation.peak_strain = dynamics.peak_strain
    fields = dynamics.fields()
    for name in ("displacement", "velocity", "peak", "touched", "recorded", "damped"):
        for field in fields.get(name, []):
            field.fill(0)
    simulation.critical_time_step = stability.critical_time_step(dynamics)
    simulation.time_step, simulation.sample_every = simulation._choose_time_step()
    simulation.steps = round(scene.solver.duration / simulation.time_step)
    simulation.now = simulation.step_number = 0
    simulation._start = simulation._last = None
    simulation._impulses[:] = 0
    for body in simulation.bodies:
        body.sums.fill(0)
    if simulation.striker is not None and scene.striker is not None:
        tip = dynamics.lattice.modules[2] * dynamics.spacing + scene.striker.gap
        s = scene.striker
        numbers = (s.mass, 0.5 * s.diameter, s.gravity, *s.position, tip)
        simulation.striker.numbers.from_numpy(np.array(numbers, dtype=np.float64))
        start_striker(simulation)


def start_striker(simulation: "Simulation", displacement: float = 0.0) -> None:
    """Put the striker to a displacement (m) with its scene's velocity at the present time step."""
    striker, body = simulation.scene.striker, simulation.striker
    assert striker is not None
    assert body is not None
    start = striker.velocity - 0.5 * simulation.time_step * striker.gravity
    body.state.from_numpy(np.array([displacement, start, start, 0.0]))
