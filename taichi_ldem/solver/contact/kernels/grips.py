"""The grips of a tension test, and the extensometer between them."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import taichi as ti

from taichi_ldem.solver.contact.kernels.body import (
    CHUNK,
    Energies,
    Layout,
    Reading,
    RigidBody,
)
from taichi_ldem.solver.contact.kernels.nearby import vec3d
from taichi_ldem.solver.dynamics import Dynamics, field_apart
from taichi_ldem.solver.gauge import Gauge

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene

# the entries of ``numbers``
SPEED, RAMP, COSINE, SINE = range(4)


@ti.data_oriented
class Grips(RigidBody):
    """Two grips that move apart along the specimen, each by half of a prescribed separation.

    The nodes in them move with the grips; across the pull they are held, or move as they would
    without grips. The impulse that the sums count is half of the
    difference between the grips, a mean pull; the energy that they count as lost is minus the
    grips' work.

    Attributes:
        table: the scene's table.
        gauge: the extensometer; None where the scene has none.
        state: (1,) f64: steps taken.
    """

    listed_anew = False

    def __init__(self, dynamics: Dynamics, scene: "Scene"):
        assert scene.grips is not None
        self.held = scene.grips.lateral == "held"
        super().__init__(dynamics, self.layout_of(dynamics, scene))
        self.state = field_apart(ti.f64, 1)
        self.gauge = None
        if scene.grips.gauge_length:
            angle = math.radians(scene.plate.angle)
            self.gauge = Gauge(dynamics, angle, scene.grips.gauge_length)

    def layout_of(self, dynamics: Dynamics, scene: "Scene") -> Layout:
        """The layout of the scene's grips; the nodes within their length of either end."""
        table, angle = scene.grips, math.radians(scene.plate.angle)
        assert table is not None
        cosine, sine = math.cos(angle), math.sin(angle)
        along = dynamics.lattice.positions()[..., :2] @ (cosine, sine)
        exists = dynamics.lattice.exists()
        start = along[exists].max() - table.length - 1e-6 * dynamics.lattice.spacing
        nodes = np.flatnonzero(exists & (np.abs(along) >= start)).astype(np.int32)
        room, lattice = len(nodes), dynamics.lattice
        if lattice.perturbation:  # for any seed: the nodes and the outermost one may lie further in
            regular = np.abs(lattice.grid()[..., :2] @ (cosine, sine))[exists]
            inward = table.length + (2 * lattice.perturbation + 1e-6) * lattice.spacing
            room = int(np.count_nonzero(regular >= regular.max() - inward))
        kind = (table.lateral, "gauge" if table.gauge_length else "no gauge")
        return Layout((table.velocity, table.ramp, cosine, sine), room, kind, nodes)

    def start(self, scene: "Scene", time_step: float) -> None:
        """Set the separation of the grips to zero."""
        assert scene.grips is not None
        self.table = scene.grips
        self.state.fill(0)

    def reset(self, scene: "Scene", time_step: float) -> None:
        """Put the grips and the extensometer back to t = 0 with the numbers of another scene."""
        super().reset(scene, time_step)
        if self.gauge is not None:
            assert self.table.gauge_length is not None
            self.gauge.place(math.radians(scene.plate.angle), self.table.gauge_length)

    def kernel_names(self) -> list[str]:
        """Names of the kernels that a run of the grips and of the extensometer compiles."""
        return super().kernel_names() + ["gauge"] * (self.gauge is not None)

    def fields(self) -> dict[str, ti.Field]:
        """All fields of the grips and of the extensometer by name."""
        own = super().fields()
        return own if self.gauge is None else own | {"gauge.nodes": self.gauge.nodes}

    def separation_at(self, time: float) -> float:
        """Separation of the grips at a time (s), m."""
        ramp = self.table.ramp
        share = min(time / ramp, 1.0) if ramp > 0 else 1.0
        return self.table.velocity * (ramp * share**3 * (1 - 0.5 * share) + max(time - ramp, 0.0))

    def observe(self, reading: Reading, force: float, time: float, now: int) -> tuple[Any, ...]:
        """Separation of the grips, their mean pull, strains along and across the specimen."""
        strains = self.gauge.strains(now) if self.gauge is not None else (None, None)
        return self.separation_at(time), force, *strains

    def energies(self, reading: Reading) -> Energies:
        """The work of the grips: the loss that the sums count is minus this work."""
        return Energies(external=-reading.lost)

    # -- the step
    # -------------------------------------------------------------------------------------

    @ti.func
    def separation(self, time):
        """Separation of the grips at a time (s), m: the integral of their speed."""
        ramp = self.numbers[RAMP]
        equivalent = ti.max(time - ramp, 0.0)  # time at full speed for the same separation
        if ramp > 0:
            share = ti.min(time / ramp, 1.0)
            equivalent += ramp * share**3 * (1 - 0.5 * share)
        return self.numbers[SPEED] * equivalent

    @ti.func
    def component(self, impulse):
        """Component along the specimen."""
        return impulse.x * self.numbers[COSINE] + impulse.y * self.numbers[SINE]

    @ti.func
    def resolve(self, now, spacing, time_step, damping):
        """Move all nodes in the grips to the position of the grips at the end of the step."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.state[0] = self.state[0] + 1
        for chunk in range(self.turns()):
            works = vec3d(0.0, 0.0, 0.0)
            direction = vec3d(self.numbers[COSINE], self.numbers[SINE], 0.0)
            half = 0.5 * self.separation(self.state[0] * ti.cast(time_step, ti.f64))
            for number in range(chunk * CHUNK, self.chunk_end(chunk)):
                s, k, j, i = self.site_of(number)
                sign = ti.cast(1.0, ti.f64)
                if self.component(self.rest_position(s, k, j, i, spacing)) < 0:
                    sign = -1.0
                target = sign * half * direction
                if ti.static(not self.held):
                    free = ti.cast(self.dynamics.node_displacement(1 - now, s, k, j, i), ti.f64)
                    target += free - self.component(free) * direction
                gained = self.put(number, now, time_step, damping, target)
                gained[0] *= 0.5 * sign
                works += gained
                self.before[number] = self.dynamics.node_velocity(s, k, j, i)
            if chunk < self.chunks():
                self.store_chunk(chunk, works)
        self.book_chunks()
