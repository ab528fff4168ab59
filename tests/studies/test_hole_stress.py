"""The stress beside a hole: closed forms, and strips so small that they are solved in a second."""

import numpy as np
import pytest

from studies.hole_stress import howland, main, scene_of, stretched
from taichi_ldem.model.lattice import Lattice, prism


def test_howlands_stress_has_the_limits_of_a_wide_and_of_a_narrow_plate() -> None:
    assert howland(1e-9) == pytest.approx(3.0, rel=2e-3)  # Kirsch's
    assert howland(0.999) * 0.001 == pytest.approx(2.0, rel=1e-3)  # on the net section
    assert howland(0.2) == pytest.approx(3.15, rel=1e-3)


def test_a_strip_without_a_hole_carries_e_times_the_strain() -> None:
    scene = scene_of(4, 0.5, 2)
    edge = scene.plate.spacing
    lattice = Lattice(prism(16, 8, 2), edge)
    moved, force = stretched(lattice, scene)
    stiffness = scene.material.youngs_modulus * 16 * edge**2 / (16 * edge)
    assert force == pytest.approx(stiffness, rel=0.08)  # two layers of modules are softer
    x = np.where(lattice.exists(), lattice.grid()[..., 0], 0.0)
    ends = np.abs(x) > 7.9 * edge
    np.testing.assert_allclose(moved[..., 0][ends], 0.5 * np.sign(x[ends]))


def test_the_study_prints_the_stresses_that_its_page_has(capsys: pytest.CaptureFixture) -> None:
    main(["--diameters", "6", "--layers", "2"])
    first, second = capsys.readouterr().out.splitlines()
    assert first == "Howland, d / W = 0.2: 3.149; on the edge and one module off it"
    assert second == "6 modules: 2.200 (-30.1 %), 1.864"
