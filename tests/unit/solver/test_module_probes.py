"""Strain and stress in probes, against Hooke's law and the fields of the whole lattice."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import PMMA, Breakable

from taichi_ldem.errors import SceneError
from taichi_ldem.scene.loads import Probe
from taichi_ldem.solver.module_fields import ModuleFields
from taichi_ldem.storage.fields import hexahedral_mesh

if TYPE_CHECKING:
    from taichi_ldem.solver.module_probes import PartReadings

BOTH = ("strain", "stress")
TINY = 1e-9
MODULUS, SHEAR = PMMA["youngs_modulus"], PMMA["youngs_modulus"] / 2.5


@pytest.fixture(scope="module")
def readings(taichi: None) -> "PartReadings":
    """Those of a block of 3 x 3 x 3 modules."""
    from taichi_ldem.solver.module_probes import PartReadings

    return PartReadings(Breakable("bilinear").dynamics)


def _means(readings: "PartReadings", **region: object) -> tuple[np.ndarray, np.ndarray]:
    """Strain and stress (6,) of a probe of the block."""
    from taichi_ldem.solver.module_probes import modules_of

    probe = Probe(name="p", quantities=BOTH, **region)  # type: ignore[arg-type]
    found = modules_of(readings, [probe])[0].means(0)
    return found["strain"], found["stress"]


def _deform(readings: "PartReadings", gradient: np.ndarray) -> None:
    lattice = readings.dynamics.lattice
    moved = (lattice.positions() @ gradient.T) * lattice.exists()[..., None]
    readings.dynamics.set_displacement(0, moved)


def test_a_probe_of_a_uniformly_strained_block_has_hookes_stress(readings: "PartReadings") -> None:
    gradient = TINY * np.array([[3.0, 2.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 2.0]])
    _deform(readings, gradient)
    middle = (0.0, 0.0, 1.5 * readings.dynamics.lattice.spacing)
    strain, stress = _means(readings, point=middle)
    small = (gradient + gradient.T) / 2
    pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]
    np.testing.assert_allclose(strain, [small[pair] for pair in pairs], atol=1e-7 * TINY)
    hooke = SHEAR * (np.trace(small) * np.eye(3) + 2 * small)
    wanted = [hooke[pair] for pair in pairs]
    np.testing.assert_allclose(stress, wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())


def test_a_probe_of_a_turned_block_has_neither_strain_nor_stress(
    readings: "PartReadings",
) -> None:
    turned, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    _deform(readings, turned * np.sign(np.linalg.det(turned)) - np.eye(3))
    strain, stress = _means(readings, box=((-1, -1, -1), (1, 1, 1)))
    assert np.abs(strain).max() < 1e-12
    assert np.abs(stress).max() < 1e-12 * MODULUS


def test_probes_are_means_of_the_fields_of_the_whole_lattice(readings: "PartReadings") -> None:
    """Also where they look at a part of it only, and where bars have softened."""
    dynamics = readings.dynamics
    lattice, edge = dynamics.lattice, dynamics.lattice.spacing
    moved = np.random.default_rng(7).normal(0.0, 0.03 * edge, (2, *lattice.sites, 3))
    moved *= lattice.exists()[..., None]
    dynamics.set_displacement(0, moved)
    dynamics.peak.fill(2.0)
    points, cells, sites = hexahedral_mesh(lattice.mask, edge, lattice.origin)
    corners = tuple((sites + 1).T)
    at_rest = lattice.positions()[0][corners]
    fields = ModuleFields(dynamics, BOTH, at_rest, cells, readings=readings.bars)
    whole = fields.at_sample(0, moved, moved[0][corners])
    upper = np.flatnonzero(points[cells].mean(axis=1)[:, 2] > edge).tolist()
    for region, modules in (
        ({"point": (9.0, -9.0, 0.0)}, [2]),
        ({"box": ((-9, -0.1 * edge, 0), (9, 0.1 * edge, edge))}, [3, 4, 5]),
        ({"plane": "z", "position": 2 * edge}, upper),
    ):
        found = _means(readings, **region)
        for quantity, one in zip(BOTH, found, strict=True):
            wanted = whole[quantity][modules].mean(axis=0)
            np.testing.assert_allclose(one, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    dynamics.peak.fill(0.0)


def test_a_probe_without_a_module_is_refused_in_one_line(readings: "PartReadings") -> None:
    box = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(SceneError, match=r"^probe\[0\]\.box = .* holds no centre of a module"):
        _means(readings, box=box)
