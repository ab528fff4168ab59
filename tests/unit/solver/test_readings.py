"""What bars carry and have lost, read without changing their history."""

import numpy as np
import pytest
from support.blocks import Breakable


@pytest.mark.parametrize("breakable", ["bilinear"], indirect=True)
def test_readings_are_the_forces_and_the_integrity_of_the_bars(breakable: Breakable) -> None:
    """Bars at random places: elastic, softened or failed, pulled and pressed."""
    from taichi_ldem.solver.readings import BarReadings

    block, body = breakable.renew(), breakable.body
    dynamics = block.dynamics
    # pulled by so much first that some bars soften and some fail, then let go by a half
    moved = np.random.default_rng(7).normal(0.0, 0.03 * block.spacing, (len(body.places), 3))
    block.put(moved)
    moved *= 0.5
    dynamics.set_displacement(0, body.spread(moved))
    peaks = dynamics.lanes.gather(dynamics.peak.to_numpy())
    read = np.zeros((3, dynamics.cell.bars, *dynamics.sites))
    for k, values in BarReadings(dynamics).layers(0):
        read[:, :, k] = values
    after = dynamics.lanes.gather(dynamics.peak.to_numpy())
    np.testing.assert_array_equal(after, peaks)

    def of_bars(field: np.ndarray) -> np.ndarray:
        return body.bar_values(np.moveaxis(field, 0, -1), dynamics.lattice.bar_midpoints)

    pull, whole, left = (of_bars(field) for field in read)
    peak, strain = of_bars(np.array(peaks)), body.strains(moved)
    limit = body.per_bar(*(family.ductility for family in block.bars))
    kept = np.clip((limit - peak) / ((limit - 1) * np.maximum(peak, 1)), 0, 1)
    kept[peak <= 1] = 1.0
    assert min((kept == 0).sum(), (kept == 1).sum(), ((kept > 0) & (kept < 1)).sum()) > 10
    stiffness = body.weights * body.per_bar(*(family.axial_stiffness for family in block.bars))
    np.testing.assert_allclose(whole, stiffness / body.lengths, rtol=1e-13)
    np.testing.assert_allclose(left, whole * kept, rtol=1e-9, atol=1e-12 * whole.max())
    carried = np.where(strain > 0, kept, kept > 0)  # in compression, a bar is whole until it fails
    wanted = carried * whole * strain / (1 + strain)
    np.testing.assert_allclose(pull, wanted, rtol=1e-9, atol=1e-12 * whole.max())
