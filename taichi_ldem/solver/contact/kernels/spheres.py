"""What nodes that touch do to each other: soft spheres with friction.

Two nodes of a pair (``pairs``) touch when they are closer than the shortest bar of the lattice, d,
or than they were at rest, if that is less. They then push each other apart with k (d - r), and
friction resists their sliding. A bar fails in tension, when its ends are further apart than at
rest, so a pair is never inside each other when it becomes one.

The stiffness is k = 2 STIFFER m k_l / m_0: of two nodes inside the body, STIFFER of that of a bar
along an edge, k_l = EA/L, and for lighter nodes less, by their reduced mass m. With n contacts at
a node at most, the element-wise bound gives the contacts alone a highest frequency of
omega^2 <= 2 STIFFER n k_l / m_0; the lattice's own is 16 k_l / m_0 (``module``) or 9.5
(``cubic-26``). So ten contacts at each node of intact bodies would raise omega^2 by a third or a
half, which the default safety of one half leaves room for. Nodes that have lost bars need less.

Friction is Coulomb's, regularised in the sliding velocity and without memory: its impulse in a step
is the friction coefficient times the normal one, but at most STICK of what would stop the sliding.
Pieces under a shear load T < mu N creep at T dt / (STICK m). It acts at the velocity half a step
before the displacement. With the lattice's own frequency as above, dt stays stable if
(omega dt)^2 + 2 n STICK < 4.
"""

import taichi as ti

from taichi_ldem.solver.contact.kernels.cells import DISTANCE, FRICTION, STIFFNESS
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.contact.kernels.pairs import NearbyPairs
from taichi_ldem.solver.dynamics import Dynamics, field_apart

STIFFER = 0.25
"""Stiffness of a contact of two nodes inside the body over that of a bar along an edge."""

STICK = 0.1
"""Largest share of the sliding of two free nodes that friction stops within a step."""

TINY = 1e-12
"""Least distance of two nodes, over that of contact, that has a direction."""

# the entries of what a contact does to a node: impulses (N s), and half of the energy (J)
Effect = ti.types.vector(7, ti.f64)
PUSH, DRAG, ENERGY = range(0, 7, 3)


@ti.data_oriented
class SoftSpheres(NearbyPairs):
    """Listed nodes that touch.

    Attributes:
        position, before: of the nodes awake before the step, m, and their velocities, m/s.
    """

    def __init__(self, dynamics: Dynamics):
        super().__init__(dynamics)
        self.position = field_apart(ti.f64, self.capacity, 3)

    @ti.func
    def contact(self, a, b, spacing, time_step):
        """What another listed node does to a node."""
        effect, distance = Effect(0.0), self.numbers[DISTANCE]
        away = self.position[a] - self.position[b]
        square = away.dot(away)
        if square < distance * distance:
            length = ti.sqrt(square)
            depth = self.contact_distance(a, b, spacing) - length
            if depth > 0:
                normal = away / ti.max(length, TINY * distance)
                reduced = self.mass[a] * self.mass[b] / (self.mass[a] + self.mass[b])
                stiffness = self.numbers[STIFFNESS] * reduced
                impulse = time_step * stiffness * depth
                drag = self.friction_between(impulse, reduced, a, b, normal)
                for axis in ti.static(range(3)):
                    effect[PUSH + axis] = impulse * normal[axis]
                    effect[DRAG + axis] = -drag[axis]
                effect[ENERGY] = 0.25 * stiffness * depth * depth
        return effect

    @ti.func
    def friction_between(self, impulse, reduced, a, b, normal):
        """Impulse of friction between two nodes, along their sliding."""
        sliding = ti.cast(self.before[a], ti.f64) - ti.cast(self.before[b], ti.f64)
        sliding -= normal * sliding.dot(normal)
        speed = sliding.norm()
        factor = ti.cast(0.0, ti.f64)
        if speed > 0:
            factor = ti.min(self.numbers[FRICTION] * impulse / speed, STICK * reduced)
        if self.numbers[FRICTION] == 0:
            factor = 0.0
        return factor * sliding

    @ti.func
    def contact_distance(self, a, b, spacing):
        """Distance at which two listed nodes touch, m."""
        distance = self.numbers[DISTANCE]
        if ti.static(self.dynamics.features.perturbed):
            s, k, j, i = self.site_of(a)
            t, m, g, h = self.site_of(b)
            rest = self.rest_position(s, k, j, i, spacing)
            rest -= self.rest_position(t, m, g, h, spacing)
            distance = ti.min(distance, rest.norm())
        return distance

    @ti.func
    def impulses(self, effect):
        """The normal impulse of an effect, and that of friction."""
        push, drag = vec3d(0.0, 0.0, 0.0), vec3d(0.0, 0.0, 0.0)
        for axis in ti.static(range(3)):
            push[axis], drag[axis] = effect[PUSH + axis], effect[DRAG + axis]
        return push, drag
