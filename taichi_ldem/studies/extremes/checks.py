"""Checks at the end of a case; each returns the difference from the prediction, or nothing."""

from collections.abc import Callable

import numpy as np

from taichi_ldem.studies.extremes.bench import Bench

Check = Callable[[Bench], str]


def conserves(size: float) -> Check:
    """Momentum and angular momentum are conserved, up to a share of the sum of their magnitudes."""

    def check(bench: Bench) -> str:
        before, after = bench.kept["momentum"], bench.momentum()
        momentum = bench.masses * np.linalg.norm(
            bench.simulation.dynamics.get_velocity(), axis=-1, keepdims=True
        )
        distance = np.linalg.norm(bench.places + bench.simulation.displacement(), axis=-1)[
            ..., None
        ]
        scale = np.array([momentum.sum(), (distance * momentum).sum()])[:, None]
        worst = float(np.abs((after - before) / scale).max())
        return "" if worst < size else f"momentum changed by {worst:.1e} of the sum of magnitudes"

    return check


def breaks(least: int) -> Check:
    """At least so many bars break."""
    return lambda b: "" if b.result.broken >= least else f"only {b.result.broken} bars broke"


def all_of(*checks: Check) -> Check:
    """All checks together."""
    return lambda bench: "; ".join(filter(None, (check(bench) for check in checks)))


def moves_on(share: float) -> Check:
    """The striker keeps at least this share of its velocity."""

    def check(bench: Bench) -> str:
        body, scene = bench.simulation.body("striker"), bench.scene.striker
        assert body is not None
        assert scene is not None
        now = body.motion()[2] / scene.velocity
        return "" if share <= now <= 1 + 1e-9 else f"striker at {now:.6g} of its velocity"

    return check


def unmoved(bench: Bench) -> str:
    """No node has a displacement."""
    largest = float(np.abs(bench.simulation.displacement()).max())
    return "" if largest == 0.0 else f"displaced by {largest:.1e} m"
