"""Which nodes grips hold."""

from types import SimpleNamespace
from typing import Any

from support.paths import CONFIGS

from taichi_ldem.scene import load_scene
from taichi_ldem.solver.build import build_lattice
from taichi_ldem.solver.contact.kernels.grips import Grips
from taichi_ldem.studies.toughness.plan import Strip


def test_seeds_of_a_perturbed_lattice_share_the_room_for_held_nodes() -> None:
    """A strip at 15 degrees: seeds hold different numbers of nodes and share their kernels."""
    base = load_scene(CONFIGS / "tension_strip.toml")
    base = base.model_copy(update={"plate": base.plate.model_copy(update={"perturbation": 0.07})})
    held, room = set(), set()
    for seed in range(4):
        scene = Strip(15.0, 1.0, seed).scene(base)
        dynamics: Any = SimpleNamespace(lattice=build_lattice(scene))
        layout = Grips.layout_of(None, dynamics, scene)  # type: ignore[arg-type]
        assert layout.nodes is not None
        held.add(len(layout.nodes))
        room.add(layout.capacity)
    assert len(held) > 1
    assert len(room) == 1
    assert max(held) <= min(room)
