"""The simulation that a group of cases shares, with the states and numbers that cases use."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import parse_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample

Array = npt.NDArray[np.float64]


@dataclass
class Result:
    """How a case ended, and its extremes.

    Attributes:
        outcome: a prediction's word, or a failure: "drifted", "not finite", "wrong", "crashed".
        message: the refusal, the guard's message, or the reason of a failure.
        steps: number of steps. seconds: wall time.
        share: time step over the critical one. critical_s: critical time step, s.
        drift: largest imbalance over the most energy that the plate has held.
        error: largest energy error by the measure of the run's own guard.
        strain: largest strain of a bar that is not broken. compression: largest shortening.
        gained: largest energy that contact has created, over all energy present.
        broken: number of broken bars.
    """

    outcome: str = ""
    message: str = ""
    steps: int = 0
    share: float = math.nan
    critical_s: float = math.nan
    drift: float = math.nan
    error: float = math.nan
    strain: float = math.nan
    compression: float = math.nan
    gained: float = 0.0
    broken: int = 0
    seconds: float = math.nan


class Bench:
    """A group's simulation, reset for every case.

    Attributes:
        base: tables of the group's scene. scene: that of the present case.
        simulation: built once; its kernels serve all cases.
        whole: the lattice of the group's own scene.
        kept: numbers that a set-up leaves for a check.
        held: the most energy that the plate has held so far, J.
        result: of the present case.
    """

    def __init__(self, base: dict[str, Any]):
        from taichi_ldem.solver import backend

        self.base = base
        self.scene = parse_scene(base)
        backend.start(self.scene.solver)
        from taichi_ldem.solver.simulation import Simulation

        self.simulation = Simulation(self.scene)
        self.whole: Lattice = self.simulation.dynamics.lattice
        self.kept: dict[str, Any] = {}
        self.held = 0.0
        self.result = Result()

    def reset(self, tables: dict[str, Any]) -> None:
        """Put the simulation back to t = 0 with another scene, and clear the result.

        Raises:
            SceneError: the scene is refused.
        """
        self.result, self.kept, self.held = Result(), {}, 0.0
        self.scene = parse_scene(tables)
        self.simulation.reset(self.scene, self.whole)

    def note(self, sample: "Sample") -> None:
        """Add a sample to the result."""
        from taichi_ldem.solver.guard import gained_in_contact

        result, ledger, start = self.result, sample.ledger, self.simulation.initial_ledger
        assert start is not None
        plate = ledger.kinetic_plate + ledger.strain + ledger.fracture + ledger.damping
        self.held = max(self.held, plate + abs(ledger.contact))
        drift = abs(ledger.imbalance(start)) / self.held if self.held > 0 else 0.0
        longest, shortest = self.strains()
        for name, value in (
            ("drift", drift),
            ("error", sample.energy_error),
            ("gained", gained_in_contact(ledger, start)),
            ("strain", longest),
            ("compression", -shortest),
        ):
            # a NaN stays: max() would drop it or not, depending on the order
            old = getattr(result, name)
            setattr(result, name, value if not old >= value else old)
        result.steps, result.broken = sample.step, sample.broken_bars

    @property
    def lattice(self) -> Lattice:
        """The lattice of the present case."""
        return self.simulation.dynamics.lattice

    @property
    def exists(self) -> npt.NDArray[np.bool_]:
        """(sublattices, *S, 1) True where a node exists."""
        return self.lattice.exists()[..., None]

    @property
    def places(self) -> Array:
        """(sublattices, *S, 3) positions at rest from the middle of the body, m."""
        place = self.lattice.positions()
        at = self.lattice.exists()
        middle = 0.5 * (place[at].min(axis=0) + place[at].max(axis=0))
        return np.asarray((place - middle) * at[..., None])

    @property
    def masses(self) -> Array:
        """(sublattices, *S, 1) of the nodes, kg."""
        return np.asarray(self.simulation.dynamics.masses()[..., None])

    def start(self, displacement: Array | float = 0.0, velocity: Array | float = 0.0) -> None:
        """Set the state at t = 0."""
        rest = np.zeros((*self.exists.shape[:-1], 3))
        self.simulation.start_from(
            (rest + displacement) * self.exists, (rest + velocity) * self.exists
        )

    def noise(self, size: float, seed: int = 1) -> Array:
        """(sublattices, *S, 3) independent normal numbers."""
        shape = (*self.exists.shape[:-1], 3)
        return np.random.default_rng(seed).normal(0.0, size, shape)

    def shake(self, speed: float) -> None:
        """Noise in every node's velocity: every mode of the body is in it."""
        self.start(velocity=self.noise(speed))

    def strains(self) -> tuple[float, float]:
        """Largest and smallest strain of the bars that exist and are not broken, one step back."""
        from taichi_ldem.solver.stability import largest_strains

        s = self.simulation
        return largest_strains(s.dynamics, s.displacement_before())

    def momentum(self) -> Array:
        """(2, 3) momentum (kg m/s) and angular momentum (kg m2/s), both conserved exactly."""
        s = self.simulation
        velocity = self.masses * s.dynamics.get_velocity()
        where = (self.places + s.displacement()) * self.exists
        return np.stack(
            [velocity.sum(axis=(0, 1, 2, 3)), np.cross(where, velocity).sum((0, 1, 2, 3))]
        )
