"""Small scenes and blocks for the tests."""

from typing import Any

import numpy as np
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scene import Material, Scene, parse_scene

SPACING = 0.5e-3
PMMA = {"youngs_modulus": 3.35e9, "poisson_ratio": 0.25, "density": 1190.0, "damage": False}
DAMAGE = {"damage": True, "fracture_energy": 1034.0, "failure_strain": 0.0175}


def block_scene(
    nx: int, ny: int, nz: int, *, spacing: float = SPACING, **tables: dict[str, Any] | list[Any]
) -> Scene:
    """A prism of nx x ny x nz modules, elastic PMMA unless the tables say more."""
    data: dict[str, Any] = {
        "scenario": "impact",
        "plate": {
            "size": [nx * spacing, ny * spacing, nz * spacing],
            "modules_through_thickness": nz,
        },
        "material": PMMA,
        # the numbers of steps in the tests are meant for this step, not for the default one
        "solver": {"duration": 1e-3, "safety": 0.7},
    }
    for name, table in tables.items():
        data[name] = data.get(name, {}) | table if isinstance(table, dict) else table
    return parse_scene(data)


def random_displacement(body: Body, size: float, seed: int = 1) -> np.ndarray:
    """(nodes, 3) normally distributed displacements with the given standard deviation, m."""
    return np.random.default_rng(seed).normal(0.0, size, (len(body.places), 3))


def smooth_velocity(places: np.ndarray, speed: float) -> np.ndarray:
    """(nodes, 3) a velocity field that stretches, shears and bends a block, without a jump."""
    span = np.ptp(places, axis=0)
    x, y, z = (np.pi * (places - places.min(axis=0)) / span).T
    return speed * np.stack([np.cos(x), np.cos(x) * np.sin(y), np.cos(x + z)], axis=1)


class Breakable:
    """A block whose nodes are placed by hand, to see what its bars carry and dissipate.

    Attributes:
        bars: families now in use. body: the block, bar by bar. peak: (bars,) peak strain, by hand.
    """

    spacing = 0.3e-3  # K_r of 2.3 and 2.7

    def __init__(self, law: str, closing: bool = False):
        from support.bars import BarForces

        from taichi_ldem.solver.dynamics import Dynamics, Features
        from taichi_ldem.solver.energy import EnergySums

        lattice = Lattice(prism(3, 3, 3), self.spacing)
        self.law = law
        features = Features(law=law, closing=closing)
        self.bars = mat.bar_families(Material(**PMMA | DAMAGE), self.spacing)
        self.dynamics = Dynamics(lattice, self.bars, PMMA["density"], features)
        self.bar_forces = BarForces(self.dynamics)
        self.sums = EnergySums(self.dynamics)
        self.body = Body(lattice.mask, self.spacing)

    def renew(self, **material: Any) -> "Breakable":
        """Make all bars whole, of a material that differs from PMMA in what is given."""
        self.bars = mat.bar_families(Material(**PMMA | DAMAGE | material), self.spacing)
        self.dynamics.set_bars(self.bars)
        for name in ("peak", "touched", "recorded", "face_loss", "velocity"):
            for field in self.dynamics.fields().get(name, []):
                field.fill(0)
        return self

    def put(self, displacement: np.ndarray) -> None:
        """Place the nodes, (nodes, 3) m, and update the bars."""
        self.dynamics.set_displacement(0, self.body.spread(displacement))
        self.dynamics.get_acceleration(0)

    def pulls(self, time_step: float = 0.0) -> np.ndarray:
        """(bars,) axial forces over current length, N/m, after a step that took so long."""
        return self.body.bar_values(self.axial(time_step), self.dynamics.lattice.bar_midpoints)

    def axial(self, time_step: float = 0.0) -> np.ndarray:
        """(S, 14) axial forces over current length in the program's layout, N/m."""
        return self.bar_forces.read(0, time_step)

    def node_forces(self) -> np.ndarray:
        """(nodes, 3) N."""
        return self.dynamics.get_force(0)[self.body.index]

    def energies(self) -> tuple[float, float, int]:
        """Strain and dissipated energy (J), broken bars."""
        self.sums.potential(0)
        strain, fracture, broken, *_ = self.sums.total()
        return float(strain), float(fracture), int(broken)
