"""The surface of the plate that is drawn."""

import numpy as np
from support.modules import fields_of

from taichi_ldem.output.render.surfaces import FAILED_SHARE, exterior


def test_one_module_shows_six_faces_with_outward_normals():
    fields = fields_of(np.ones((1, 1, 1), dtype=bool), np.zeros(1), displacement=2.0)
    surface = exterior(fields, np.ones(1, dtype=bool))
    outward = surface.corners.mean(axis=1) - 2.5  # the middle of the displaced module
    np.testing.assert_allclose(surface.normals, 2 * outward, atol=1e-12)
    assert sorted(map(tuple, np.rint(2 * outward).astype(int))) == sorted(
        [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    )
    assert not surface.opened.any()


def test_shared_faces_are_drawn_only_once_a_crack_opens_them():
    mask = np.ones((1, 1, 3), dtype=bool)
    part = np.ones(3, dtype=bool)
    whole = exterior(fields_of(mask, np.zeros(3)), part)
    assert len(whole.corners) == 14  # a 3 x 1 x 1 prism
    cracked = exterior(fields_of(mask, np.array([0.1, FAILED_SHARE, 0.3])), part)
    assert len(cracked.corners) == 12  # two separate modules
    assert cracked.opened.sum() == 2
    np.testing.assert_allclose(np.unique(cracked.value), np.float32([0.1, 0.3]))


def test_a_module_that_a_corner_has_left_is_not_drawn():
    fields = fields_of(np.ones((1, 1, 2), dtype=bool), np.zeros(2))
    fields.displacement[fields.hexahedra[1, 6]] = 9.0  # a corner of the second module only
    surface = exterior(fields, np.ones(2, dtype=bool))
    assert len(surface.corners) == 6
    assert surface.corners.max() <= 1.0
    assert surface.opened.sum() == 1


def test_a_cut_face_is_not_taken_for_a_cracks_wall():
    mask = np.ones((1, 2, 1), dtype=bool)
    cut = exterior(fields_of(mask, np.zeros(2)), np.array([False, True]))
    assert len(cut.corners) == 6
    assert not cut.opened.any()
