"""What a crack costs."""

import numpy as np
import pytest
from support.blocks import DAMAGE, Breakable

G_F = DAMAGE["fracture_energy"]


def _split(block: Breakable, axis: int, plane: float) -> tuple[float, int]:
    """Part a block at a plane (in modules from its low side), bar by bar; J and broken bars."""
    place = 0.5 * block.body.places[:, axis]
    for opening in np.geomspace(1e-4, 0.5, 40):  # in modules
        displacement = np.zeros((len(place), 3))
        displacement[place > plane, axis] = opening * block.spacing
        block.put(displacement)
    energy, fracture, broken = block.energies()
    assert energy == 0.0  # the halves are free of each other, and whole
    return fracture, broken


@pytest.mark.parametrize("nu", [0.2, 0.25, 0.3])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("plane", [0.75, 1.25, 1.6])
def test_a_plane_crack_between_node_planes_costs_g_f(
    breakable: Breakable, nu: float, axis: int, plane: float
) -> None:
    block = breakable.renew(poisson_ratio=nu)
    fracture, broken = _split(block, axis, plane)
    area = (3 * block.spacing) ** 2
    assert fracture == pytest.approx(G_F * area, rel=1e-12)
    assert broken == 16 + 9 + 36  # edges, centre bars and diagonals that cross 3 x 3 modules


def test_the_printed_areas_lose_a_tenth(breakable: Breakable) -> None:
    block = breakable.renew(fracture_areas="paper")
    fracture, _ = _split(block, 0, 1.25)
    # 2 x 4/22 + 4 x 3/22 of the cut, shared paper facts
    assert fracture == pytest.approx(20 / 22 * G_F * (3 * block.spacing) ** 2, rel=1e-12)
