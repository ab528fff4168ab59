"""A nose that is one new file: the flat punch of docs/extending.md, in this process."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene
from support.paths import ROOT
from support.reference import Body

from taichi_ldem.solver.contact import noses

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.striker import Striker
    from taichi_ldem.solver.simulation import Simulation

NAME = "punch"
RADIUS, GAP, MASS, SPEED = 1.3e-3, 1e-6, 20e-6, 10.0
PLACE = (0.3e-3, -0.2e-3)  # off the plate's middle, so that no symmetry hides a mistake
MODULE_MASS = PMMA["density"] * SPACING**3


@pytest.fixture(scope="module")
def punch(taichi: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator["Simulation"]:
    """A free plate below a flat punch, whose file lies in a folder of noses outside the package."""
    from taichi_ldem.solver.simulation import Simulation

    folder, page = tmp_path_factory.mktemp("noses"), Path(ROOT / "docs" / "extending.md")
    text = re.search(
        rf"^```python\n# \S+/noses/{NAME}\.py\n(.*?)^```", page.read_text(), re.M | re.S
    )
    assert text is not None
    (folder / f"{NAME}.py").write_text(text[1], encoding="utf-8")
    noses.__path__.append(str(folder))
    striker = {"diameter": 2 * RADIUS, "mass": MASS, "velocity": SPEED}
    scene = block_scene(8, 8, 3, striker=striker | {"position": PLACE, "gap": GAP})
    # the names that a scene may use were read from the package's own folder
    shaped = scene.striker.model_copy(update={"shape": NAME}) if scene.striker else None
    try:
        yield Simulation(scene.model_copy(update={"strikers": (shaped,)}))
    finally:
        noses.__path__.remove(str(folder))
        sys.modules.pop(f"{noses.__name__}.{NAME}", None)


def _depth(places: np.ndarray, tip: float) -> float:
    """How deep the deepest place lies inside a punch whose end is at a height, m."""
    from_axis = np.hypot(*(places[:, :2] - PLACE).T)
    return float(np.minimum(RADIUS - from_axis, places[:, 2] - tip).max())


def test_a_flat_punch_keeps_momentum_and_energy_and_lets_no_node_in(punch: "Simulation") -> None:
    body = Body(punch.dynamics.lattice.mask, SPACING)
    mass = MODULE_MASS * body.mass_shares
    striker: Striker = punch.body("striker")
    touched, momentum, errors, depths = 0, [], [], []
    for _ in range(300):
        errors.append(punch.sample_step().energy_error)
        travelled, _, speed = striker.motion()
        velocity = punch.dynamics.get_velocity()[body.index]
        momentum.append(MASS * speed - (mass * velocity[:, 2]).sum())
        height = 3 * SPACING + GAP - travelled
        places = body.positions + punch.displacement()[body.index]
        depths.append(_depth(places, height))
        touched = max(touched, np.count_nonzero(np.abs(places[:, 2] - height) < 1e-9 * SPACING))
    np.testing.assert_allclose(momentum, MASS * SPEED, rtol=1e-12)
    assert max(depths) < 1e-9 * SPACING
    assert max(errors) < 5e-4  # as for the round noses
    # corners (i, j) L of the upper face under the punch: (i L - 0.3 mm)^2 + (j L + 0.2 mm)^2 <
    # (1.3 mm)^2 holds for 4 + 5 + 5 + 4 + 2 in the rows i = -1 to 3
    under = np.hypot(*(body.positions[:, :2] - PLACE).T) < RADIUS
    assert touched == np.count_nonzero(under & (body.places[:, 2] == 6)) == 20
    assert speed < 0.95 * SPEED


def test_a_flat_punch_is_drawn_with_its_end_at_the_tip(punch: "Simulation") -> None:
    from taichi_ldem.solver.contact.striker import striker_faces

    table = punch.scene.striker
    assert table is not None
    corners = striker_faces(table, 4e-3, 5e-3).reshape(-1, 3)
    end = corners[corners[:, 2] == 5e-3]
    assert corners[:, 2].min() == 5e-3
    assert np.hypot(*(end[:, :2] - PLACE).T).max() == pytest.approx(RADIUS)
