"""Large deformations, at which bars are far from their length at rest."""

from taichi_ldem.studies.extremes.case import STABLE, STOPPED, Case
from taichi_ldem.studies.extremes.checks import conserves
from taichi_ldem.studies.extremes.scenes import SOUND
from taichi_ldem.studies.extremes.setups import SetUp, shaken, spinning, swelling

SURE = "at any deformation omega^2 <= 3 omega_max^2 at rest: 0.57 of the step is enough"
TURNS = "a bar that passes through zero length turns round within a step, however short"


def crossing(name: str, set_up: SetUp) -> Case:
    """A case in which bars pass through zero length, which stops it."""
    return Case(name, "free", STOPPED, TURNS, says="of their length", set_up=set_up)


CASES = (
    Case(
        "stretched by a twentieth and let go, 0.5",
        "free",
        STABLE,
        SURE,
        set_up=swelling(0.05),
        drift=0.05,
    ),
    Case(
        "stretched by a twentieth and let go, 0.98",
        "free",
        STOPPED,
        "tension e adds up to e / (1 + e) of a bar's stiffness across it: 0.96 of the step",
        says="stretched bars lower the critical",
        set_up=swelling(0.05),
        share=0.98,
    ),
    Case(
        "spun to bars of 1.4 of their length",
        "free",
        STABLE,
        SURE,
        set_up=spinning(2, 15.0),
        check=conserves(1e-9),
    ),
    crossing("stretched by half and let go", swelling(0.5)),
    crossing("stretched fivefold and let go", swelling(4.0)),
    crossing("squeezed to 0.4 of its size", swelling(-0.6)),
    crossing("squeezed to 0.01 of its size", swelling(-0.99)),
    crossing("nodes cross: noise of half the speed of sound", shaken(0.5 * SOUND)),
    Case(
        "turned inside out",
        "free",
        STABLE,
        "the mirrored body is at rest, too",
        set_up=lambda b: b.start(-2 * b.places, b.noise(1e-3)),
    ),
)
