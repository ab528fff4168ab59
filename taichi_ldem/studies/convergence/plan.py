"""Settings that the study varies: modules through the thickness, time step and precision."""

from dataclasses import dataclass

from taichi_ldem.studies.convergence.run import CRACKING, IMPACT, VIBRATION, WAVE

SHARES = (0.25, 0.5, 0.9)
"""Time steps over the critical one, in f64, at every resolution."""
SINGLE = (0.5, 0.9)
"""Time steps over the critical one in f32."""
STEPS = (0.95, 0.7, 0.5, 0.35, 0.25, 0.12)
"""Time steps for the order in time, at one resolution."""
FINE_STEP = 0.03
"""Time step of the reference in time."""
GOALS = (0.01, 0.05)
"""Relative errors for which the report recommends settings."""
PAPER = (6, 0.5, "f64")
"""The paper's own setting: six modules, 9e-8 s, which is 0.51 of the critical step."""


@dataclass(frozen=True)
class Plan:
    """What is run for a kind of scene.

    Attributes:
        modules: through the thickness.
        reference: modules of the reference; 0 where it is no lattice.
        timed: modules at which the order in time is measured.
        first: the quantity that figure and recommendations refer to.
    """

    modules: tuple[int, ...]
    reference: int
    timed: int
    first: str


PLANS = {
    IMPACT: Plan((2, 3, 4, 6, 8), 12, 4, "striker impulse"),
    VIBRATION: Plan((2, 3, 4, 6, 8), 0, 4, "frequency"),
    WAVE: Plan((2, 3, 4, 6), 0, 4, "speed"),
    CRACKING: Plan((5, 6), 8, 5, "t2"),
}


@dataclass(frozen=True)
class Point:
    """One run: modules through the thickness, share of the critical step, precision."""

    modules: int
    share: float
    precision: str = "f64"
    seed: int = 0

    @property
    def name(self) -> str:
        """Name of the run's record."""
        seed = f"_seed{self.seed}" if self.seed else ""
        return f"{self.modules}_modules_{self.share:g}_{self.precision}{seed}"

    @property
    def settings(self) -> list[str]:
        """Overrides of the scene's values."""
        return [
            f"plate.modules_through_thickness={self.modules}",
            f"solver.safety={self.share}",
            f"solver.precision={self.precision}",
            "solver.threads=1",
        ]
