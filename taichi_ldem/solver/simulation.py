"""A simulation built from exactly what its scene names."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.errors import TooManyNodes
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import Scene
from taichi_ldem.solver import backend, guard, saving, stability
from taichi_ldem.solver.build import build_dynamics, refill_dynamics
from taichi_ldem.solver.contact import BODIES, FRAGMENTS, in_order_of_resolving
from taichi_ldem.solver.contact.kernels.body import LOSS_AFTER, LOSS_BEFORE, RigidBody
from taichi_ldem.solver.contact.kernels.fragments import Touching
from taichi_ldem.solver.dynamics import field_bytes
from taichi_ldem.solver.energy import (
    BROKEN,
    DAMPED,
    FRACTURE,
    KINETIC,
    STRAIN,
    EnergySums,
    Ledger,
)
from taichi_ldem.solver.fields import is_long
from taichi_ldem.solver.openings import Openings
from taichi_ldem.solver.sampling import Sample, Sampler
from taichi_ldem.solver.start import set_off
from taichi_ldem.solver.step import StepNumbers

__all__ = ["STEPS_A_LAUNCH", "STEPS_BETWEEN_LISTS", "Sample", "Simulation"]

STEPS_BETWEEN_LISTS = 64
"""Steps between two listings of the nodes near a rigid body."""

STEPS_A_LAUNCH = 4
"""Steps that one kernel of a GPU takes: each is compiled on its own. Even, so that the buffers are
back in their places. On Vulkan it is one: four take Taichi's SPIR-V builder minutes, in which it
may fail (``Value does not yet exist``)."""


STEPS_OF_A_MILLION = 1
"""Steps in one launch of one thread that takes those of a million modules; fewer modules, more."""


@ti.data_oriented
class Simulation:
    """A plate and the rigid bodies around it, stepped in time.

    Args:
        scene: what to build; Taichi must have been started for it (``backend.start``).
        in_strips: whether the step is driven in strips; None: as suits the backend.

    Attributes:
        dynamics: the lattice's fields and kernels.
        bodies: the rigid bodies that the scene has, in the order in which a step resolves them.
        fragments: the contact of pieces of the plate; None where the scene has none.
        openings: the notches that open during the run.
        drawn: mean and CV of the random factors on the material's properties, by property.
        sampler: reads the sums of plate and bodies.
        time_step, critical_time_step: s.
        step_number: of the next step; the displacement at ``time`` lies in buffer ``now``.
        initial_ledger: energies of the first sample; None before it.
        last_sampled: time of the latest sample, s; None before the first.

    Raises:
        SceneError: K_r < 1, a clamp that holds no node, or a time step above the critical one.
    """

    def __init__(self, scene: Scene, in_strips: bool | None = None):
        self.scene = scene
        backend.compile_carefully(is_long(scene))
        self.dynamics, self.drawn = build_dynamics(scene, in_strips)
        self.alone = self.dynamics.layout.alone
        self.steps_a_launch = self._choose_steps_a_launch()
        self.now, self.step_number = 0, 0
        self.fragments: Any = FRAGMENTS.build(self.dynamics, scene)
        self.pieces_touch = self.fragments is not None
        built = [declared.build(self.dynamics, scene) for declared in in_order_of_resolving()]
        self.bodies: list[RigidBody] = [body for body in built if body is not None]
        self.shared = len(self.bodies) > 1 and any(body.meets_others for body in self.bodies)
        for part in self.bodies:
            if self.shared and part.meets_others:
                part.share_nodes()
        if self.alone and self.bodies:
            self.dynamics.driver.contact = self.resolve_alone
        self._read_numbers()
        set_off(self)
        for part in self.bodies:
            part.place(scene, self.time_step)
        self.energies = EnergySums(self.dynamics)
        self.sampler = Sampler(self.bodies, self.energies, self.dynamics, scene)
        self._start_clock()

    def _choose_steps_a_launch(self) -> int:
        if self.alone:
            # a signal waits for the end of a launch, and large plates gain nothing by many steps
            modules = int(np.prod(self.dynamics.lattice.modules))
            return max(1, min(STEPS_BETWEEN_LISTS, STEPS_OF_A_MILLION * 10**6 // modules))
        one_by_one = self.dynamics.in_strips or self.scene.solver.arch == "vulkan"
        return 1 if one_by_one else STEPS_A_LAUNCH

    def _read_numbers(self) -> None:
        """Set the parameters of a step from scene and lattice."""
        self.spacing = self.dynamics.lattice.spacing
        self.damping = self.scene.solver.damping
        with backend.compiling():
            self.critical_time_step = stability.critical_time_step(self.dynamics)
        self.time_step, self.sample_every = stability.chosen_time_step(
            self.scene, self.critical_time_step
        )
        self.steps = round(self.scene.solver.duration / self.time_step)

    def _start_clock(self) -> None:
        self.now, self.step_number = 0, 0
        self.initial_ledger: Ledger | None = None
        self.last_sampled: float | None = None
        self.sampler.start()
        self.openings = Openings(self.dynamics, self.energies, self.scene)

    def reset(self, scene: Scene, lattice: Lattice | None = None) -> None:
        """Start again at t = 0 with the numbers of another scene, without compiling anything.

        The scene may differ in the material's numbers, speeds, masses and sizes of the bodies, time
        step, duration and seeds, but not in the modules of the plate, its features and its bodies.

        Args:
            lattice: another body of the same modules in place of the scene's plate.

        Raises:
            ValueError: the scene needs other fields or kernels.
            SceneError: the scene cannot be built. After an error the simulation has to be reset
                again before it can be stepped.
        """
        started, wanted = self.scene.solver, scene.solver
        for name in ("arch", "precision", "threads"):
            if getattr(started, name) != getattr(wanted, name):
                raise ValueError(f"solver.{name}: Taichi has to be started again for another one")
        for body in BODIES:
            if (body.table(scene) is None) != (self.body(body.name) is None):
                raise ValueError(f"{body.name}: no other bodies can be added or taken away")
        if (FRAGMENTS.table(scene) is None) == self.pieces_touch:
            raise ValueError("contact.fragments: needs other kernels")
        if scene.lands_elastically != self.scene.lands_elastically:
            raise ValueError("contact.landing: needs other kernels")
        self.drawn = refill_dynamics(self.dynamics, scene, lattice)
        self.scene = scene
        self.now = 0
        self._read_numbers()
        set_off(self)
        for part in self.bodies:
            part.reset(scene, self.time_step)
        if self.pieces_touch:
            self.fragments.reset(scene)
        self.sampler.place(scene)
        self._start_clock()

    def body(self, name: str) -> Any:
        """The rigid body of a name (see ``contact.BODIES``); None where the scene has none."""
        return next((body for body in self.bodies if body.name == name), None)

    # -- stepping ----------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time of the displacement in buffer ``now``, s."""
        return self.step_number * self.time_step

    @ti.func
    def _resolve(self, now, spacing, time_step, damping, touching):
        if ti.static(self.pieces_touch):
            self.fragments.kick(now, time_step, damping, touching)
        for n in ti.static(range(len(self.bodies))):
            self.bodies[n].act_first(now, time_step, damping)
        for n in ti.static(range(len(self.bodies))):
            self.bodies[n].begin()
        for n in ti.static(range(len(self.bodies))):
            self.bodies[n].resolve(now, spacing, time_step, damping)
        if ti.static(self.shared):
            for n in ti.static(range(len(self.bodies))):
                self.bodies[n].record()

    @ti.func
    def resolve_alone(self, now, numbers):
        """The contact of a step that one thread takes."""
        spacing, time_step = ti.cast(numbers.spacing, float), ti.cast(numbers.kick, float)
        self._resolve(now, spacing, time_step, ti.cast(numbers.damping, float), 0)

    @ti.kernel
    def _contact(self, now: int, spacing: float, time_step: float, damping: float, touching: int):
        self._resolve(now, spacing, time_step, damping, touching)

    @ti.kernel
    def _launch(
        self,
        now: int,
        numbers: StepNumbers,
        touching: int,
        dust: int,
        steps: ti.template(),
        measure: ti.template(),
    ):
        """Take steps in whole passes, all in one kernel, without returning to Python.

        Args:
            touching, dust: numbers of nodes of pieces that may touch, and of dust among them.
        """
        other = 1 - now
        for n in ti.static(range(steps)):
            if ti.static(n % 2 == 0):
                self._pass(now, numbers, touching, dust, measure)
            else:
                self._pass(other, numbers, touching, dust, measure)

    @ti.func
    def _pass(self, now, numbers, touching, dust, measure: ti.template()):
        spacing, time_step = ti.cast(numbers.spacing, float), ti.cast(numbers.kick, float)
        damping = ti.cast(numbers.damping, float)
        if ti.static(self.pieces_touch):
            self.fragments.find_impulses(now, spacing, time_step, touching, dust)
        self.dynamics.whole_passes(now, numbers, measure)
        self._resolve(now, spacing, time_step, damping, touching)

    def _take(self, time_step: float, steps: int = 1, measure: bool = False) -> None:
        """Take steps from ``now``; on several threads of the CPU one."""
        dynamics, spacing = self.dynamics, self.spacing
        if self.alone:
            dynamics.take_alone(self.now, time_step, self.damping, steps, measure)
            return
        pieces = self.fragments
        touching, dust = (pieces.size, pieces.dust_size) if self.pieces_touch else (0, 0)
        if not dynamics.in_strips:
            numbers = dynamics.driver.numbers(time_step, time_step, self.damping)
            self._launch(self.now, numbers, touching, dust, steps, measure)
            if self.pieces_touch:
                pieces.look_whether_moved()
            return
        if self.pieces_touch:
            pieces.press(self.now, spacing, time_step)
        dynamics.step(self.now, time_step, time_step, self.damping, measure)
        if self.bodies or self.pieces_touch:
            self._contact(self.now, spacing, time_step, self.damping, touching)

    def _step(self, steps: int = 1, measure: bool = False) -> None:
        if self.openings.open_due(self) and self.pieces_touch:
            self.fragments.renew(self.step_number)
        if self.step_number % STEPS_BETWEEN_LISTS == 0:
            self._list_candidates()
        if self.pieces_touch and self.step_number >= self.fragments.next_listing:
            self.fragments.list_anew(self.now, self.step_number, self.time_step)
        self._take(self.time_step, steps, measure)
        self.now = (self.now + steps) % 2
        self.step_number += steps

    def _list_candidates(self) -> None:
        """List the nodes that may touch a rigid body before the next listing."""
        for body in self.bodies:
            if body.listed_anew:
                body.list_nodes(self.now, STEPS_BETWEEN_LISTS * self.time_step)

    def _until_listing(self) -> int:
        """Steps that can be taken before nodes or pairs have to be listed, or a notch opens."""
        until = STEPS_BETWEEN_LISTS - self.step_number % STEPS_BETWEEN_LISTS
        until = min(until, max(1, self.openings.steps_until(self)))
        if self.pieces_touch:
            # a listing that is due lasts for one step at least
            until = min(until, max(1, self.fragments.next_listing - self.step_number))
        return until

    def advance(self, steps: int) -> None:
        """Take a number of steps without samples."""
        end = self.step_number + steps
        while self.step_number < end:
            most = min(self._until_listing(), end - self.step_number)
            whole = self.alone or most >= self.steps_a_launch
            self._step(min(most, self.steps_a_launch) if whole else 1)

    def start_from(
        self, displacement: npt.NDArray[np.float64], velocity: npt.NDArray[np.float64]
    ) -> None:
        """Set the state at t = 0: (sublattices, *S, 3) arrays, corner then centre, m and m/s."""
        dynamics = self.dynamics
        dynamics.set_displacement(self.now, np.ascontiguousarray(displacement, dtype=np.float64))
        dynamics.set_velocity(velocity)
        dynamics.kick(self.now, -0.5 * self.time_step, self.damping)
        if self.pieces_touch:
            self.fragments.renew(self.step_number)
        if dynamics.features.damping:
            for field in dynamics.damped:
                field.fill(0)

    # -- sampling ----------------------------------------------------------------------------------

    def sample_step(self) -> Sample:
        """Take one step and return the state at its start, with energies centred there.

        Raises:
            TooManyNodes: more nodes came near a body than its list holds.
        """
        step, at = self.step_number, self.time
        self.sampler.record(self.now)
        self._step(measure=True)
        self.energies.potential(1 - self.now)
        sums, (total, readings) = self.energies, self.sampler.collected()
        own = [body.energies(r) for body, r in zip(self.bodies, readings, strict=True)]
        pieces = self.fragments.reading() if self.pieces_touch else Touching()
        before = sum(reading.plate_before for reading in readings) + pieces.plate_before
        ledger = Ledger(
            float(total[KINETIC]) + before,
            sum((energies.kinetic for energies in own), 0.0),
            float(total[STRAIN]),
            float(total[FRACTURE]),
            float(total[DAMPED]),
            sum(energies.contact for energies in own) + pieces.lost + sums.lost_at_faces(total),
            sum((energies.external for energies in own), 0.0) + sums.work_of_gravity_in(total),
            float(pieces.elastic) + sum(reading.held for reading in readings),
            self.openings.energy,
        )
        if self.initial_ledger is None:
            self.initial_ledger = ledger
        start = self.initial_ledger
        since = at - self.last_sampled if self.last_sampled is not None else self.time_step
        sample = Sample(
            at,
            step,
            ledger,
            ledger.error(start),
            ledger.error_of_plate(start, 1e-3 * start.stored),
            int(total[BROKEN]),
            self.sampler.observed(readings, at, since, 1 - self.now)
            | (FRAGMENTS.observed(pieces) if self.pieces_touch else {}),
        )
        self.last_sampled = at
        return sample

    def fracture_of(self, chosen: npt.NDArray[np.bool_]) -> tuple[float, int]:
        """Energy that some of the bars have dissipated, J, and the number of them that are broken.

        What the volumes of modules have lost is not in it.

        Args:
            chosen: (14, *S) the bars.
        """
        dynamics = self.dynamics
        if not dynamics.features.damage:
            return 0.0, 0
        kept = dynamics.peak.to_numpy()
        losses = dynamics.fields().get("volume_loss", [])
        of_volumes = [field.to_numpy() for field in losses]
        for field in losses:
            field.fill(0)
        mine = dynamics.lanes.spread(chosen)
        dynamics.peak.from_numpy(np.where(mine, kept, 0).astype(kept.dtype))
        self.energies.potential(self.now)
        total = self.energies.total()
        for field, values in zip([dynamics.peak, *losses], [kept, *of_volumes], strict=True):
            field.from_numpy(values)
        return float(total[FRACTURE]), int(total[BROKEN])

    def samples(self, between: Callable[[], None] = lambda: None) -> Iterator[Sample]:
        """Run from the present time to the scene's end, yielding the history row by row.

        The last row is at the end, even within an interval.

        Args:
            between: called from time to time between two steps, when the state is complete.

        Raises:
            SimulationStopped: a NaN, an energy error above 5 % or above a tenth of the energy of
                the plate, energy from contact, or debris all around a rigid body.
        """
        while self.step_number <= self.steps:
            due = -(-self.step_number // self.sample_every) * self.sample_every
            try:
                self._advance_to(min(due, self.steps), between)
                sample = self.sample_step()
            except TooManyNodes as error:
                raise guard.stopped(self, self.step_number, str(error)) from None
            yield sample
            self.guard(sample)

    def _advance_to(self, step: int, between: Callable[[], None]) -> None:
        between()
        while self.step_number < step:
            self.advance(min(self._until_listing(), step - self.step_number))
            between()

    def guard(self, sample: Sample) -> None:
        """Stop at the first NaN, at too large an imbalance, or where contact creates energy.

        Raises:
            SimulationStopped: with time, step, place and likely cause.
        """
        guard.check(self, sample)

    def compile(self) -> None:
        """Compile every kernel that a run needs; the state is unchanged afterwards."""
        self._list_candidates()
        listed = [body.listed() for body in self.bodies]
        for body in self.bodies:
            body.set_nodes(np.zeros(0, dtype=np.int32))
        moving = [body for body in self.bodies if body.state is not None]
        states = [body.state.to_numpy() for body in moving]
        if self.pieces_touch:
            pieces = self.fragments.saved_state()
            self.fragments.compile(self.now)
        self._take(0.0)  # a step of zero length does all the work and changes nothing
        if self.steps_a_launch > 1 and not self.alone:
            self._take(0.0, self.steps_a_launch)
        if not self.dynamics.in_strips:
            self._take(0.0, measure=True)
        for body, state in zip(moving, states, strict=True):
            body.state.from_numpy(state)
        for body, nodes in zip(self.bodies, listed, strict=True):
            body.set_nodes(nodes)
        if self.pieces_touch:
            self.fragments.restore_state(pieces)
        self.sampler.record(self.now)
        self.energies.potential(self.now)
        _, readings = self.sampler.collected()
        for body, reading in zip(self.bodies, readings, strict=True):
            body.observe(reading, 0.0, 0.0, self.now)
        if self.dynamics.features.damage:
            self.dynamics.new_broken()

    def measure_step(self) -> float:
        """Seconds of a step on this machine without contact, from a few steps at rest."""
        started = time.perf_counter()
        for _ in range(3):
            self.dynamics.step(self.now, 0.0, 0.0, 0.0, False)
        ti.sync()
        return (time.perf_counter() - started) / 3

    def field_bytes(self) -> dict[str, int]:
        """Bytes of every field that was built for the scene."""
        sizes = {
            name: sum(field_bytes(field) for field in fields)
            for name, fields in self.dynamics.fields().items()
        }
        for body in self.bodies:
            sizes |= {name: field_bytes(field) for name, field in body.fields().items()}
        if self.pieces_touch:
            fields = self.fragments.fields()
            sizes |= {name: field_bytes(field) for name, field in fields.items()}
        sums = (self.energies.rows, self.energies.group_sums, self.sampler.recorded)
        return sizes | {"energies": sum(field_bytes(field) for field in sums)}

    # -- saving ------------------------------------------------------------------------------------

    def saved_state(self) -> dict[str, npt.NDArray]:
        """The state from which the next step starts: see ``saving.saved_state``."""
        return saving.saved_state(self)

    def restore_state(self, saved: saving.Saved) -> None:
        """Continue from ``saved_state`` of a simulation of the same scene.

        Raises:
            ValueError: the arrays do not fit this simulation; its state is undefined then.
        """
        saving.restore_state(self, saved)

    # -- results -----------------------------------------------------------------------------------

    def contact_loss(self, name: str) -> float:
        """Energy lost so far in contact with the body of a name, J; 0 where there is none."""
        body = self.body(name)
        if body is None:
            return 0.0
        sums = body.collected()
        return float(sums[LOSS_BEFORE] + sums[LOSS_AFTER])

    def displacement(self) -> npt.NDArray[np.float64]:
        """(sublattices, *S, 3) displacement of all nodes at ``time``, corner then centre, m."""
        return self._displacement(self.now)

    def displacement_before(self) -> npt.NDArray[np.float64]:
        """(sublattices, *S, 3) displacement one step before ``time``: that of a new sample, m."""
        return self._displacement(1 - self.now)

    def _displacement(self, buffer: int) -> npt.NDArray[np.float64]:
        values = np.zeros((self.dynamics.cell.sublattices, *self.dynamics.sites, 3))
        self.dynamics.get_displacement(buffer, values)
        return values

    def broken_fraction(self) -> npt.NDArray[np.float64]:
        """(nz, ny, nx) share of each module's bars reported broken; twenty in Fig. 1(a)."""
        nz, ny, nx = self.dynamics.lattice.mask.shape
        recorded = self.dynamics.recorded_bits()
        bars = self.dynamics.cell.of_module
        count = np.zeros(self.dynamics.lattice.mask.shape, dtype=np.int64)
        for bar, (dz, dy, dx) in bars:
            at = recorded[1 + dz : 1 + dz + nz, 1 + dy : 1 + dy + ny, 1 + dx : 1 + dx + nx]
            count += at >> bar & 1
        return count / len(bars)
