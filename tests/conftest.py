"""Taichi, started once a process, and the elastic block that most solver tests share."""

import os
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest
from support.blocks import Breakable, block_scene
from support.reference import Body

from taichi_ldem.scene import Solver
from taichi_ldem.solver import backend

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

# Nearly all time of the tests goes into the compilation of kernels, and over half of that into a
# group of Taichi's passes. They simplify code that LLVM then simplifies anyway: without them,
# results are the same to the last bit, which `test_regression` checks, and the step is slower.
# Child processes inherit the setting.
os.environ.setdefault("TI_ADVANCED_OPTIMIZATION", "0")


def _program() -> Any:
    """What holds all fields and kernels of this process, if Taichi has been started."""
    taichi = sys.modules.get("taichi")
    return taichi and taichi.lang.impl.get_runtime().prog


@pytest.fixture(scope="session")
def taichi() -> None:
    """Taichi on the CPU in f64; modules with kernels are imported after it."""
    backend.start(Solver(duration=1.0))


@pytest.fixture(autouse=True)
def _taichi_is_started_once(request: pytest.FixtureRequest) -> Iterator[None]:
    """A test that starts Taichi anew takes the fields of all others away: it fails, not they."""
    if "taichi" in request.fixturenames:
        request.getfixturevalue("taichi")
    before = _program()
    yield
    assert before is None or _program() is before, "Taichi was started again in this process"
    assert "taichi" in request.fixturenames or _program() is before, "start Taichi in a fixture"


@pytest.fixture(scope="session")
def _elastic_block(taichi: None) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(block_scene(20, 3, 2))


@pytest.fixture
def elastic(_elastic_block: "Simulation") -> "Simulation":
    """A free elastic block of 20 x 3 x 2 modules, at rest."""
    simulation = _elastic_block
    simulation.reset(simulation.scene)
    simulation.time_step = 0.9 * simulation.critical_time_step
    return simulation


@pytest.fixture
def body(elastic: "Simulation") -> Body:
    """The same block, bar by bar."""
    lattice = elastic.dynamics.lattice
    return Body(lattice.mask, lattice.spacing, lattice.surface_weights)


@pytest.fixture(scope="session", params=["bilinear", "exponential"])
def breakable(taichi: None, request: pytest.FixtureRequest) -> Breakable:
    """A block of 3 x 3 x 3 modules whose nodes are put where a test wants them, for both laws."""
    return Breakable(request.param)
