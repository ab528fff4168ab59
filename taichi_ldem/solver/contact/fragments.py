"""Declaration of the contact between pieces of the plate."""

from typing import TYPE_CHECKING, Any

from taichi_ldem.scene import Contact, Scene
from taichi_ldem.solver.contact.declaration import Body, Observable

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.fragments import Touching


class Fragments(Body):
    """The nodes of pieces that have parted, and of faces that were cut."""

    name = "fragments"
    absent = "contact of pieces (no [contact], or contact.fragments = false)"
    observables = (
        Observable("pieces_elastic_j", "energy stored where pieces touch", "J", energy=True),
        Observable("pieces_friction_j", "energy lost by friction of pieces", "J", energy=True),
    )

    def table(self, scene: Scene) -> Contact | None:
        """The table [contact], where it lets pieces touch."""
        contact = scene.contact
        return contact if contact is not None and contact.fragments else None

    def observed(self, touching: "Touching") -> dict[str, float]:
        """The values that the history's row has of a sample, by column."""
        values = (touching.elastic, touching.lost)
        return dict(zip((o.column for o in self.observables), values, strict=True))

    def kernels(self) -> type[Any]:
        """The kernels' class."""
        from taichi_ldem.solver.contact.kernels.fragments import Fragments as Kernels

        return Kernels


FRAGMENTS = Fragments()
