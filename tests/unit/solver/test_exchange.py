"""Copies to and from the host, and the list of broken bars."""

from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import Breakable, random_displacement
from support.reference import Body

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation


def test_nodes_come_back_as_they_were_sent(elastic: "Simulation", body: Body) -> None:
    dynamics = elastic.dynamics
    displacement = body.spread(random_displacement(body, 1e-6))
    velocity = body.spread(random_displacement(body, 1.0, seed=2))
    dynamics.set_displacement(1, displacement)
    dynamics.set_velocity(velocity)
    found = np.zeros_like(displacement)
    dynamics.get_displacement(1, found)
    np.testing.assert_array_equal(found, displacement)
    np.testing.assert_array_equal(dynamics.get_velocity(), velocity)


def test_forces_are_read_without_touching_velocities(elastic: "Simulation", body: Body) -> None:
    dynamics = elastic.dynamics
    dynamics.set_displacement(0, body.spread(random_displacement(body, 1e-6)))
    velocity = body.spread(random_displacement(body, 1.0, seed=2))
    dynamics.set_velocity(velocity)
    force = dynamics.get_force(0)
    np.testing.assert_array_equal(dynamics.get_velocity(), velocity)
    # internal forces cancel; the sum of some 500 of them rounds
    assert np.abs(force.sum(axis=(0, 1, 2, 3))).max() < 1e-12 * np.abs(force).sum()


def test_broken_bars_come_in_order_and_once_in_any_batch(
    breakable: Breakable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More bars break at a time than one batch holds; the next one has the rest."""
    from taichi_ldem.solver import exchange

    block = breakable.renew()
    block.put(np.zeros((len(block.body.places), 3)))
    block.dynamics.new_broken()
    monkeypatch.setattr(exchange, "BATCH", 16)
    block.put(0.5 * block.body.positions)  # 50 % strain: beyond any limit strain here
    sites, bars = block.dynamics.new_broken()
    assert len(bars) == block.dynamics.lattice.bars > 16
    rows = np.column_stack([sites, bars]).tolist()
    assert rows == sorted(rows)
    assert len({tuple(row) for row in rows}) == len(rows)
    assert not len(block.dynamics.new_broken()[1])
    recorded = block.dynamics.recorded_bits()
    assert sum(bin(bits).count("1") for bits in recorded.ravel().tolist()) == len(bars)
