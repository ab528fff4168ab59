"""A simulation built from exactly what its scene names."""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
import taichi as ti

from taichi_ldem.errors import SceneError, SimulationStopped, TooManyNodes
from taichi_ldem.model import disorder
from taichi_ldem.model.lattice import Lattice, cut_out, disc, dumbbell_half_width, prism
from taichi_ldem.model.material import check
from taichi_ldem.scene import Plate, Scene
from taichi_ldem.solver import stability
from taichi_ldem.solver.contact import (
    DISPLACEMENT,
    IMPULSE,
    LOSS_AFTER,
    LOSS_BEFORE,
    PLATE_BEFORE,
    VELOCITY,
    VELOCITY_BEFORE,
    Grips,
    RigidBody,
    Rings,
    Striker,
    Supports,
)
from taichi_ldem.solver.dynamics import Dynamics, Features, field_apart, field_bytes
from taichi_ldem.solver.energy import BROKEN, DAMPED, FRACTURE, KINETIC, STRAIN, EnergySums, Ledger
from taichi_ldem.solver.gauge import Gauge

WARN_ERROR, STOP_ERROR = 0.01, 0.05
"""Energy errors at which a run warns and stops."""

STOP_ERROR_OF_PLATE = 0.1
"""Imbalance, over the energy that the plate holds, at which a run stops: a heavy striker's energy
would hide it from STOP_ERROR. Sound runs stay below 0.03."""

LEAST_SHARE = 1e-10
"""Energy of the plate, over all that there is, from which its imbalance is judged."""

COARSEST = 1e-3
"""Share of the largest elongation to which displacements must be known: rounding them heats the
lattice in every step."""

EXTREME_STRETCH, EXTREME_THRUST = 0.2, -0.5
"""Strains beyond which a stopped run names them: of a bar that was meant to break long before, and
of one that is about to pass through zero length."""

STEPS_BETWEEN_LISTS = 64
"""Steps between two listings of the nodes near a rigid body."""

STEPS_A_LAUNCH = 4
"""Steps that one kernel of a GPU takes: each is compiled on its own. Even, so that the buffers are
back in their places. On Vulkan it is one: four take Taichi's SPIR-V builder minutes, in which it
may fail (``Value does not yet exist``)."""

SUMS, GIVEN, NEAR = slice(0, 4), 4, 5
"""What a sample reads of a rigid body: its sums, its losses after the last sample time before this
step, and the most nodes that were ever near."""


@dataclass(frozen=True)
class Sample:
    """One row of the history.

    Attributes:
        time: s; step: its number.
        ledger: energies at that time.
        energy_error: imbalance over initial energy plus external work.
        energy_error_of_plate: imbalance over what the plate was given.
        broken_bars: so far.
        striker_displacement (m), striker_velocity (m/s): positive towards the plate; None without.
        striker_force: impulse over the time since the last sample, N; None without a striker.
        ring_force, support_force: the same for the clamp and for the supports, positive against the
            striker; None without.
        grip_displacement: how far the grips have moved apart, m; None without grips.
        grip_force: their mean pull, impulse over the time since the last sample, N; None without.
        gauge_strain, gauge_lateral_strain: see ``Gauge``; None without grips.
    """

    time: float
    step: int
    ledger: Ledger
    energy_error: float
    energy_error_of_plate: float
    broken_bars: int
    striker_displacement: float | None = None
    striker_velocity: float | None = None
    striker_force: float | None = None
    ring_force: float | None = None
    grip_displacement: float | None = None
    grip_force: float | None = None
    gauge_strain: float | None = None
    gauge_lateral_strain: float | None = None
    support_force: float | None = None


def build_lattice(scene: Scene) -> Lattice:
    """The lattice of a scene's plate."""
    plate = scene.plate
    mask = prism(*plate.modules)
    if plate.diameter is not None:
        mask = disc(*plate.modules, plate.diameter / plate.spacing)
    elif not plate.is_prism:
        mask = _specimen(plate)
    seed = plate.perturbation_seed
    return Lattice(mask, plate.spacing, plate.surface_weights, plate.perturbation, seed)


def _specimen(plate: Plate) -> npt.NDArray[np.bool_]:
    """Mask of a dumb-bell, or of a prism that is cut at an angle to the lattice."""
    edge = plate.spacing
    length, width = (side / edge for side in plate.size[:2])

    def half_width(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if plate.narrow_width and plate.narrow_length and plate.fillet_radius:
            narrow = (plate.narrow_width, plate.narrow_length, plate.fillet_radius)
            return dumbbell_half_width(x, width, *(value / edge for value in narrow))
        return np.full_like(x, width / 2)

    return cut_out(*plate.modules, length, half_width, math.radians(plate.angle))


def notch_bars(scene: Scene, lattice: Lattice) -> npt.NDArray[np.uint16]:
    """Bars that the scene's notches remove, one bit a bar.

    Raises:
        SceneError: a notch that cuts no bar.
    """
    removed = np.zeros(lattice.sites, dtype=np.uint16)
    for number, notch in enumerate(scene.notch):
        (a, b), (c, d) = notch.bounds
        cut = lattice.bars_crossing(notch.axes[0], notch.position, (a, c), (b, d))
        if not cut.any():
            raise SceneError(f"notch[{number}].position = {notch.position}: the plane cuts no bar")
        removed |= cut
    return removed


def build_dynamics(
    scene: Scene, in_strips: bool | None = None
) -> tuple[Dynamics, dict[str, tuple[float, float]]]:
    """The lattice's fields and kernels with all that a scene says of its material.

    Returns:
        The dynamics; mean and CV of the factors that were drawn, by property.

    Raises:
        SceneError: K_r < 1, or a notch that cuts no bar.
    """
    bars = check(scene)
    lattice = build_lattice(scene)
    drawn = disorder.draw(scene, lattice)
    material, strength = scene.material, drawn.strength if scene.material.damage else None
    features = Features(
        law=material.law if material.damage else None,
        damping=scene.solver.damping > 0,
        notch=bool(scene.notch),
        strength=strength is not None,
        modulus=drawn.youngs_modulus is not None,
        density=drawn.density is not None,
        perturbed=lattice.offsets is not None,
    )
    dynamics = Dynamics(lattice, bars, material.density, features, in_strips)
    if strength is not None:
        dynamics.set_strength(strength)
    if drawn.youngs_modulus is not None:
        dynamics.set_modulus(drawn.youngs_modulus)
    if drawn.density is not None:
        dynamics.set_own_density(material.density, drawn.density)
    if features.notch:
        dynamics.set_removed(notch_bars(scene, lattice))
    return dynamics, drawn.statistics(lattice)


@ti.data_oriented
class Simulation:
    """A plate, its striker, its clamp and its supports, stepped in time.

    Args:
        scene: what to build; Taichi must have been started for it (``backend.start``).
        in_strips: how the step is driven, if not as suits the backend (tests).

    Attributes:
        dynamics: the lattice's fields and kernels.
        striker, rings, grips, gauge, supports: None where the scene has none.
        bodies: those that there are.
        drawn: mean and CV of the random factors on the material's properties, by property.
        noted: (bodies + 1,) f64: losses of each body before a measured step, J, and the striker's
            displacement, m.
        time_step, critical_time_step: s.
        step_number: of the next step; the displacement at ``time`` lies in buffer ``now``.

    Raises:
        SceneError: K_r < 1, a clamp that holds nothing, or a time step above the critical one.
    """

    def __init__(self, scene: Scene, in_strips: bool | None = None):
        self.scene = scene
        self.dynamics, self.drawn = build_dynamics(scene, in_strips)
        solver = scene.solver
        self.spacing, self.damping = self.dynamics.lattice.spacing, solver.damping
        self.peak_strain = self.dynamics.peak_strain
        one_by_one = self.dynamics.in_strips or scene.solver.arch == "vulkan"
        self.steps_a_launch = 1 if one_by_one else STEPS_A_LAUNCH
        self.critical_time_step = stability.critical_time_step(self.dynamics)
        self.time_step, self.sample_every = self._choose_time_step()
        self.steps = round(solver.duration / self.time_step)
        self.rings = (
            Rings(self.dynamics, scene.clamp, scene.plate) if scene.clamp and scene.held else None
        )
        self.striker = (
            Striker(self.dynamics, scene.striker, self.time_step) if scene.striker else None
        )
        angle = math.radians(scene.plate.angle)
        self.grips = Grips(self.dynamics, scene.grips, angle) if scene.grips else None
        self.gauge = None
        if scene.grips and scene.grips.gauge_length:
            self.gauge = Gauge(self.dynamics, angle, scene.grips.gauge_length)
        self.supports = Supports(self.dynamics, scene.supports) if scene.supports else None
        parts = (self.rings, self.striker, self.grips, self.supports)
        self.bodies: list[RigidBody] = [part for part in parts if part is not None]
        self.energies = EnergySums(self.dynamics)
        self.strikes = self.striker is not None
        self.noted = field_apart(ti.f64, len(self.bodies) + 1)
        self.now, self.step_number = 0, 0
        self._start: Ledger | None = None
        self._last: float | None = None
        self._impulses = np.zeros(4)

    def _choose_time_step(self) -> tuple[float, int]:
        """Time step and the number of steps between two samples.

        "auto" is the safety factor times the critical step, shortened so that a whole number of
        steps makes a history interval.
        """
        solver, interval = self.scene.solver, self.scene.output.history_interval
        critical = self.critical_time_step
        if solver.time_step == "auto":
            every = int(np.ceil(interval / (solver.safety * critical) * (1 - 1e-12)))
            return interval / every, every
        chosen = float(solver.time_step)
        if chosen > critical and not solver.allow_unstable:
            raise SceneError(
                f"solver.time_step = {chosen}: above the critical time step {critical:.4g} s of "
                'this lattice; use "auto" or a smaller one (or solver.allow_unstable = true)'
            )
        return chosen, max(1, round(interval / chosen))

    # -- stepping
    # -----------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time of the displacement in buffer ``now``, s."""
        return self.step_number * self.time_step

    @ti.func
    def _resolve(self, now, spacing, time_step, damping):
        for n in ti.static(range(len(self.bodies))):
            self.bodies[n].resolve(now, spacing, time_step, damping)

    @ti.kernel
    def _contact(self, now: int, spacing: float, time_step: float, damping: float):
        self._resolve(now, spacing, time_step, damping)

    @ti.kernel
    def _launch(
        self,
        now: int,
        spacing: float,
        time_step: float,
        damping: float,
        peak_strain: float,
        steps: ti.template(),
        measure: ti.template(),
    ):
        """Take steps in whole passes, all in one kernel: none waits for Python."""
        other = 1 - now
        for n in ti.static(range(steps)):
            if ti.static(n % 2 == 0):
                self._pass(now, spacing, time_step, damping, peak_strain, measure)
            else:
                self._pass(other, spacing, time_step, damping, peak_strain, measure)

    @ti.func
    def _pass(self, now, spacing, time_step, damping, peak_strain, measure: ti.template()):
        numbers = ti.Struct(
            spacing=spacing,
            kick=time_step,
            drift=time_step,
            damping=damping,
            peak_strain=peak_strain,
        )
        self.dynamics.whole_passes(now, numbers, measure)
        self._resolve(now, spacing, time_step, damping)

    def _take(self, time_step: float, steps: int = 1, measure: bool = False) -> None:
        """Take steps from ``now``; on the CPU one."""
        dynamics, spacing = self.dynamics, self.spacing
        if not dynamics.in_strips:
            self._launch(
                self.now, spacing, time_step, self.damping, self.peak_strain, steps, measure
            )
            return
        dynamics.step(self.now, time_step, time_step, self.damping, measure)
        if self.bodies:
            self._contact(self.now, spacing, time_step, self.damping)

    def _step(self, steps: int = 1, measure: bool = False) -> None:
        if self.step_number % STEPS_BETWEEN_LISTS == 0:
            self._list_candidates()
        self._take(self.time_step, steps, measure)
        self.now = (self.now + steps) % 2
        self.step_number += steps

    def _list_candidates(self) -> None:
        """List the nodes that may touch a rigid body before the next listing."""
        for body in self.bodies:
            if body.moving:
                body.list_nodes(self.now, STEPS_BETWEEN_LISTS * self.time_step)

    def advance(self, steps: int) -> None:
        """Take a number of steps without looking."""
        end = self.step_number + steps
        while self.step_number < end:
            listing = STEPS_BETWEEN_LISTS - self.step_number % STEPS_BETWEEN_LISTS
            many = min(listing, end - self.step_number) >= self.steps_a_launch
            self._step(self.steps_a_launch if many else 1)

    def start_from(
        self, displacement: npt.NDArray[np.float64], velocity: npt.NDArray[np.float64]
    ) -> None:
        """Set the state at t = 0: (2, *S, 3) arrays, corner then centre, m and m/s."""
        dynamics = self.dynamics
        dynamics.set_displacement(self.now, np.ascontiguousarray(displacement, dtype=np.float64))
        dynamics.set_velocity(velocity)
        dynamics.kick(self.now, -0.5 * self.time_step, self.damping)
        if dynamics.features.damping:
            for field in dynamics.damped:
                field.fill(0)

    # -- sampling
    # -----------------------------------------------------------------------------------

    @ti.kernel
    def _note(self):
        """Note what a measured step goes on from."""
        for n in ti.static(range(len(self.bodies))):
            self.bodies[n].add_up()
        ti.loop_config(serialize=True)
        for _ in range(1):
            for n in ti.static(range(len(self.bodies))):
                self.noted[n] = self.bodies[n].sums[LOSS_AFTER]
            if ti.static(self.strikes):
                last = ti.static(len(self.bodies))
                self.noted[last] = self.striker.state[DISPLACEMENT]  # type: ignore[union-attr]

    @ti.kernel
    def _collect(self, values: ti.types.ndarray()):
        """Add up what a sample needs, into one small array."""
        self.energies.add_up()
        for n in ti.static(range(len(self.bodies))):
            self.bodies[n].add_up()
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = self.energies.sums()
            for n in ti.static(range(5)):
                values[0, n] = total[n]
            for n in ti.static(range(len(self.bodies))):
                for m in ti.static(range(4)):
                    values[1 + n, m] = self.bodies[n].sums[m]
                values[1 + n, GIVEN] = self.noted[n]
                values[1 + n, NEAR] = self.bodies[n].count[1]
            if ti.static(self.strikes):
                last = ti.static(len(self.bodies))
                values[1 + last, 0] = self.noted[last]
                values[1 + last, 1] = self.striker.state[VELOCITY_BEFORE]  # type: ignore[union-attr]
                values[1 + last, 2] = self.striker.state[VELOCITY]  # type: ignore[union-attr]

    def _collected(self) -> tuple[Any, Any, tuple[float, float, float]]:
        """Energies, numbers of every body, the striker's displacement and velocities around it.

        Raises:
            TooManyNodes: more nodes came near a body than its list holds.
        """
        values = np.zeros((len(self.bodies) + 2, 6))
        self._collect(values)
        for body, numbers in zip(self.bodies, values[1:], strict=False):
            body.refuse_more(int(numbers[NEAR]))
        moved, before, after = values[-1, :3].tolist()
        return values[0], values[1:-1], (moved, before, after)

    def sample_step(self) -> Sample:
        """Take one step and return the state at its start, with energies centred there.

        Raises:
            TooManyNodes: more nodes came near a body than its list holds.
        """
        step, at = self.step_number, self.time
        self._note()
        self._step(measure=True)
        self.energies.potential(1 - self.now)
        total, contact, motion = self._collected()
        moved, before, after = motion
        given = [float(c[GIVEN] + c[LOSS_BEFORE]) for c in contact]
        # what grips take is no loss but their work, with the other sign
        lost = sum(g for g, b in zip(given, self.bodies, strict=True) if b is not self.grips)
        kinetic = float(total[KINETIC]) + sum(float(c[PLATE_BEFORE]) for c in contact)
        striker = self.scene.striker
        kinetic_striker = external = 0.0
        if striker is not None:
            kinetic_striker = 0.5 * striker.mass * before * after
            external = striker.mass * striker.gravity * moved
        external += lost - sum(given)
        ledger = Ledger(
            kinetic,
            kinetic_striker,
            float(total[STRAIN]),
            float(total[FRACTURE]),
            float(total[DAMPED]),
            lost,
            external,
        )
        impulses = contact[:, IMPULSE].tolist()
        sample = self._row(step, at, ledger, int(total[BROKEN]), impulses, motion)
        self._last = at
        return sample

    def fracture_of(self, chosen: npt.NDArray[np.bool_]) -> tuple[float, int]:
        """What some of the bars have dissipated so far, J, and how many of them are broken.

        Args:
            chosen: (14, *S) the bars.
        """
        dynamics = self.dynamics
        if not dynamics.features.damage:
            return 0.0, 0
        kept = [field.to_numpy() for field in dynamics.peak]
        for field, peak, mine in zip(dynamics.peak, kept, chosen, strict=True):
            field.from_numpy(np.where(dynamics.lanes.spread(mine), peak, 0).astype(peak.dtype))
        self.energies.potential(self.now)
        total = self.energies.total()
        for field, peak in zip(dynamics.peak, kept, strict=True):
            field.from_numpy(peak)
        return float(total[FRACTURE]), int(total[BROKEN])

    def _row(
        self,
        step: int,
        at: float,
        ledger: Ledger,
        broken: int,
        impulses: list[float],
        motion: tuple[float, float, float],
    ) -> Sample:
        if self._start is None:
            self._start = ledger
        since = at - self._last if self._last is not None else self.time_step
        forces: list[float | None] = [None, None, None, None]
        for n, body in enumerate((self.striker, self.rings, self.grips, self.supports)):
            if body is not None:
                impulse = impulses[self.bodies.index(body)]
                forces[n] = (impulse - self._impulses[n]) / since
                self._impulses[n] = impulse
        moved, before, after = motion
        strains = self.gauge.strains(1 - self.now) if self.gauge is not None else (None, None)
        return Sample(
            at,
            step,
            ledger,
            ledger.error(self._start),
            ledger.error_of_plate(self._start, 1e-3 * self._start.stored),
            broken,
            moved if self.striker is not None else None,
            0.5 * (before + after) if self.striker is not None else None,
            -forces[0] if forces[0] is not None else None,
            forces[1],
            self.grips.separation_at(at) if self.grips is not None else None,
            forces[2],
            strains[0],
            strains[1],
            forces[3],
        )

    def samples(self, between: Callable[[], None] = lambda: None) -> Iterator[Sample]:
        """Run to the scene's end from where it is, yielding the history row by row.

        The last row is the end's, also where it falls within an interval.

        Args:
            between: called now and then between two steps, where the state is whole.

        Raises:
            SimulationStopped: a NaN, an energy error above 5 % or above a tenth of what the plate
                holds, energy from contact, or debris all around a rigid body.
        """
        while self.step_number <= self.steps:
            due = -(-self.step_number // self.sample_every) * self.sample_every
            try:
                self._advance_to(min(due, self.steps), between)
                sample = self.sample_step()
            except TooManyNodes as error:
                raise self._stopped(self.step_number, str(error)) from None
            yield sample
            self.guard(sample)

    def _advance_to(self, step: int, between: Callable[[], None]) -> None:
        between()
        while self.step_number < step:
            listing = STEPS_BETWEEN_LISTS - self.step_number % STEPS_BETWEEN_LISTS
            self.advance(min(listing, step - self.step_number))
            between()

    def guard(self, sample: Sample) -> None:
        """Stop at the first NaN, at too large an imbalance, or where contact gives energy.

        Raises:
            SimulationStopped: with time, step, place and likely cause.
        """
        ledger, start = sample.ledger, self._start
        assert start is not None
        held = max(ledger.held_by_plate, LEAST_SHARE * (start.stored + abs(ledger.external)))
        imbalance = abs(ledger.imbalance(start))
        if not np.isfinite(ledger.stored):
            what = "the energies are not finite"
        elif sample.energy_error > STOP_ERROR:
            what = f"the energy error reached {100 * sample.energy_error:.3g} %"
        elif imbalance > STOP_ERROR_OF_PLATE * held:
            what = (
                f"the energy error reached {100 * imbalance / held:.3g} % of what the plate holds"
            )
        elif self._gained(ledger) > STOP_ERROR_OF_PLATE:
            what = f"contact gave the plate {-ledger.contact:.3g} J"
        else:
            return
        raise self._stopped(sample.step, what, ledger)

    def _gained(self, ledger: Ledger) -> float:
        """What contact gave, which should only take, over what there was or what the plate has."""
        if self._start is ledger or self._start is None:
            return 0.0  # half of the first step's works are not there yet
        given = self._start.stored - ledger.kinetic_striker + ledger.external
        # before anything has touched, rounding of what presses on a ring is all that there is
        least = LEAST_SHARE * self._start.stored
        scale = max(ledger.held_by_plate, abs(given), least)
        return -ledger.contact / scale if scale > 0 else 0.0

    def _stopped(self, step: int, what: str, ledger: Ledger | None = None) -> SimulationStopped:
        """The error that tells what happened, where, and why, most likely."""
        return SimulationStopped(
            f"t = {step * self.time_step:.6g} s, step {step}: {what}, fastest "
            f"{self._worst_node()}; likely cause: {self._cause(ledger)}"
        )

    def _cause(self, ledger: Ledger | None) -> str:
        step, critical = self.time_step, self.critical_time_step
        if step > critical:
            return f"the time step {step:.3g} s is above the critical one, {critical:.3g} s"
        if ledger is not None and self._gained(ledger) > STOP_ERROR_OF_PLATE:
            return (
                "contact gave energy: a rigid body lay inside the plate, or is so sharp that nodes "
                "go round it within a step"
            )
        moved = self.displacement_before()
        longest, shortest = stability.largest_strains(self.dynamics, moved)
        digits = float(np.finfo(self.dynamics.numpy_float()).eps) * np.abs(moved).max()
        if digits > COARSEST * max(longest, -shortest) * self.spacing:
            return (
                f"displacements of {np.abs(moved).max():.3g} m are known to {digits:.1g} m, not "
                f'enough for strains of {max(longest, -shortest):.1g}; use solver.precision = "f64"'
            )
        if longest < EXTREME_STRETCH and shortest > EXTREME_THRUST:
            return "a collision too fast for the time step; try a smaller solver.safety"
        bars = f"bars are at {1 + shortest:.3g} to {1 + longest:.3g} of their length"
        if step > stability.STRETCHED * critical:
            return (
                f"{bars}: stretched bars lower the critical time step; try solver.safety <= "
                f"{stability.STRETCHED:.2f}"
            )
        return f"{bars}: near zero length a bar turns round within a step; strike more slowly"

    def _worst_node(self) -> str:
        """Place of the first node whose velocity is not finite, or else of the fastest."""
        speed = np.linalg.norm(self.dynamics.get_velocity(), axis=-1)
        bad = ~np.isfinite(speed)
        index = np.argmax(bad) if bad.any() else np.argmax(speed)
        place = np.unravel_index(index, speed.shape)
        x, y, z = self.dynamics.lattice.positions()[place] * 1e3
        kind = "centre" if place[0] else "corner"
        return f"at {kind} node x = {x:.2f}, y = {y:.2f}, z = {z:.2f} mm ({speed[place]:.3g} m/s)"

    def compile(self) -> None:
        """Compile every kernel that a run needs; nothing has moved afterwards."""
        self._list_candidates()
        listed = [body.listed() for body in self.bodies]
        for body in self.bodies:
            body.set_nodes(np.zeros(0, dtype=np.int32))
        moved = [body for body in (self.striker, self.grips) if body is not None]
        states = [body.state.to_numpy() for body in moved]
        self._take(0.0)  # a step of no length: all the work, and nothing moves
        if self.steps_a_launch > 1:
            self._take(0.0, self.steps_a_launch)
        if not self.dynamics.in_strips:
            self._take(0.0, measure=True)
        for body, state in zip(moved, states, strict=True):
            body.state.from_numpy(state)
        for body, nodes in zip(self.bodies, listed, strict=True):
            body.set_nodes(nodes)
        self._note()
        self.energies.potential(self.now)
        self._collected()
        if self.gauge is not None:
            self.gauge.strains(self.now)
        if self.dynamics.features.damage:
            self.dynamics.new_broken()

    def measure_step(self) -> float:
        """Seconds that a step takes here, from a few at rest; contact comes on top."""
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
        for part in ("rings", "striker", "grips", "gauge", "supports"):
            for name, value in vars(getattr(self, part) or object).items():
                if isinstance(value, ti.Field):
                    sizes[f"{part}.{name}"] = field_bytes(value)
        sums = (self.energies.rows, self.energies.group_sums, self.noted)
        return sizes | {"energies": sum(field_bytes(field) for field in sums)}

    # -- saving
    # -----------------------------------------------------------------------------------

    def _parts(self) -> dict[str, Any]:
        """Whatever has a state of its own, by name; what a scene leaves out is not there."""
        return {n: part for n, part in vars(self).items() if hasattr(part, "saved_state")}

    def saved_state(self) -> dict[str, npt.NDArray]:
        """What the next step starts from, between two steps: arrays by names ``part/field``.

        Of the time step only the critical one is kept, which a solver's rounding may change from
        machine to machine; the rest follows from the scene.
        """
        start = [] if self._start is None else list(vars(self._start).values())
        saved = {
            "clock/step_number": np.array(self.step_number),
            "clock/now": np.array(self.now),
            "clock/critical_time_step": np.array(self.critical_time_step),
            "clock/drawn": np.array(list(self.drawn.values())).reshape(-1, 2),
            "ledger/start": np.array(start, dtype=np.float64),
            "ledger/last": np.array([] if self._last is None else [self._last]),
            "ledger/impulses": self._impulses.copy(),
        }
        for name, part in self._parts().items():
            own = part.saved_state(self.now) if part is self.dynamics else part.saved_state()
            saved |= {f"{name}/{field}": values for field, values in own.items()}
        return saved

    def restore_state(self, saved: Mapping[str, npt.NDArray]) -> None:
        """Continue from ``saved_state`` of a simulation of the same scene.

        Raises:
            ValueError: what is saved does not fit; nothing has been changed then, or all is void.
        """
        self._refuse_unfit(saved)
        self.step_number, self.now = int(saved["clock/step_number"]), int(saved["clock/now"])
        self.critical_time_step = float(saved["clock/critical_time_step"])
        self.time_step, self.sample_every = self._choose_time_step()
        self.steps = round(self.scene.solver.duration / self.time_step)
        start, last = saved["ledger/start"], saved["ledger/last"]
        self._start = Ledger(*(float(value) for value in start)) if len(start) else None
        self._last = float(last[0]) if len(last) else None
        self._impulses = saved["ledger/impulses"].copy()
        for name, part in self._parts().items():
            prefix = f"{name}/"
            part.restore_state(
                {n.removeprefix(prefix): v for n, v in saved.items() if n.startswith(prefix)}
            )

    def _refuse_unfit(self, saved: Mapping[str, npt.NDArray]) -> None:
        """Raise ValueError unless names, types and shapes are those of this simulation's state."""
        mine = self.saved_state()
        for name in sorted(mine.keys() ^ saved.keys()):
            raise ValueError(f"'{name}' is {'missing' if name in mine else 'not of this scene'}")
        for name, values in saved.items():
            own = mine[name]
            free = name.endswith(("/nodes", "/before", "/start", "/last"))  # of any length
            same = values.shape[1:] == own.shape[1:] if free else values.shape == own.shape
            if not same or values.ndim != own.ndim or values.dtype != own.dtype:
                raise ValueError(f"'{name}' has another shape or type")
        if len(saved["ledger/start"]) not in (0, len(fields(Ledger))) or (
            len(saved["ledger/last"]) != bool(len(saved["ledger/start"]))
        ):
            raise ValueError("'ledger' has another shape")
        critical = float(saved["clock/critical_time_step"])
        if not abs(critical - self.critical_time_step) <= 1e-6 * self.critical_time_step:
            raise ValueError(
                f"the critical time step was {critical:.6g} s, is {self.critical_time_step:.6g} s"
            )
        # the random fields themselves are drawn again, from the seed
        if not np.allclose(saved["clock/drawn"], mine["clock/drawn"], rtol=1e-9, atol=0):
            raise ValueError("its random fields were others than the scene's seed gives here")
        if saved["clock/now"] not in (0, 1) or not 0 <= saved["clock/step_number"] <= 10**12:
            raise ValueError("'clock' is not a step's")

    # -- results
    # ------------------------------------------------------------------------------------

    def contact_loss(self, body: RigidBody | None) -> float:
        """Energy lost so far in contact with a body of the simulation, J."""
        if body is None:
            return 0.0
        sums = body.collected()
        return float(sums[LOSS_BEFORE] + sums[LOSS_AFTER])

    def displacement(self) -> npt.NDArray[np.float64]:
        """(2, *S, 3) displacement of all nodes at ``time``, corner then centre, m."""
        return self._displacement(self.now)

    def displacement_before(self) -> npt.NDArray[np.float64]:
        """(2, *S, 3) displacement one step before ``time``: that of a sample just taken, m."""
        return self._displacement(1 - self.now)

    def _displacement(self, buffer: int) -> npt.NDArray[np.float64]:
        values = np.zeros((2, *self.dynamics.sites, 3))
        self.dynamics.get_displacement(buffer, values)
        return values

    def broken_fraction(self) -> npt.NDArray[np.float64]:
        """(nz, ny, nx) share of each module's twenty bars (Fig. 1(a)) reported broken."""
        nz, ny, nx = self.dynamics.lattice.mask.shape
        recorded = self.dynamics.recorded_bits()

        def broken(bar: int, dz: int = 0, dy: int = 0, dx: int = 0) -> npt.NDArray[np.int64]:
            at = recorded[1 + dz : 1 + dz + nz, 1 + dy : 1 + dy + ny, 1 + dx : 1 + dx + nx]
            return (at >> bar & 1).astype(np.int64)

        count = np.zeros(self.dynamics.lattice.mask.shape, dtype=np.int64)
        for bar in range(6, 14):
            count += broken(bar)
        for a in (0, 1):
            for b in (0, 1):
                count += broken(0, a, b, 0) + broken(1, a, 0, b) + broken(2, 0, a, b)
        return count / 20
