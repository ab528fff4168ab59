"""The problems of the gallery by name, in the order of its page; none is imported before its use.

To add a problem, write its file in ``problems`` (and its scene in ``scenes``) and name it here.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

from taichi_ldem.errors import SceneError
from taichi_ldem.gallery.problem import Problem

NAMES: tuple[str, ...] = (
    "clamped-plate",
    "free-beam",
    "hertz",
    "spall",
    "strip",
    "prestrained-strip",
    "branching",
    "kalthoff-winkler",
    "brazilian-disc",
    "bending",
    "four-points",
    "ring",
    "radial-cracks",
    "strength",
)
"""Names of the problems; the file of ``a-b`` is ``problems/a_b.py``."""


def problem_of(name: str) -> Problem:
    """The problem of a name in ``NAMES``."""
    module = import_module(f"taichi_ldem.gallery.problems.{name.replace('-', '_')}")
    found: Problem = module.PROBLEM
    return found


def chosen(names: Sequence[str]) -> list[str]:
    """The names that were given, in the order of the gallery; all of them where none was.

    Raises:
        SceneError: there is no problem of a name.
    """
    for name in names:
        if name not in NAMES:
            raise SceneError(f"gallery {name}: must be one of {', '.join(NAMES)}")
    return [name for name in NAMES if not names or name in names]
