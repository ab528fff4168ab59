"""The declaration of a body. It imports no Taichi, as readers of a run need the names only."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact.drawing import Drawing, Floats

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.body import RigidBody
    from taichi_ldem.solver.dynamics import Dynamics


@dataclass(frozen=True)
class Observable:
    """A number that a body adds to every row of the history.

    Attributes:
        column: its name in ``history.csv``, which ends in the unit.
        label: its meaning in words. unit: SI unit. sign: the meaning of a positive value.
        energy: whether it is a term of the energy balance.
    """

    column: str
    label: str
    unit: str
    sign: str = ""
    energy: bool = False


HELD = Observable("contact_elastic_j", "energy held in elastic landings", "J", energy=True)
"""A term that all bodies have together, where nodes land on them elastically."""


class Body:
    """The declaration of a rigid body.

    Attributes:
        name: name of the body, also in checkpoints.
        absent: how ``ldem info`` names the contact that a scene without the body leaves out; empty
            where that goes without saying.
        observables: in the order of the history's columns and of ``RigidBody.observe``.
        holds: whether the body holds the plate; such bodies are resolved first.
        follows: whether it is resolved last, when the velocities of nodes are known.
        dissipates: whether the body's contact may take energy, the history's ``contact_j``.
        force: column of the force that a run's progress shows, if the body has one.
    """

    name: str
    absent: str
    observables: tuple[Observable, ...] = ()
    holds: ClassVar[bool] = False
    follows: ClassVar[bool] = False
    dissipates: ClassVar[bool] = True
    force: str | None = None

    def table(self, scene: Scene) -> Any:
        """The scene's table of the body; None where the scene has no such body."""
        raise NotImplementedError

    def without_friction(self, scene: Scene) -> str:
        """How ``ldem info`` names the friction that a body of the scene could have; or nothing."""
        if getattr(self.table(scene), "friction", None) != 0:
            return ""
        return f"friction of the {self.name} (friction = 0)"

    def works(self, scene: Scene) -> bool:
        """Whether work is done on the body from outside, the history's ``external_j``."""
        return False

    def kernels(self) -> "type[RigidBody]":
        """The body's class of kernels, imported when it is needed; Taichi must be running."""
        raise NotImplementedError

    def build(self, dynamics: "Dynamics", scene: Scene) -> "RigidBody | None":
        """The body on a lattice; None where the scene has no such body.

        Raises:
            SceneError: the body has no place on this plate.
        """
        if self.table(scene) is None:
            return None
        body = self.make(dynamics, scene)
        body.name = self.name
        body.columns = tuple(o.column for o in self.observables_in(scene))
        return body

    def make(self, dynamics: "Dynamics", scene: Scene) -> "RigidBody":
        """The body with its kernels, for a scene that has it."""
        return self.kernels()(dynamics, scene)  # type: ignore[arg-type]

    def observables_in(self, scene: Scene) -> tuple[Observable, ...]:
        """The observables of the body in a scene; all of ``observables`` unless it says more."""
        return self.observables

    def warnings(self, scene: Scene, history: list[dict[str, Any]]) -> list[str]:
        """Lines about a finished run that its reader should know, from the history's rows."""
        return []

    def drawing(self, scene: Scene, history: Mapping[str, Floats], time: float) -> Drawing | None:
        """How the body is drawn at a time (s) of a run's history; None where it is not."""
        return None
