"""Stored fields of a few modules, for the tests of what is drawn."""

import numpy as np

from taichi_ldem.storage.store import Fields, hexahedral_mesh


def fields_of(mask: np.ndarray, broken: np.ndarray, displacement: float = 0.0) -> Fields:
    points, hexahedra, _ = hexahedral_mesh(mask, 1.0, (0.0, 0.0, 0.0))
    field = np.full((len(points), 3), displacement, dtype=np.float32)
    fraction = broken.astype(np.float32)
    return Fields(points, hexahedra, field, field, fraction, 0.0, np.zeros(1))


def displaced(gradient: np.ndarray, velocity: tuple[float, float, float]) -> Fields:
    """2 x 2 x 1 modules of edge 0.5, displaced by a homogeneous gradient."""
    points, hexahedra, _ = hexahedral_mesh(np.ones((1, 2, 2), dtype=bool), 0.5, (0.0, 0.0, 0.0))
    broken = np.array([0.0, 0.0, 0.25, 0.0], dtype=np.float32)
    field = np.tile(np.float32(velocity), (len(points), 1))
    displacement = (points @ gradient.T).astype(np.float32)
    return Fields(points, hexahedra, displacement, field, broken, 0.0, np.zeros(1))
