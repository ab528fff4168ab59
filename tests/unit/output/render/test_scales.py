"""Quantities by which modules are coloured."""

from pathlib import Path

import numpy as np
import pytest
from support.modules import displaced
from support.synthetic import synthetic_run

from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.output.render.scales import scale_of, speed, strain_energy
from taichi_ldem.storage.fields import FieldWriter, read_fields


def test_speed_is_that_of_the_corners() -> None:
    np.testing.assert_allclose(speed(displaced(np.zeros((3, 3)), (0.0, 3.0, -4.0))), 5.0)


def test_strain_energy_of_homogeneous_strains() -> None:
    """Uniaxial strain: C11/2 e2; simple shear: 2 C44 (g/2)^2 and what Green's strain adds."""
    strain = 2.0**-10  # exact in single precision
    pulled = np.zeros((3, 3))
    pulled[0, 0] = strain
    green = strain + strain**2 / 2
    energy = strain_energy(displaced(pulled, (0, 0, 0)), (6.0, 2.0, 2.0))
    np.testing.assert_allclose(energy, [3 * green**2] * 2 + [np.nan] + [3 * green**2], rtol=1e-12)
    sheared = np.zeros((3, 3))
    sheared[1, 2] = strain
    energy = strain_energy(displaced(sheared, (0, 0, 0)), (6.0, 2.0, 2.0))[0]
    assert energy == pytest.approx(4 * (strain / 2) ** 2 + 3 * (strain**2 / 2) ** 2, rel=1e-12)


def test_a_rotation_has_no_strain_energy() -> None:
    cosine, sine = np.cos(0.7), np.sin(0.7)
    turned = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) - np.eye(3)
    energy = strain_energy(displaced(turned, (0, 0, 0)), (6.0, 2.0, 2.0))
    assert np.nanmax(np.abs(energy)) < 1e-12


def test_pieces_have_colours_in_a_run_whose_scene_did_not_ask_for_them(
    taichi: None, tmp_path: Path
) -> None:
    """They follow from the broken bars; before the first of them, the plate is one piece."""
    run = synthetic_run(tmp_path / "run", cracked=False)
    first = read_fields(run.fields_file, 0)
    plate = Lattice(prism(58, 58, 2), 1.6e-3)
    cut = plate.bars_crossing(0, 8e-3, (-1.0, -1.0), (1.0, 1.0))
    sites, bars = np.divmod(np.flatnonzero((cut[..., None] >> np.arange(14)) & 1), 14)
    middle = plate.bar_midpoints(np.argwhere(np.ones(plate.sites))[sites], bars)
    writer = FieldWriter(run.fields_file, first.points, first.hexahedra, written=(3, 0))
    writer.append_broken(np.full(len(bars), 2e-3), middle, bars)
    scale = scale_of(run, [0, 2], "fragment")
    assert (scale.value(first) == 1).all()
    last = read_fields(run.fields_file, 2)
    left = last.points[last.hexahedra[:, 0], 0] < 7.9e-3
    np.testing.assert_array_equal(scale.value(last), np.where(left, 1, 2))
    colours = scale.rgb(np.array([0.0, 1.0, 2.0, 18.0]))
    assert len(np.unique(colours.round(6), axis=0)) == 4
