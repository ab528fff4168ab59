"""Materials that differ from bar to bar, by a distribution or by a factor of 1e6."""

from taichi_ldem.studies.extremes.case import ABOVE_CRITICAL, STABLE, STOPPED, Case
from taichi_ldem.studies.extremes.checks import breaks
from taichi_ldem.studies.extremes.setups import neighbours, shaken, tearing

ASSEMBLED = "the estimate is of the assembled lattice, bar by bar"
WIDE = {
    f"disorder.{name}": 1.5 for name in ("fracture_energy_cv", "youngs_modulus_cv", "density_cv")
}

DISTRIBUTED = (
    Case(
        "disorder of CV 1.5 in G_f, E and density",
        "disordered",
        STABLE,
        ASSEMBLED,
        WIDE,
        set_up=tearing(40.0),
        check=breaks(10),
        drift=0.05,
    ),
    Case(
        "disorder of CV 1.5 at 0.99 of the step",
        "disordered",
        STABLE,
        ASSEMBLED,
        WIDE,
        set_up=shaken(1e-5),
        share=0.99,
    ),
    Case(
        "disorder of CV 1.5 at 1.05 of the step",
        "disordered",
        STOPPED,
        ASSEMBLED,
        WIDE,
        set_up=shaken(1e-5),
        share=1.05,
        says=ABOVE_CRITICAL,
    ),
    Case(
        "strengths of neighbouring bars 1e6 apart",
        "disordered",
        STABLE,
        "bars that cannot break hold their neighbours' ends",
        set_up=neighbours("strength", 1e6, 40.0),
        check=breaks(10),
        drift=0.05,
    ),
)

NEIGHBOURS = tuple(
    Case(
        f"{name} 1e6 apart, {share}",
        "disordered",
        STABLE if share < 1 else STOPPED,
        ASSEMBLED,
        set_up=neighbours(quantity, 1e6),
        share=share,
        says="" if share < 1 else ABOVE_CRITICAL,
    )
    for quantity, name in (("E", "E of neighbouring bars"), ("density", "density of neighbours"))
    for share in (0.99, 1.05)
)

CASES = (*DISTRIBUTED, *NEIGHBOURS)
