"""Strikers of extreme mass, speed, size and place."""

from typing import Any

from taichi_ldem.studies.extremes.case import ABOVE_CRITICAL, LINEAR, STABLE, STOPPED, Case
from taichi_ldem.studies.extremes.checks import all_of, breaks, moves_on
from taichi_ldem.studies.extremes.scenes import SPACING
from taichi_ldem.studies.extremes.setups import all_broken, striker_at

HARD = "kinematic contact, implicit in the striker's velocity: no stiffness, no limit"
MASS, SPEED = "striker.mass", "striker.velocity"


def struck(name: str, changes: dict[str, Any], **more: Any) -> Case:
    """A stable case of a striker; cases in f32 are those of the other group."""
    given = {"drift": 0.05, "steps": 1000} | more
    return Case(name, given.pop("group", "struck"), STABLE, HARD, changes, **given)


def masses_and_speeds(group: str, suffix: str = "") -> tuple[Case, ...]:
    """The cases that run in f64 and in f32."""
    return (
        struck(f"striker 1 g at 6 m/s{suffix}", {}, group=group, check=breaks(20), steps=1500),
        struck(f"striker 1 mg{suffix}", {MASS: 1e-6}, group=group),
        struck(f"striker 100 t{suffix}", {MASS: 1e5}, group=group, check=moves_on(0.999)),
        struck(
            f"striker 100 t at 300 m/s{suffix}",
            {MASS: 1e5, SPEED: 300.0},
            group=group,
            drift=0.3,
            check=all_of(moves_on(0.999), breaks(100)),
        ),
    )


IN_F64 = (
    struck("striker at 1 mm/s", {SPEED: 1e-3}),
    struck("striker 1 g at 300 m/s", {SPEED: 300.0}, drift=0.3, check=breaks(100)),
    struck("striker 1 mg at 300 m/s", {MASS: 1e-6, SPEED: 300.0}, drift=0.3),
    struck("gravity a million times the Earth's", {"striker.gravity": 1e7, SPEED: 0.0}),
    struck("contact on one node", {"striker.diameter": 4e-4}),
    Case(
        "a needle of a fifth of a module",
        "struck",
        STOPPED,
        "nodes let go by bars move by a tenth of its radius a step: too sharp a curve",
        {"striker.diameter": 1e-4},
        says="so sharp",
        steps=1000,
    ),
    struck("a striker that never arrives", {"striker.gap": 1.0}, check=moves_on(1 - 1e-12)),
    Case(
        "a striker beside the plate",
        "struck",
        STABLE,
        "nothing there to touch",
        set_up=striker_at(x=0.1),
        check=moves_on(1 - 1e-12),
        steps=1000,
    ),
    Case(
        "a striker inside the plate",
        "struck",
        STABLE,
        "nodes inside it are kept from getting deeper: contact creates no energy",
        set_up=striker_at(displacement=SPACING),
        steps=1000,
    ),
    Case(
        "every bar broken under the striker",
        "struck",
        STABLE,
        "loose nodes are pushed aside, one by one",
        set_up=all_broken(0.0),
        drift=0.05,
        steps=1000,
        check=moves_on(0.5),
    ),
    Case("struck at 1.1 of the step", "struck", STOPPED, LINEAR, says=ABOVE_CRITICAL, share=1.1),
    Case(
        "100 t at 1.02 of the step",
        "struck",
        STOPPED,
        "the striker's energy must not hide the plate's",
        {MASS: 1e5},
        says=ABOVE_CRITICAL,
        share=1.02,
    ),
)

CASES = (
    *masses_and_speeds("struck"),
    *IN_F64,
    *masses_and_speeds("struck-f32", " in f32"),
)
