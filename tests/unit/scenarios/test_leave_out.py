from pathlib import Path
from types import SimpleNamespace

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
from taichi_ldem.scene import load_scene
from taichi_ldem.solver.memory import field_bytes

SCENE_FILES = sorted(CONFIGS.glob("*.toml"))


@pytest.mark.parametrize("file", SCENE_FILES, ids=[file.stem for file in SCENE_FILES])
def test_everything_leaves_out_only_what_a_plate_cannot_have(file: Path) -> None:
    scene = load_scene(file)
    full = everything(scene)
    assert full.plate.modules == scene.plate.modules
    assert [line.split(" (")[0] for line in left_out(full)] == [
        "strength apart from toughness",  # with a G_f that varies, it cannot be
        "grips and gauge",
        "support contact",
        "floor contact",
        "loads",
        "contact of pieces",  # only where a scene has it
        "notches that open during the run",
        "motion and strain at the start",
        "probes",
    ]


def test_a_free_vibration_needs_seven_tenths_of_an_impact_s_bytes() -> None:
    """The promise of the leave-out report, on the paper's lattice."""
    by_name = {file.stem: load_scene(file) for file in SCENE_FILES}
    impact, modes = by_name["impact"], by_name["modes"]
    assert modes.plate.modules == impact.plate.modules
    assert field_bytes(modes) <= 0.7 * field_bytes(impact)


def test_pieces_touch_in_everything_only_where_the_scene_lets_them() -> None:
    scene = block_scene(12, 12, 2, material=DAMAGE)
    touching = scene.changed("contact.fragments=true", "contact.friction=0.3")
    assert everything(scene).contact is None
    assert everything(touching).contact == touching.contact
    added = kernels_of_everything(touching) - kernels_of_everything(scene)
    fragments = SimpleNamespace(kernel_names=lambda: ["contact: a", "pairs near: a"])
    features = SimpleNamespace(damage=False, crack=False, weakening=False)
    dynamics = SimpleNamespace(features=features, in_strips=True)
    simulation = SimpleNamespace(dynamics=dynamics, bodies=[], fragments=fragments, scene=scene)
    assert len(kernels(simulation)) == 2 + added  # type: ignore[arg-type]


def test_kernels_are_those_of_the_features() -> None:
    def body(*names: str) -> SimpleNamespace:
        return SimpleNamespace(kernel_names=lambda: list(names))

    def of(
        damage: bool, *bodies: SimpleNamespace, crack: bool = False, probes: tuple[str, ...] = ()
    ) -> list[str]:
        features = SimpleNamespace(damage=damage, crack=crack, weakening=False)
        dynamics = SimpleNamespace(features=features, in_strips=True)
        scene = SimpleNamespace(probes=[SimpleNamespace(quantities=probes)])
        simulation = SimpleNamespace(dynamics=dynamics, bodies=bodies, fragments=None, scene=scene)
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


def test_a_scene_of_everything_compiles_the_number_of_kernels_that_is_printed(
    taichi: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    from taichi_ldem.solver import stability
    from taichi_ldem.solver.simulation import Simulation

    # the kernels are counted, not run: the estimate of the critical step would compile some
    monkeypatch.setattr(stability, "critical_time_step", lambda dynamics: 1e-8)
    monkeypatch.setattr("taichi_ldem.solver.simulation.set_off", lambda simulation: None)
    simulation = Simulation(everything(block_scene(12, 12, 2, material=DAMAGE)))
    assert len(kernels(simulation)) == KERNELS_OF_EVERYTHING
