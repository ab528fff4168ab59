"""Softening laws: the force of a bar whose peak strain has passed eps_p (Section 2.1, Fig. 2).

A law is a file of this package: ``material.law = "NAME"`` takes ``NAME.py``, and adding the file is
all that a new law needs. The file has three functions:

- ``softening(peak, failure, parameter)``, a ``ti.func``: force at peak strain 1 < peak < failure;
- ``area(peak, failure, parameter)``, a ``ti.func``: its integral from 1 to ``peak``;
- ``parameters(ductility)``: K_r -> (peak strain at failure, a second parameter of the law's own).

Everything is dimensionless: strains in units of eps_p, forces in units of EA eps_p, energies in
units of EA eps_p^2 times the bar's length. Up to peak strain 1 a bar is elastic; from there to the
ratio at failure it follows the branch; then it is broken and carries nothing, or compression only
(``material.after_failure``).
It unloads to the origin, and compression is linear elastic as long as the bar exists, so the peak
strain is the whole history.

A law dissipates K_r / 2, the area under the bilinear law, which Eq. (12) equates with G_f A^f.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from taichi_ldem.scene import LAW_NAMES


@dataclass(frozen=True)
class Law:
    """A softening law.

    Attributes:
        softening: (peak, failure, parameter) -> force at peak strain 1 < peak < failure.
        area: its integral from 1 to ``peak``.
        parameters: K_r -> (peak strain at failure, second parameter).
    """

    softening: Any
    area: Any
    parameters: Callable[[float], tuple[float, float]]


_registered: dict[str, Law] = {}


def law_named(name: str) -> Law:
    """The law that was registered under a name, or that of the file of this name.

    Raises:
        ModuleNotFoundError: there is none.
    """
    if name in _registered:
        return _registered[name]
    module = importlib.import_module(f"{__name__}.{name}")
    return Law(module.softening, module.area, module.parameters)


def register(name: str, law: Law) -> None:
    """Make a law known to scenes as ``material.law = name``, without a file in this package.

    A law that dissipates K_r / 2 for every K_r > 1 costs G_f A^f a bar, as the built-in ones do.

    Raises:
        ValueError: the name is taken.
    """
    if name in LAW_NAMES:
        raise ValueError(f"there is a law '{name}' already")
    _registered[name] = law
    LAW_NAMES.append(name)
