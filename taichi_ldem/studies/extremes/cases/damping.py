"""Mass-proportional damping, from none to far beyond the critical one."""

from taichi_ldem.studies.extremes.case import STABLE, Case
from taichi_ldem.studies.extremes.setups import shaken

IMPLICIT = "implicit and diagonal: stable for any damping"

CASES = tuple(
    Case(
        f"damping {name}",
        "damped",
        STABLE,
        IMPLICIT,
        {"solver.damping": coefficient},
        set_up=shaken(),
        share=0.99,
        drift=1e-6,
    )
    for name, coefficient in (
        ("zero", 1e-20),
        ("critical of the lowest mode", 2.5e6),
        ("critical of the highest mode", 5e7),
        ("a hundred times beyond", 5e9),
    )
)
