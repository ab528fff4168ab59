"""Names that a scene may use because a file of the package defines them.

A softening law is a file in ``solver/laws``, a nose of the striker one in ``solver/contact/noses``;
the name of the file is the name that a scene uses. Only the file names are read, because importing
the files would import Taichi.
"""

from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]


def files_in(folder: str, *first: str) -> list[str]:
    """Names of the modules in a folder of the package, without those that begin with ``_``.

    Args:
        folder: relative to the package.
        first: names that come before the others, which are sorted.
    """
    found = sorted(file.stem for file in (PACKAGE / folder).glob("[!_]*.py"))
    return [*first, *(name for name in found if name not in first)]


LAW_NAMES = files_in("solver/laws", "bilinear", "exponential")
"""Softening laws that ``material.law`` may name; ``solver.laws.register`` adds to them."""

NOSE_NAMES = files_in("solver/contact/noses", "hemisphere", "cylinder")
"""Noses that ``striker.shape`` may name."""
