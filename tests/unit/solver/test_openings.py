"""Notches that open during a run: what they take, and that a resumed run opens them alike."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import DAMAGE, PMMA, block_scene

from taichi_ldem.scene import Scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

STRAIN = 0.02
SLANTED = {"points": [[-1e-3, -1e-3, 0.0], [1e-3, 1e-3, 0.0], [-1e-3, -1e-3, 1e-3]]}
PENNY = {"centre": [2e-3, 0.0, 5e-4], "diameter": 1.2e-3, "direction": [1.0, 0.2, 0.0]}


def _scene(first: float | None, second: float | None) -> Scene:
    """A damaging block with two notches that open at given times; None: from the start."""
    notches: list[dict[str, Any]] = [dict(SLANTED), dict(PENNY)]
    for notch, time in zip(notches, (first, second), strict=True):
        notch |= {} if time is None else {"time": time}
    return block_scene(12, 6, 2, material=PMMA | DAMAGE, notch=notches)


@pytest.fixture(scope="module")
def opening(taichi: None) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(_scene(9.5e-7, 2e-6))


def _stretch(simulation: "Simulation", strain: float = STRAIN, speed: float = 0.0) -> None:
    """Stretch the body uniformly along x, let its two halves fly apart, and start."""
    lattice = simulation.dynamics.lattice
    u = np.zeros((2, *lattice.sites, 3))
    u[..., 0] = strain * lattice.positions()[..., 0]
    u *= lattice.exists()[..., None]
    simulation.start_from(u, speed * np.sign(u))


def _steps(simulation: "Simulation", time: float) -> int:
    return int(np.ceil(time / simulation.time_step))


def _removed(simulation: "Simulation") -> np.ndarray:
    dynamics = simulation.dynamics
    return np.asarray(dynamics.lanes.gather(dynamics.removed.to_numpy()))


@pytest.mark.parametrize("speed", [0.0, 5.0], ids=["released", "moving"])
def test_the_energy_that_a_notch_takes_closes_the_balance(
    opening: "Simulation", speed: float
) -> None:
    """At small strain, where nothing else is off, after a start at rest and in motion."""
    opening.reset(_scene(9.5e-7, 2e-6))
    _stretch(opening, 1e-5, speed)
    first, second = (_steps(opening, time) for time in (9.5e-7, 2e-6))
    taken, stored = [], []
    for _ in range(second + 20):
        sample = opening.sample_step()
        taken.append(sample.ledger.opened)
        stored.append(sample.ledger.stored)
    assert set(taken[:first]) == {0.0}
    assert len(set(taken)) == 3
    assert 0 < taken[first] == taken[second - 1] < taken[second] == taken[-1]
    openings = np.nonzero(np.diff(taken))[0]
    np.testing.assert_allclose(np.diff(stored)[openings] / np.diff(taken)[openings], 0, atol=1e-3)


def test_a_notch_that_opens_cuts_the_bars_of_one_from_the_start(opening: "Simulation") -> None:
    removed = []
    for time in (9.5e-7, None):
        opening.reset(_scene(time, time))
        _stretch(opening, 1e-4)
        opening.advance(_steps(opening, 9.5e-7))
        removed.append(_removed(opening))
        opening.advance(1)
    assert not removed[0].any()
    assert np.unpackbits(removed[1].view(np.uint8)).sum() > 40
    opening.reset(_scene(9.5e-7, 9.5e-7))
    opening.advance(_steps(opening, 9.5e-7) + 1)
    np.testing.assert_array_equal(_removed(opening), removed[1])


def test_a_broken_bar_stays_broken_when_a_notch_opens_there(opening: "Simulation") -> None:
    opening.reset(_scene(9.5e-7, 2e-6))
    _stretch(opening, 0.08)  # everything along x breaks in the first step
    broken = [opening.sample_step().broken_bars for _ in range(_steps(opening, 2e-6) + 3)]
    assert opening.openings.done == 2
    assert broken[0] > 300
    assert np.diff(broken).min() >= 0


@pytest.mark.parametrize("kept_after", [5, 30, 80], ids=["before", "between", "after"])
def test_a_resumed_run_opens_its_notches_alike(opening: "Simulation", kept_after: int) -> None:
    opening.reset(_scene(9.5e-7, 4e-6))
    assert _steps(opening, 9.5e-7) > 5
    _stretch(opening)
    opening.sample_step()
    opening.advance(kept_after - 1)
    kept = opening.saved_state()
    opening.advance(120 - kept_after)
    whole = opening.sample_step(), opening.displacement()
    assert opening.openings.done == 2
    for anew in (False, True):  # also into one whose notches are open already
        if anew:
            opening.reset(_scene(9.5e-7, 4e-6))
        opening.restore_state(kept)
        opening.advance(120 - kept_after)
        again = opening.sample_step(), opening.displacement()
        np.testing.assert_array_equal(again[1], whole[1])
        assert again[0].ledger == whole[0].ledger
        assert again[0].ledger.opened > 0


def test_scenes_without_a_time_have_no_openings(elastic: "Simulation") -> None:
    assert elastic.openings.times == []
    assert not any(name.startswith("openings/") for name in elastic.saved_state())
