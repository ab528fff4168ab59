"""Two pieces of a block, cut apart by a notch, that are thrown at each other."""

from typing import TYPE_CHECKING, Any

import numpy as np
from support.blocks import SPACING, block_scene

from taichi_ldem.scene import Scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation

CUT = 0.5 * SPACING
NOTCH = {"normal": "x", "position": CUT, "from": [-1.0, -1.0], "to": [1.0, 1.0]}
FRICTION = 0.3


def scene_of_pieces(**tables: Any) -> Scene:
    """A block of 10 x 4 x 3 modules that is cut through near its middle, and may touch itself."""
    given: dict[str, Any] = {
        "notch": [NOTCH],
        "contact": {"fragments": True, "friction": FRICTION},
        "solver": {"duration": 1e-3, "safety": 0.5},
    }
    for name, table in tables.items():
        given[name] = given.get(name, {}) | table if isinstance(table, dict) else table
    return block_scene(10, 4, 3, **given)


SHIFT = (0.14e-3, 0.1e-3, 0.06e-3)
"""By how much the right piece is moved before it flies, so that nothing touches, m."""


class Pieces:
    """A simulation of the two pieces.

    Attributes:
        places: (n, 3) positions of all nodes at rest, m. right: (n,) those of the right piece.
        masses: (n,) kg.
    """

    def __init__(self, simulation: "Simulation") -> None:
        self.simulation = simulation
        lattice = simulation.dynamics.lattice
        self.exists = lattice.exists()
        self.places = lattice.positions()[self.exists]
        self.right = self.places[:, 0] > CUT
        self.masses = simulation.dynamics.masses()[self.exists]

    def spread(self, values: np.ndarray) -> np.ndarray:
        """(n, 3) values in the shape of the lattice's sites."""
        whole = np.zeros((*self.exists.shape, 3))
        whole[self.exists] = values
        return whole

    def throw(
        self,
        speed: tuple[float, float, float] = (-10.0, 1.0, 0.5),
        shift: tuple[float, float, float] = SHIFT,
        turned: np.ndarray | None = None,
    ) -> None:
        """Start with the right piece shifted (m) and flying at a speed (m/s) towards the left one.

        Args:
            turned: a rotation of everything.
        """
        turn = np.eye(3) if turned is None else turned
        velocity = np.where(self.right[:, None], speed, 0.0)
        place = self.places + np.where(self.right[:, None], shift, 0.0)
        s = self.simulation
        s.reset(s.scene)
        s.start_from(self.spread(place @ turn.T - self.places), self.spread(velocity @ turn.T))

    def fly(self, steps: int, *, list_always: bool = False) -> list["Sample"]:
        """Take steps with a sample at each.

        Args:
            list_always: make the lists of pairs anew at every step.
        """
        samples = []
        for _ in range(steps):
            if list_always:
                self.simulation.fragments.next_listing = 0
            samples.append(self.simulation.sample_step())
        return samples

    @property
    def positions(self) -> np.ndarray:
        """(n, 3) positions, m."""
        return self.places + self.simulation.displacement()[self.exists]

    @property
    def velocity(self) -> np.ndarray:
        """(n, 3) velocities half a step behind, m/s."""
        return self.simulation.dynamics.get_velocity()[self.exists]

    def momentum(self) -> np.ndarray:
        """Momentum of both pieces, kg m/s."""
        return self.masses @ self.velocity

    def angular_momentum(self) -> np.ndarray:
        """Angular momentum about the origin, kg m2/s."""
        return self.masses @ np.cross(self.positions, self.velocity)

    def impulses(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) impulses of contact in the latest step, and of them those of friction, N s."""
        fragments = self.simulation.fragments
        found = []
        for field in (fragments.impulse, fragments.friction):
            whole = np.zeros((self.exists.size, 3))
            whole[fragments.nodes.to_numpy()[: fragments.size]] = field.to_numpy()[: fragments.size]
            found.append(whole[self.exists.ravel()])
        return found[0], found[1]
