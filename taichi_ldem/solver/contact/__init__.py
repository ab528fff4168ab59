"""What touches the lattice: striker, clamp, grips, supports, floor, and pieces of it each other.

A body consists of a declaration in this package (its name, its table of the scene, its columns of
the history, its drawing), which imports no Taichi, and of its kernels in ``kernels``.
The tuple below is the only list of the bodies: simulation, history and pictures loop over it.
"""

from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact.declaration import HELD, Body, Observable
from taichi_ldem.solver.contact.floor import FLOOR
from taichi_ldem.solver.contact.fragments import FRAGMENTS
from taichi_ldem.solver.contact.grips import GRIPS
from taichi_ldem.solver.contact.loads import LOADS
from taichi_ldem.solver.contact.rings import RINGS
from taichi_ldem.solver.contact.striker import STRIKERS
from taichi_ldem.solver.contact.supports import SUPPORTS

__all__ = [
    "BODIES",
    "CONTACTS",
    "FRAGMENTS",
    "HELD",
    "Body",
    "Observable",
    "bodies_of",
    "contacts_of",
    "in_order_of_resolving",
    "observables",
]

BODIES: tuple[Body, ...] = (STRIKERS[0], RINGS, GRIPS, SUPPORTS, FLOOR, *STRIKERS[1:], LOADS)
"""All bodies, in the order of their columns in the history and of their impulses in a checkpoint.
A new one comes last: checkpoints that were written before have a zero in its place."""

CONTACTS: tuple[Body, ...] = (*BODIES, FRAGMENTS)
"""All bodies, and the contact of pieces, in the order of their columns in the history."""


def contacts_of(scene: Scene) -> list[Body]:
    """The contacts that a scene has, in the order of ``CONTACTS``."""
    return [contact for contact in CONTACTS if contact.table(scene) is not None]


def bodies_of(scene: Scene) -> list[Body]:
    """The bodies that a scene has, in the order of ``BODIES``."""
    return [body for body in BODIES if body.table(scene) is not None]


def in_order_of_resolving() -> list[Body]:
    """All bodies in the order in which a step resolves them and a sample adds them up.

    A body that holds the plate comes before those that move it, and loads come last.
    """
    return sorted(BODIES, key=lambda body: (body.follows, not body.holds))


def observables(*, energy: bool) -> list[Observable]:
    """The observables of all contacts that are, or are not, terms of the energy balance.

    Those of further strikers are left out, as hardly any scene has them.
    """
    usual = (contact for contact in CONTACTS if contact not in STRIKERS[1:])
    return [o for contact in usual for o in contact.observables if o.energy == energy]
