"""Envelopes and panels of groups."""

import numpy as np

from taichi_ldem.ensemble.figures import envelope, make_panels
from taichi_ldem.ensemble.results import Row


def test_envelope_of_records_on_different_times():
    coarse, fine = np.linspace(0.0, 1.0, 6), np.linspace(0.0, 0.9, 10)
    found = envelope([(coarse, 2 * coarse), (fine, 4 * fine), (fine, 0 * fine)])
    assert np.allclose(found.time, fine)
    assert np.allclose(found.high, 4 * fine)
    assert np.allclose(found.low, 0.0)
    assert np.allclose(found.mean, 2 * fine)


def test_groups_of_one_member_stand_side_by_side(plan):
    rows = [Row(member, {}, (), "finished") for member in plan.members]
    panels = make_panels(rows, {member.name: None for member in plan.members})
    assert panels == [("", [(f"velocity {v}", None) for v in ("2", "2.5", "3")])]
