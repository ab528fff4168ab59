"""Fracture: bodies that crack, and laws at the ends of their ranges."""

from taichi_ldem.studies.extremes.case import STABLE, Case
from taichi_ldem.studies.extremes.checks import all_of, breaks, conserves
from taichi_ldem.studies.extremes.setups import all_broken, spinning, tearing

CASES = (
    Case(
        "a turn while cracking",
        "breaking",
        STABLE,
        "central forces keep angular momentum",
        set_up=spinning(10, 1.5),
        check=all_of(conserves(1e-9), breaks(1)),
        drift=0.05,
    ),
    Case(
        "every bar broken at once",
        "breaking",
        STABLE,
        "no forces: free flight of every node",
        set_up=all_broken(10.0),
        check=conserves(1e-12),
        drift=1e-9,
    ),
    Case(
        "K_r = 1.0001",
        "breaking",
        STABLE,
        "the law's jump costs energy of first order in the strain of a step",
        {"material.failure_strain": 0.0175} | {"material.limit_strain": 0.0175 * 1.0001},
        set_up=tearing(40.0),
        check=breaks(10),
        drift=0.05,
    ),
    Case(
        "K_r = 50",
        "breaking",
        STABLE,
        "a soft tail: second order",
        {"material.failure_strain": 0.0175} | {"material.limit_strain": 0.0175 * 50},
        set_up=tearing(100.0),
        drift=0.01,
    ),
    Case(
        "eps_p = 1e-7",
        "breaking",
        STABLE,
        "the estimate of the step must not break bars",
        {"material.failure_strain": 1e-7, "material.limit_strain": 1e-6},
        set_up=lambda b: b.start(),
        check=lambda b: (
            ""
            if b.result.broken == 0 and not b.simulation.dynamics.touched.to_numpy().any()
            else "bars were damaged at rest"
        ),
    ),
    Case(
        "torn apart at 300 m/s",
        "breaking",
        STABLE,
        "every bar fails within a few steps",
        set_up=tearing(300.0),
        check=breaks(100),
        drift=0.05,
    ),
)
