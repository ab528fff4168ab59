from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support.blocks import DAMAGE, block_scene
from support.paths import CONFIGS

from taichi_ldem.scenarios.describe import left_out
from taichi_ldem.scenarios.leave_out import (
    KERNELS_OF_EVERYTHING,
    everything,
    kernels,
    kernels_of_everything,
)
from taichi_ldem.scene import Scene, load_scene
from taichi_ldem.solver.memory import field_bytes

SCENE_FILES = sorted(CONFIGS.glob("*.toml"))


CANNOT_BE = {"strength apart from toughness", "grips and gauge"}
"""What everything leaves out: a G_f that varies, and rings stand in its place."""

BESIDES = {
    "tip strain of the bar families",
    "support contact",
    "floor contact",
    "loads",
    "contact of pieces",
    "notches that open during the run",
    "motion and strain at the start",
    "probes",
}
"""What everything has only where the scene has it."""


def _absent(scene: Scene) -> set[str]:
    return {line.split(" (")[0] for line in left_out(scene)}


@pytest.mark.parametrize("file", SCENE_FILES, ids=[file.stem for file in SCENE_FILES])
def test_everything_leaves_out_only_what_the_scene_has_not_either(file: Path) -> None:
    scene = load_scene(file)
    full = everything(scene)
    assert full.plate.modules == scene.plate.modules
    assert _absent(full) == CANNOT_BE | (BESIDES & _absent(scene))
    assert len(full.strikers) == max(1, len(scene.strikers))


def test_a_free_vibration_needs_seven_tenths_of_an_impact_s_bytes() -> None:
    """The promise of the leave-out report, on the paper's lattice."""
    by_name = {file.stem: load_scene(file) for file in SCENE_FILES}
    impact, modes = by_name["impact"], by_name["modes"]
    assert modes.plate.modules == impact.plate.modules
    assert field_bytes(modes) <= 0.7 * field_bytes(impact)


def _built(scene: Scene, *bodies: str, touching: bool = False) -> Any:
    """A simulation that has only what the count of its kernels needs."""
    features = SimpleNamespace(damage=False, crack=False, weakening=False)
    names = {body: [f"contact: {body}", f"nodes near: {body}"] for body in bodies}
    fragments = SimpleNamespace(kernel_names=lambda: ["contact: a", "pairs near: a"])
    return SimpleNamespace(
        scene=scene,
        dynamics=SimpleNamespace(features=features, in_strips=True),
        bodies=[SimpleNamespace(kernel_names=lambda own=own: own) for own in names.values()],
        fragments=fragments if touching else None,
        alone=False,
    )


def test_pieces_touch_in_everything_only_where_the_scene_lets_them() -> None:
    scene = block_scene(12, 12, 2, material=DAMAGE)
    touching = scene.changed("contact.fragments=true", "contact.friction=0.3")
    assert everything(scene).contact is None
    assert everything(touching).contact == touching.contact
    without, with_pieces = (_built(scene, touching=t) for t in (False, True))
    assert kernels_of_everything(with_pieces) - kernels_of_everything(without) == 2


def test_everything_compiles_no_fewer_kernels_than_the_scene() -> None:
    """Two strikers on a ring and probes are eleven; everything without them has eight."""
    striker = {"diameter": 1e-3, "mass": 1.0, "velocity": 1.0}
    probe = [{"point": [0, 0, 0], "quantities": ["velocity", "stress"]}]
    scene = block_scene(12, 12, 2, material=DAMAGE, striker=[striker, striker], probe=probe)
    simulation = _built(scene, "striker", "striker2", "supports")
    assert len(kernels(simulation)) == 11
    assert kernels_of_everything(simulation) == len(KERNELS_OF_EVERYTHING) + 4 + 3
    full = everything(scene)
    assert (len(full.strikers), full.probes) == (2, scene.probes)
    assert kernels_of_everything(_built(block_scene(12, 12, 2))) == len(KERNELS_OF_EVERYTHING)
    pulled = SimpleNamespace(grips=object(), probes=())
    assert kernels_of_everything(_built(pulled, "grips")) == len(KERNELS_OF_EVERYTHING)  # type: ignore[arg-type]


def test_kernels_are_those_of_the_features() -> None:
    def body(*names: str) -> SimpleNamespace:
        return SimpleNamespace(kernel_names=lambda: list(names))

    def of(
        damage: bool,
        *bodies: SimpleNamespace,
        crack: bool = False,
        probes: tuple[str, ...] = (),
        alone: bool = False,
    ) -> list[str]:
        features = SimpleNamespace(damage=damage, crack=crack, weakening=False)
        dynamics = SimpleNamespace(features=features, in_strips=True)
        scene = SimpleNamespace(probes=[SimpleNamespace(quantities=probes)])
        simulation = SimpleNamespace(
            dynamics=dynamics, bodies=bodies, fragments=None, scene=scene, alone=alone
        )
        return kernels(simulation)  # type: ignore[arg-type]

    assert of(False) == ["step", "energies"]
    assert of(True) == ["step", "energies", "broken bars"]
    assert of(False, probes=("velocity",))[2:] == ["motions of probes"]
    assert of(False, probes=("stress",))[2:] == ["strains of probes", "stresses of probes"]
    assert of(True, crack=True) == ["step", "energies", "broken bars", "damage before the step"]
    assert of(False, body("contact: a", "nodes near: a"), body("b"))[2:] == [
        "contact: a",
        "nodes near: a",
        "b",
    ]
    # one thread has them in the step's kernel
    a = body("contact: a", "nodes near: a")
    assert of(True, a, crack=True, alone=True)[2:] == ["nodes near: a", "broken bars"]


def test_a_scene_of_everything_compiles_the_number_of_kernels_that_is_printed(
    taichi: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    from taichi_ldem.solver import stability
    from taichi_ldem.solver.simulation import Simulation

    # the kernels are counted, not run: the estimate of the critical step would compile some
    monkeypatch.setattr(stability, "critical_time_step", lambda dynamics: 1e-8)
    monkeypatch.setattr("taichi_ldem.solver.simulation.set_off", lambda simulation: None)
    scene = block_scene(12, 12, 2, material=DAMAGE, solver={"threads": 2})
    simulation = Simulation(everything(scene))
    assert sorted(kernels(simulation)) == sorted(KERNELS_OF_EVERYTHING)
