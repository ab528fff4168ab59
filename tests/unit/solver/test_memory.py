"""What a scene is said to need, against the fields that are built and what a process takes."""

import subprocess
import sys

import pytest
from support.blocks import DAMAGE, block_scene
from support.paths import ROOT

from taichi_ldem.errors import SceneError
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
