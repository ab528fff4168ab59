"""The clamp: rigid rings on both faces of the plate, or permanently fixed nodes."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.errors import SceneError
from taichi_ldem.solver.contact.kernels.body import CHUNK, SLACK, Layout, RigidBody
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.dynamics import Dynamics

if TYPE_CHECKING:
    from taichi_ldem.scene import Clamp, Scene

# the entries of ``numbers``
INNER, OUTER, HEIGHT = range(3)


def fixed_nodes(
    dynamics: Dynamics, numbers: Sequence[float], *, through: bool, any_seed: bool = False
) -> npt.NDArray[np.int32]:
    """Nodes between the circles: on both faces, or ``through`` the whole thickness.

    They are chosen by exact positions: in f32 a face may lie off its ring by more than the slack.

    Args:
        any_seed: those that may lie there in a perturbed lattice, whatever its seed.
    """
    inner, outer, _ = numbers
    lattice = dynamics.lattice
    position = lattice.grid() if any_seed else lattice.positions()
    spacing = lattice.spacing
    height = lattice.modules[2] * spacing
    radius = np.hypot(position[..., 0], position[..., 1])
    slack = 1e-9 * spacing
    margin = slack + lattice.perturbation * spacing if any_seed else slack
    held = lattice.exists()
    held &= (radius >= inner - margin) & (radius <= outer + margin)
    if not through:
        z = position[..., 2]
        held &= (z < slack) | (z > height - slack)
    return np.flatnonzero(held).astype(np.int32)


def reach(clamp: "Clamp", spacing: float) -> float:
    """How far outside its circles a clamp still holds nodes, m.

    The first node that is held lies half a module behind a circle on average. A clamp that also
    holds the nodes up to half a module before it begins on the circle, on average.
    """
    return 0.5 * spacing if clamp.edge == "unbiased" else 0.0


def refuse_narrow(clamp: "Clamp", spacing: float) -> None:
    """Refuse a ring that is narrower than a module (m).

    Raises:
        SceneError: it would hold only the nodes that happen to lie in it.
    """
    if clamp.outer_diameter is None or clamp.kind == "rim":
        return
    assert clamp.inner_diameter is not None
    least = clamp.inner_diameter + 2 * spacing
    if clamp.outer_diameter < least - 1e-9 * spacing:
        raise SceneError(
            f"clamp.outer_diameter = {clamp.outer_diameter:g}: must be at least {least:.6g}, a "
            "ring of one module: a narrower one holds only the nodes that happen to lie in it"
        )


@ti.data_oriented
class Rings(RigidBody):
    """The holder of the plate: rigid rings on both faces, or permanently fixed nodes.

    Rings: a node between the two circles that would cross the plane of a face stays on it for as
    long as it is pressed against it, without slip unless the scene gives a coefficient of
    friction; it separates freely. A node that gets beyond a face's plane through the opening does
    not touch the ring. Bonded, rim: listed nodes never move.

    An elastic landing takes the node back to where it was a step earlier: its velocity turns round,
    without slip along the ring, too.

    Attributes:
        slip: whether nodes may slide along the rings.
    """

    def __init__(self, dynamics: Dynamics, scene: "Scene"):
        layout = self.layout_of(dynamics, scene)
        self.listed_anew = layout.kind == "rings"
        self.elastic = scene.lands_elastically and self.listed_anew
        self.slip = layout.friction < math.inf
        super().__init__(dynamics, layout)

    def layout_of(self, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The layout of the scene's clamp.

        Raises:
            SceneError: the clamp holds no node, or only those that happen to lie in it.
        """
        clamp = scene.clamp
        assert clamp is not None
        refuse_narrow(clamp, dynamics.lattice.spacing)
        assert clamp.inner_diameter is not None  # the scene refuses other clamps without it
        outer = clamp.outer_diameter if clamp.kind != "rim" else None
        beyond = reach(clamp, dynamics.lattice.spacing)
        numbers = (
            0.5 * clamp.inner_diameter - beyond,
            0.5 * outer + beyond if outer is not None else math.inf,
            scene.plate.modules_through_thickness * dynamics.spacing,
        )
        fixed = fixed_nodes(dynamics, numbers, through=clamp.kind == "rim")
        if len(fixed) == 0:
            raise SceneError(
                f"clamp.inner_diameter = {clamp.inner_diameter}: the clamp holds no node"
            )
        room = len(fixed)
        if dynamics.lattice.perturbation:  # seeds share a length of the list, and so their kernels
            room = len(fixed_nodes(dynamics, numbers, through=clamp.kind == "rim", any_seed=True))
        if clamp.kind != "rings":
            return Layout(numbers, room, "fixed nodes", fixed, math.inf)
        # Rings that separate: the nodes between the circles through the whole thickness. On a
        # small plate all nodes, as fast debris may come near.
        nodes = int(np.count_nonzero(dynamics.lattice.exists()))
        through = max(room * dynamics.sites[0], 10_000)
        friction = math.inf if clamp.friction is None else clamp.friction
        return Layout(numbers, min(through, nodes), "rings", fixed, friction)

    @ti.func
    def near(self, position, margin):
        """Whether a point is within a margin of a ring's plane."""
        close = False
        if (position.z < margin) | (position.z > self.numbers[HEIGHT] - margin):
            radius = ti.sqrt(position.x**2 + position.y**2)
            close = radius >= self.numbers[INNER] - margin
            close &= radius <= self.numbers[OUTER] + margin
        return close

    @ti.func
    def held_at(self, number, now, spacing, time_step):
        """Whether a ring holds a node at the end of the step, and its displacement then."""
        s, k, j, i = self.site_of(number)
        old = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
        new = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
        rest = self.rest_position(s, k, j, i, spacing)
        slack = SLACK * spacing
        below, above = rest.z, rest.z - self.numbers[HEIGHT]
        held = False
        if above + new.z > 0 or below + new.z < 0:
            radius = ti.sqrt((rest.x + old.x) ** 2 + (rest.y + old.y) ** 2)
            if radius >= self.numbers[INNER] and radius <= self.numbers[OUTER]:
                if above + new.z > 0 and above + old.z <= slack:
                    held, old.z = True, -above
                elif below + new.z < 0 and below + old.z >= -slack:
                    held, old.z = True, -below
        if ti.static(self.elastic):
            if held:
                held, old = self.turned_back(number, now, time_step, old, new)
        if ti.static(self.slip):
            if held:
                old = self.slid(old, new)
        return held, old

    @ti.func
    def turned_back(self, number, now, time_step, on_ring, free):
        """Whether an elastic landing takes a node to its last place, and that displacement."""
        s, k, j, i = self.site_of(number)
        place = ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64)
        place -= ti.cast(time_step, ti.f64) * ti.cast(self.before[number], ti.f64)
        if ti.static(self.slip):
            place.x, place.y = on_ring.x, on_ring.y  # friction stops the sliding
        # a node that pulls away from the ring is free
        return (free.z - place.z) * (free.z - on_ring.z) > 0, place

    @ti.func
    def slid(self, held, free):
        """Displacement of a node on a ring: between its places without slip and in free flight."""
        way = vec3d(free.x - held.x, free.y - held.y, 0.0)
        if ti.static(self.rubs):
            way -= self.braking(way, ti.abs(free.z - held.z)) * way
        return held + way

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Keep the nodes that press against a ring, and fixed nodes, at their displacement."""
        for chunk in range(self.turns()):
            works = vec3d(0.0, 0.0, 0.0)
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                s, k, j, i = self.site_of(number)
                held, target = (
                    True,
                    ti.cast(self.dynamics.node_displacement(now, s, k, j, i), ti.f64),
                )
                if ti.static(self.listed_anew):
                    held, target = self.held_at(number, now, spacing, time_step)
                if held:
                    works += self.put(number, now, time_step, damping, target)
                self.before[number] = self.dynamics.node_velocity(s, k, j, i)
            if chunk < self.chunks():
                self.store_chunk(chunk, works)
        self.book_chunks()
