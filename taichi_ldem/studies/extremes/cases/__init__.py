"""All cases in the order of the table."""

from taichi_ldem.studies.extremes.case import Case
from taichi_ldem.studies.extremes.cases import (
    bodies,
    commands,
    damping,
    deformed,
    disorder,
    elastic,
    fracture,
    strikers,
)

CASES: tuple[Case, ...] = (
    *elastic.CASES,
    *bodies.CASES,
    *deformed.CASES,
    *fracture.CASES,
    *disorder.CASES,
    *damping.CASES,
    *strikers.CASES,
    *commands.CASES,
)
