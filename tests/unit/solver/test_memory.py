"""What a scene is said to need, against the fields that are built and what a process takes."""

import subprocess
import sys

import pytest
from support.blocks import DAMAGE, block_scene
from support.paths import ROOT

from taichi_ldem.api import Simulation
from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.describe import describe
from taichi_ldem.scene import DISORDERED
from taichi_ldem.solver import memory
from taichi_ldem.solver.fields import rows

NOTCH = [{"normal": "x", "position": 2.5e-4, "from": [-1, -1], "to": [1, 1]}]


@pytest.mark.parametrize(
    "tables",
    [
        {},
        {"material": DAMAGE},
        {"solver": {"damping": 10.0}},
        {"notch": NOTCH},
        {
            "material": DAMAGE,
            "disorder": {f"{n}_cv": 0.1 for n in DISORDERED if n != "strength"},
            "plate": {"perturbation": 0.1},
        },
    ],
    ids=["elastic", "damage", "damping", "notch", "disorder"],
)
def test_the_bytes_are_those_of_the_fields(taichi: None, tables: dict) -> None:
    from taichi_ldem.solver.build import build_dynamics
    from taichi_ldem.solver.dynamics import field_bytes

    scene = block_scene(4, 3, 2, **tables)
    dynamics, _ = build_dynamics(scene)  # a simulation would compile kernels
    fields = [f for each in dynamics.fields().values() for f in each]
    whole = sum(field_bytes(f) for f in fields if f.shape[-3:] == dynamics.shape)
    assert memory.field_bytes(scene) == whole
    by_row = {
        row.name: row.bytes(dynamics.layout) for row in rows(dynamics.features, dynamics.layout)
    }
    assert by_row == {
        name: sum(field_bytes(f) for f in fields) for name, fields in dynamics.fields().items()
    }


PEAK = """
import resource, sys
sys.path.insert(0, "tests")
from support.blocks import DAMAGE, block_scene
from taichi_ldem.solver import backend
from taichi_ldem.solver import memory
scene = block_scene(200, 200, 6, material=DAMAGE, solver={"duration": 1e-3})
backend.start(scene.solver)
from taichi_ldem.solver.simulation import Simulation
simulation = Simulation(scene)
simulation.sample_step()
simulation.saved_state()
print(memory.needed_bytes(scene), 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss has other units elsewhere")
def test_what_is_said_to_be_needed_is_taken() -> None:
    command = [sys.executable, "-c", PEAK]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    needed, taken = map(int, done.stdout.split())
    assert taken < needed < 1.3 * taken


def test_too_large_a_lattice_is_named_with_the_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = block_scene(100, 100, 10)
    needed = memory.needed_bytes(scene)
    monkeypatch.setattr(memory, "available_bytes", lambda: needed)
    memory.refuse_too_large(scene)
    monkeypatch.setattr(memory, "available_bytes", lambda: needed - 1)
    with pytest.raises(SceneError, match=rf"need about {needed:,} bytes of memory"):
        memory.refuse_too_large(scene)
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    memory.refuse_too_large(scene)


@pytest.mark.parametrize(
    ("layers", "precision", "share", "remedy"),
    [
        (10, "f64", 0.5, "take fewer modules (about 7)"),
        (10, "f32", 0.99, "take fewer modules (about 9)"),
        (10, "f64", 0.99, 'take fewer modules (about 9) or solver.precision = "f32"'),
        (1, "f32", 0.5, "take a smaller plate"),
    ],
)
def test_what_is_proposed_for_too_large_a_lattice_helps(
    monkeypatch: pytest.MonkeyPatch, layers: int, precision: str, share: float, remedy: str
) -> None:
    """f32 was proposed to scenes in f32, and a single layer to scenes of a single layer."""
    scene = block_scene(300, 300, layers, solver={"precision": precision})
    free = int(memory.BASE + share * (memory.needed_bytes(scene) - memory.BASE))
    monkeypatch.setattr(memory, "available_bytes", lambda: free)
    with pytest.raises(SceneError) as error:
        memory.refuse_too_large(scene)
    assert str(error.value).endswith(remedy)


def test_a_limit_of_addresses_below_taichi_s_pool_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taichi gave a traceback about `host_memory_pool` after the set-up."""
    monkeypatch.setattr(memory, "addresses_left", lambda: 10**9)
    with pytest.raises(SceneError, match=r"leaves 1,000,000,000 bytes .* raise it \(ulimit -v\)"):
        memory.refuse_too_large(block_scene(4, 4, 1))
    monkeypatch.setattr(memory, "addresses_left", lambda: 2 * 10**9)
    memory.refuse_too_large(block_scene(4, 4, 1))


def test_info_refuses_a_plate_that_is_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """It ended in a MemoryError with a traceback."""
    monkeypatch.setattr(memory, "available_bytes", lambda: 10**6)
    with pytest.raises(SceneError, match="bytes of memory"):
        describe(block_scene(4, 4, 2))
    with pytest.raises(SceneError, match="bytes of memory"):
        Simulation(block_scene(4, 4, 2))


def test_vulkan_reaches_four_gib(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taichi's offsets into its fields have 32 bits there, and wrap around in silence."""
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    for arch in ("vulkan", "cuda"):
        scene = block_scene(1000, 1000, 30, solver={"arch": arch})
        assert memory.field_bytes(scene) > 2**32
        if arch == "vulkan":
            with pytest.raises(SceneError, match=r"Taichi can address 4 GiB"):
                memory.refuse_too_large(scene)
        else:
            memory.refuse_too_large(scene)
