"""Room of the lists of nodes: seeds of a perturbed lattice share it, and so their kernels."""

from typing import TYPE_CHECKING

import pytest
from support.blocks import block_scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


def _clamped(seed: int) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(
        block_scene(
            16,
            16,
            2,
            plate={"perturbation": 0.2, "perturbation_seed": seed},
            clamp={"kind": "bonded", "inner_diameter": 5.2e-3, "outer_diameter": 7.6e-3},
            striker={"diameter": 2e-3, "mass": 1e-3, "velocity": 1.0},
        )
    )


@pytest.mark.slow
def test_another_seed_needs_no_other_kernels(taichi: None) -> None:
    """A clamp holds other nodes with another seed; the simulation can be set back to it."""
    first = _clamped(1)
    rings = first.body("rings")
    assert rings is not None
    held = []
    for seed in range(2, 8):
        scene = first.scene.model_copy(
            update={"plate": first.scene.plate.model_copy(update={"perturbation_seed": seed})}
        )
        first.reset(scene)
        held.append(len(rings.listed()))
    assert len(set(held)) > 1
