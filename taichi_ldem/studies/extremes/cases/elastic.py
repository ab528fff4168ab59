"""Time steps and elastic constants: how the critical step follows from the material."""

from typing import Any

from taichi_ldem.studies.extremes.case import ABOVE_CRITICAL, LINEAR, STABLE, STOPPED, Case
from taichi_ldem.studies.extremes.setups import contrast, shaken


def bracketed(name: str, changes: dict[str, Any], because: str, **more: Any) -> list[Case]:
    """Stable at 0.99 and not at 1.05 of the estimated step: the estimate brackets the limit."""
    group = more.pop("group", "free")
    below = Case(
        f"{name}, 0.99", group, STABLE, because, changes, set_up=shaken(), share=0.99, **more
    )
    above = Case(
        f"{name}, 1.05",
        group,
        STOPPED,
        because,
        changes,
        says=ABOVE_CRITICAL,
        set_up=shaken(),
        share=1.05,
        **more,
    )
    return [below, above]


TIME_ABOVE_CRITICALS = tuple(
    Case(
        f"time step {share}",
        "free",
        STABLE if share < 1 else STOPPED,
        LINEAR,
        says="" if share < 1 else ABOVE_CRITICAL,
        set_up=shaken(),
        share=share,
        drift=1e-6,
        quick=True,
    )
    for share in (0.5, 0.9, 0.99, 1.01, 1.1, 2.0)
)

MODULI = (
    Case(
        "E = 1 kPa",
        "free",
        STABLE,
        "only the step scales with E",
        {"material.youngs_modulus": 1e3},
        set_up=shaken(1e-7),
        share=0.99,
        quick=True,
    ),
    Case(
        "E = 1 TPa",
        "free",
        STABLE,
        "only the step scales with E",
        {"material.youngs_modulus": 1e12},
        set_up=shaken(),
        share=0.99,
        quick=True,
    ),
    Case(
        "E = 1 TPa in f32",
        "free-f32",
        STABLE,
        "within the range of f32",
        {"material.youngs_modulus": 1e12},
        set_up=shaken(),
        share=0.99,
    ),
    Case(
        "E = 1 kPa in f32",
        "free-f32",
        STABLE,
        "within the range of f32",
        {"material.youngs_modulus": 1e3},
        set_up=shaken(1e-7),
        share=0.99,
    ),
)

DENSITIES = tuple(
    Case(
        f"density {density:g}",
        "free",
        STABLE,
        "only the step scales with density",
        {"material.density": density},
        set_up=shaken(),
        share=0.99,
    )
    for density in (1.0, 2.2e4)
)

POISSON_RATIOS = tuple(
    case
    for stiffness, ratios, because in (
        ("equation-2", (0.1, 0.4, 0.49, 0.4999), "omega_max follows EA_d / EA_l"),
        ("volumetric", (0.0, 0.4999), "omega_max follows lambda - mu"),
    )
    for nu in ratios
    for case in bracketed(
        f"nu = {nu}, {stiffness}",
        {"material.poisson_ratio": nu, "plate.stiffness": stiffness},
        because,
    )
)

CONTRASTS = tuple(
    Case(
        f"{quantity} contrast 1e6 between faces and inside",
        "free",
        STABLE,
        "the estimate is of the assembled lattice",
        set_up=contrast(quantity, 1e6),
        share=0.99,
    )
    for quantity in ("stiffness", "density")
)

CASES = (
    *TIME_ABOVE_CRITICALS,
    *MODULI,
    *DENSITIES,
    *POISSON_RATIOS,
    *CONTRASTS,
    *bracketed("f32", {}, LINEAR, group="free-f32"),
)
