"""The failure by the strain energy, where strikers or loads may have taken the energy back."""

import numpy as np
import pytest
from support.blocks import DAMAGE, block_scene

from taichi_ldem.scenarios.measure import failure_by_energy

STRIKER = {"diameter": 1e-3, "mass": 1e-3, "velocity": 1.0}


@pytest.mark.parametrize(
    ("first", "second", "external", "failed"),
    [
        (0.0, 0.0, 0.0, True),
        (-1.0, 0.0, 0.0, False),  # the only one that moves away has most of the energy
        (0.0, -1.0, 0.0, False),  # so does the second
        (1.0, 1.0, 0.0, True),  # both go on through the plate, faster because they fall
        (0.0, 0.0, -1.0, False),  # the plate has done work on a load
        (-0.3, -0.3, 0.0, False),  # both together
        (-0.3, 0.0, 0.0, True),
    ],
)
def test_an_elastic_rebound_of_either_striker_is_no_failure(
    first: float, second: float, external: float, failed: bool
) -> None:
    """Strain energy of 1 J falls to 0; strikers get J of the sign of their velocity."""
    scene = block_scene(6, 4, 2, material=DAMAGE, striker=[STRIKER, STRIKER])
    late = np.array([0.0, 0.0, 0.0, 1.0])
    history = {
        "time_s": np.arange(4.0),
        "strain_j": np.array([0.0, 0.5, 1.0, 0.0]),
        "fracture_j": np.array([0.0, 1.0, 1.0, 1.0]),
        "external_j": external * late,
    }
    for name, energy in (("striker", first), ("striker2", second)):
        history[f"{name}_velocity_m_s"] = energy * late
        history[f"kinetic_{name}_j"] = abs(energy) * late
    assert (failure_by_energy(scene, history) == 2.0) == failed
