"""Loads, the start of a plate, and probes, against theory."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene

from taichi_ldem.model.material import bar_families
from taichi_ldem.scene import Material, Scene

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Sample, Simulation

LENGTH = 40  # modules of the bar, two by two across
VOLUME = LENGTH * 4 * SPACING**3
MASS = PMMA["density"] * VOLUME
SECTION = 4 * SPACING**2
MODULUS = 0.935 * PMMA["youngs_modulus"]  # in effect, of a bar that is two modules across
SPEED = np.sqrt(MODULUS / PMMA["density"])  # of waves in the bar, m/s
ALL = {"box": [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]}
NOTHING = {"face": "-x", "force": 0.0, "direction": "x"}
TABLE = {"course": "table", "times": [1e-6, 3e-6, 4e-6, 9e-6], "factors": [0.5, 2.0, -1.0, 0.25]}


def bar(*loads: dict[str, Any], **tables: Any) -> Scene:
    """A free elastic bar along x with two loads and three probes."""
    middle = {"plane": "x", "position": 0.0}
    probes = [
        {"plane": "x", "position": LENGTH / 2 * SPACING},
        ALL,
        middle | {"name": "middle", "quantities": ["velocity", "strain", "stress"]},
    ]
    return block_scene(LENGTH, 2, 2, load=[*loads, NOTHING, NOTHING][:2], probe=probes, **tables)


@pytest.fixture(scope="module")
def built(taichi: None) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    push = {"force": 1.0, "direction": "x"}
    return Simulation(bar(ALL | push | TABLE, ALL | push))


def sampled(simulation: "Simulation", scene: Scene, steps: int, every: int = 10) -> "list[Sample]":
    """The samples of a run of a scene, the first one at t = 0."""
    simulation.reset(scene)
    samples = []
    for _ in range(steps // every):
        samples.append(simulation.sample_step())
        simulation.advance(every - 1)
    samples.append(simulation.sample_step())
    assert max(sample.energy_error for sample in samples) < 1e-4
    return samples


def test_a_constant_force_on_a_free_block_gives_f_over_m(built: "Simulation") -> None:
    force, direction = 0.3, np.array([1.0, 2.0, -2.0]) / 3
    samples = sampled(built, bar(ALL | {"force": force, "direction": [1, 2, -2]}), 200)
    last, way = samples[-1], 0.5 * force / MASS * samples[-1].time ** 2
    moved = [last.observed[f"probe2_displacement_{axis}_m"] for axis in "xyz"]
    np.testing.assert_allclose(moved, way * direction, rtol=1e-9)
    speed = [last.observed[f"probe2_velocity_{axis}_m_s"] for axis in "xyz"]
    np.testing.assert_allclose(speed, force / MASS * last.time * direction, rtol=1e-9)
    assert last.observed["load1_displacement_m"] == pytest.approx(way, rel=1e-9)
    assert last.observed["load1_force_n"] == pytest.approx(force, rel=1e-12)
    ledger, start = last.ledger, samples[0].ledger
    work = ledger.external - start.external
    assert work == pytest.approx(force * way, rel=1e-9)
    assert ledger.kinetic_plate - start.kinetic_plate == pytest.approx(work, rel=1e-9)
    assert ledger.strain < 1e-12 * work


def test_a_traction_step_sends_a_wave_of_this_stress(built: "Simulation") -> None:
    """Its speed is c, and the end of the bar moves at traction / (rho c)."""
    traction = 1e5
    samples = sampled(built, bar({"face": "+x", "traction": traction, "direction": "x"}), 90)
    last = samples[-1]
    assert 0.6 < SPEED * last.time / (LENGTH * SPACING) < 1  # it has not reached the other end
    assert last.observed["load1_force_n"] == pytest.approx(traction * SECTION, rel=1e-9)
    way = traction / (PMMA["density"] * SPEED) * last.time
    assert last.observed["load1_displacement_m"] == pytest.approx(way, rel=0.01)
    # momentum of the whole bar, and the place of the wave's front
    velocity = last.observed["probe2_velocity_x_m_s"]
    assert MASS * velocity == pytest.approx(traction * SECTION * last.time, rel=1e-9)
    behind = traction / (PMMA["density"] * SPEED)
    planes = built.dynamics.get_velocity()[0, 1:4, 1:4, 1:-1, 0].mean(axis=(0, 1))
    front = np.count_nonzero(planes > 0.5 * behind) * SPACING
    assert front == pytest.approx(SPEED * last.time, rel=0.1)
    work = last.ledger.external - samples[0].ledger.external
    assert work == pytest.approx(traction * SECTION * way, rel=0.01)


def test_the_stress_of_a_travelling_pulse_is_rho_c_v(built: "Simulation") -> None:
    """A smooth push from the left passes the middle before any of it comes back."""
    push = {"face": "-x", "traction": 1e5, "direction": "x"}
    pulse = push | {"course": "half-sine", "duration": 1e-5}
    samples = sampled(built, bar(pulse), 130, 5)
    assert SPEED * samples[-1].time < 1.5 * LENGTH * SPACING
    stress, strain, speed = (
        np.array([sample.observed[f"middle_{name}"] for sample in samples])
        for name in ("stress_xx_pa", "strain_xx", "velocity_x_m_s")
    )
    wanted = -PMMA["density"] * SPEED * speed
    assert np.abs(stress).max() == pytest.approx(1e5, rel=0.05)
    np.testing.assert_allclose(stress, wanted, rtol=0, atol=0.03 * np.abs(wanted).max())
    np.testing.assert_allclose(strain, stress / MODULUS, rtol=0, atol=0.03 * np.abs(strain).max())


def test_a_prescribed_velocity_gives_its_momentum_and_its_work(built: "Simulation") -> None:
    speed, ramp = 2.0, 5e-6
    motion = {"velocity": speed, "direction": "-y", "course": "ramp", "ramp": ramp}
    samples = sampled(built, bar(ALL | motion | {"lateral": "held"}), 120)
    last = samples[-1]
    assert last.time > ramp
    assert last.observed["probe2_velocity_y_m_s"] == pytest.approx(-speed, rel=1e-12)
    way = speed * (last.time - 0.5 * ramp)
    assert last.observed["load1_displacement_m"] == pytest.approx(way, rel=1e-9)
    assert last.observed["load1_force_n"] == pytest.approx(0.0, abs=1e-9)
    forces = [sample.observed["load1_force_n"] for sample in samples[1:]]
    steps = np.diff([sample.time for sample in samples])
    assert forces @ steps == pytest.approx(MASS * speed, rel=1e-2)  # the first step is apart
    work = last.ledger.external - samples[0].ledger.external
    assert work == pytest.approx(0.5 * MASS * speed**2, rel=1e-6)


def test_a_displaced_end_stretches_a_held_bar(built: "Simulation") -> None:
    """Slowly: the reaction is E A times the strain, and half of it times the way is the work."""
    way, time = 1e-5, 1.2e-4
    pull = {"face": "+x", "displacement": way, "direction": "x", "course": "ramp", "ramp": time}
    hold = {"face": "-x", "velocity": 0.0, "direction": "-x"}
    tables = {"solver": {"duration": time, "safety": 0.7}}
    samples = sampled(built, bar(pull, hold, **tables), 1200, 20)
    last = samples[-1]
    assert last.time > time
    assert last.observed["load1_displacement_m"] == pytest.approx(way, rel=1e-12)
    force = MODULUS * SECTION * way / (LENGTH * SPACING)
    for name in ("load1", "load2"):
        late = [s.observed[f"{name}_force_n"] for s in samples if s.time > time]
        assert np.mean(late) == pytest.approx(force, rel=0.01), name
    work = last.ledger.external - samples[0].ledger.external
    assert work == pytest.approx(0.5 * force * way, rel=0.01)


def test_half_a_sine_and_a_table_give_their_impulses(built: "Simulation") -> None:
    force, duration, begin = 0.2, 6e-6, 1.5e-6
    sine = {"course": "half-sine", "duration": duration, "start": begin}
    loads = [ALL | {"force": force, "direction": "x"} | sine]
    loads += [ALL | {"force": force, "direction": "z"} | TABLE]
    last = sampled(built, bar(*loads), 120)[-1]
    assert last.time > 9e-6
    momentum = MASS * np.array([last.observed[f"probe2_velocity_{a}_m_s"] for a in "xz"])
    # exact but for the step of the rule that adds them up
    assert momentum[0] == pytest.approx(force * duration * 2 / np.pi, rel=1e-3)
    times, factors = TABLE["times"], TABLE["factors"]
    whole = np.trapezoid([0.5, *factors, 0.25], [0.0, *times, last.time])
    assert momentum[1] == pytest.approx(force * whole, rel=2e-2)


def test_a_table_of_velocity_moves_by_its_integral(built: "Simulation") -> None:
    load = ALL | {"velocity": 1.0, "direction": "z"} | TABLE
    last = sampled(built, bar(load), 120)[-1]
    times, factors = [0.0, *TABLE["times"], last.time], [0.5, *TABLE["factors"], 0.25]
    whole = np.trapezoid(factors, times)
    assert last.observed["load1_displacement_m"] == pytest.approx(whole, rel=1e-12)


def test_motions_at_right_angles_go_together(built: "Simulation") -> None:
    loads = [ALL | {"velocity": v, "direction": d} for v, d in ((3.0, "x"), (4.0, "-z"))]
    last = sampled(built, bar(*loads), 20)[-1]
    speed = [last.observed[f"probe2_velocity_{axis}_m_s"] for axis in "xyz"]
    np.testing.assert_allclose(speed, [3.0, 0.0, -4.0], rtol=1e-12, atol=1e-12)
    assert last.ledger.kinetic_plate == pytest.approx(0.5 * MASS * 25.0, rel=1e-12)
    assert last.ledger.external == pytest.approx(0.5 * MASS * 25.0, rel=1e-12)


@pytest.mark.parametrize("kind", ["velocity", "rotation", "expansion", "strain"])
def test_the_start_has_the_energy_of_closed_forms(built: "Simulation", kind: str) -> None:
    start = {
        "velocity": [1.0, -2.0, 3.0],
        "rotation": [100.0, 30.0, -50.0],
        "expansion": 40.0,
        "strain": [1e-6, -2e-6, 3e-6],
    }
    scene = bar(start={kind: start[kind]}, plate={"velocity": [0.5, 0.0, 0.0]})
    built.reset(scene)
    ledger = built.sample_step().ledger
    masses = built.dynamics.masses()[..., None]
    velocity = built.dynamics.get_velocity()
    momentum = (masses * velocity).sum(axis=(0, 1, 2, 3))
    thrown = np.array([0.5, 0.0, 0.0])
    mean = thrown + np.array(start["velocity"] if kind == "velocity" else 0.0)
    if kind != "strain":
        np.testing.assert_allclose(momentum, MASS * mean, rtol=1e-12, atol=1e-12 * MASS)
    place = built.dynamics.lattice.positions() - [0.0, 0.0, SPACING]
    # second moments of the nodes' masses, which are those of whole modules but for a share of L
    xx, yy, zz = (masses * place**2).sum(axis=(0, 1, 2, 3))
    wx, wy, wz = start["rotation"]
    kinetic = {
        "rotation": 0.5 * (wx**2 * (yy + zz) + wy**2 * (xx + zz) + wz**2 * (xx + yy)),
        "expansion": 0.5 * start["expansion"] ** 2 * (xx + yy),
    }
    own = 0.5 * MASS * mean @ mean + kinetic.get(kind, 0.0)
    if kind != "strain":
        assert ledger.kinetic_plate == pytest.approx(own, rel=1e-12)
        assert ledger.strain == 0.0
        return
    # half EA L eps^2 of every bar, with the strain along it
    lattice, cell, energy = built.dynamics.lattice, built.dynamics.cell, 0.0
    families = bar_families(Material(**PMMA), SPACING)
    whole = lattice.bar_shares().sum(axis=(0, 1, 2))
    for n, vector in enumerate(cell.vectors):
        square = vector @ vector
        along = np.array(start["strain"]) @ vector**2 / square
        length = SPACING * np.sqrt(square)
        stiffness = families[cell.family[n]].axial_stiffness
        energy += 0.5 * whole[n] * stiffness * length * along**2
    assert ledger.strain == pytest.approx(energy, rel=1e-4)


def test_a_restored_state_of_loads_goes_on_bitwise(built: "Simulation") -> None:
    pull = {"face": "+x", "velocity": 2.0, "direction": [1, 1, 0], "course": "ramp", "ramp": 4e-6}
    push = {"face": "+y", "traction": 1e6, "direction": "-y"} | TABLE
    scene = bar(pull, push, start={"rotation": [0, 0, 50.0], "strain": [1e-4, 0, 0]})
    samples = sampled(built, scene, 90, 30)
    whole = built.displacement()
    built.reset(scene)
    built.sample_step()
    built.advance(29)
    saved = built.saved_state()
    built.reset(scene)
    built.restore_state(saved)
    again = []
    for _ in range(2):
        again.append(built.sample_step())
        built.advance(29)
    again.append(built.sample_step())
    assert [vars(s) for s in again] == [vars(s) for s in samples[1:]]
    np.testing.assert_array_equal(built.displacement(), whole)


REGIONS = {  # with the area that a traction acts on, in modules
    "face": ({"face": "+x"}, 4),
    "box": ({"box": [[0.01, -1.0, -1.0], [1.0, 1.0, 1.0]]}, 4),
    # on a face that is two modules wide: 2 + 2 / 2 nodes around the middle one, and then
    # 2 + 4 / 2 + 4 / 2, as nodes on an edge have half of a module's area
    "circle": ({"face": "+z", "outer_diameter": 1.2e-3}, 4),
    "band": ({"face": "+z", "inner_diameter": 1.2e-3, "outer_diameter": 2.4e-3}, 6),
}
COURSES = {
    "constant": {},
    "ramp": {"course": "ramp", "ramp": 4e-6},
    "half-sine": {"course": "half-sine", "duration": 6e-6},
    "table": {"course": "table", "times": [0.0, 2e-6, 5e-6], "factors": [0.0, 1.5, -0.5]},
}
EVERY = 8
"""Steps from one sample to the next."""
VALUES = {"velocity": 0.5, "displacement": 1e-6, "traction": 1e5, "force": 0.1}
CASES = [
    (region, kind, course)
    # each region with each kind and each course, and each kind with each course
    for n, kind in enumerate(VALUES)
    for m, course in enumerate(COURSES)
    for region in [[*REGIONS][(n + m) % len(REGIONS)]]
    if (kind, course) != ("displacement", "constant")  # a jump, which is refused
]


def factor_of(course: str, time: np.ndarray) -> np.ndarray:
    """The factor of a course, from the page."""
    keys = COURSES[course]
    if course == "ramp":
        share = np.minimum(time / keys["ramp"], 1.0)
        return 3 * share**2 - 2 * share**3
    if course == "half-sine":
        within = time <= keys["duration"]
        return np.where(within, np.sin(np.pi * time / keys["duration"]), 0.0)
    return np.interp(time, keys["times"], keys["factors"]) if keys else np.ones_like(time)


@pytest.mark.parametrize(("region", "kind", "course"), CASES)
def test_every_load_follows_its_course_and_goes_on_bitwise(
    built: "Simulation", region: str, kind: str, course: str
) -> None:
    """Its motion or force is that of the course at every sample; its work closes the balance."""
    where, area = REGIONS[region]
    value = VALUES[kind]
    load = where | COURSES[course] | {kind: value, "direction": "-z"}
    samples, saved = sampled_twice(built, bar(load))
    times = np.array([sample.time for sample in samples])
    whole = {"traction": area * SPACING**2, "force": 1.0}.get(kind)
    if whole is not None:
        # the mean over the steps from one sample to the next
        steps = EVERY * np.arange(len(times))[:, None] - np.arange(EVERY)
        wanted = whole * value * factor_of(course, steps * built.time_step).mean(axis=1)
        found = [sample.observed["load1_force_n"] for sample in samples]
    else:
        wanted = value * factor_of(course, times)
        if kind == "velocity":
            fine = np.linspace(0.0, times[-1], 40_001)
            factors = factor_of(course, fine)
            steps = 0.5 * (factors[1:] + factors[:-1]) * fine[1]
            wanted = value * np.interp(times, fine, np.concatenate([[0.0], np.cumsum(steps)]))
        found = [sample.observed["load1_displacement_m"] for sample in samples]
    late = slice(1, None)  # before the first sample there is nothing
    size = np.abs(wanted).max()
    assert size > 0
    np.testing.assert_allclose(found[late], wanted[late], rtol=0, atol=1e-6 * size)
    assert abs(samples[-1].ledger.external) > 0
    assert saved


@pytest.mark.parametrize("kind", ["velocity", "rotation", "expansion", "strain"])
def test_every_start_keeps_its_energy_and_goes_on_bitwise(built: "Simulation", kind: str) -> None:
    start: dict[str, Any] = {
        "velocity": [1.0, -2.0, 3.0],
        "rotation": [100.0, 30.0, -50.0],
        "expansion": 40.0,
        "strain": [1e-3, -2e-4, -2e-4],
    }
    samples, saved = sampled_twice(built, bar(start={kind: start[kind]}))
    ledger = samples[-1].ledger
    assert ledger.kinetic_plate + ledger.strain > 0
    assert saved


def sampled_twice(simulation: "Simulation", scene: Scene) -> "tuple[list[Sample], bool]":
    """The samples of a short run, which goes on from its middle to the same bits."""
    simulation.reset(scene)
    samples, saved = [], None
    for n in range(16):
        if n == 8:
            saved = simulation.saved_state()
        samples.append(simulation.sample_step())
        simulation.advance(EVERY - 1)
    assert max(sample.energy_error for sample in samples) < 1e-3
    end = simulation.displacement()
    assert saved is not None
    simulation.reset(scene)
    simulation.restore_state(saved)
    for sample in samples[8:]:
        assert vars(simulation.sample_step()) == vars(sample)
        simulation.advance(EVERY - 1)
    return samples, np.array_equal(simulation.displacement(), end)


@pytest.mark.slow  # its kernels are of their own
def test_a_block_that_is_pressed_on_a_rough_floor_does_not_slide(taichi: None) -> None:
    """Traction from above with a push from the side below the limit of friction."""
    from taichi_ldem.solver.simulation import Simulation

    pressure, section = 1e5, 24 * SPACING**2
    smooth = {"course": "ramp", "ramp": 1e-4}
    press = {"face": "+z", "traction": pressure, "direction": "-z"} | smooth
    push = {"face": "-x", "force": 0.3 * pressure * section, "direction": "x"} | smooth
    wanted = block_scene(6, 4, 2, load=[press, push], floor={"friction": 0.6})
    simulation, samples = Simulation(wanted), []
    for _ in range(40):
        samples.append(simulation.sample_step())
        simulation.guard(samples[-1])
        simulation.advance(99)
    assert max(sample.energy_error for sample in samples) < 1e-4
    held = [s.observed["floor_force_n"] for s in samples if s.time > 1.5e-4]
    assert np.mean(held) == pytest.approx(pressure * section, rel=1e-3)
    moved = [s.observed["load2_displacement_m"] for s in samples if s.time > 1.5e-4]
    assert np.ptp(moved) < 0.1 * np.mean(moved)
    assert np.mean(moved) < 1e-3 * SPACING


@pytest.mark.slow  # its kernels are of their own
def test_the_balance_closes_with_damping_and_uneven_nodes(taichi: None) -> None:
    from taichi_ldem.solver.simulation import Simulation

    loads = [
        ALL | {"force": 0.1, "direction": [1, 2, -2]},
        {"face": "-x", "velocity": 1.0, "direction": "-x", "course": "ramp", "ramp": 4e-6},
        {"face": "+x", "traction": 1e6, "direction": "x"} | TABLE,
    ]
    wanted = block_scene(
        8,
        4,
        2,
        load=loads,
        start={"velocity": [1, 0, 0]},
        plate={"perturbation": 0.1},
        disorder={"density_cv": 0.2, "seed": 2},
        solver={"duration": 3e-5, "damping": 2e3},
        output={"history_interval": 1e-6},
    )
    samples = [*Simulation(wanted).samples()]
    assert max(sample.energy_error for sample in samples) < 1e-5
    assert samples[-1].ledger.damping > 0.05 * samples[-1].ledger.external


@pytest.mark.slow  # its kernels are of their own
def test_a_strained_strip_with_held_ends_stays_strained(taichi: None) -> None:
    """With the strain across that fits Poisson's ratio; the ends carry E A times the strain."""
    from taichi_ldem.solver.simulation import Simulation

    strain, nu = 1e-3, PMMA["poisson_ratio"]
    wanted = block_scene(
        16,
        8,
        4,
        load=[{"face": f"{sign}x", "velocity": 0.0, "direction": f"{sign}x"} for sign in "+-"],
        start={"strain": [strain, -nu * strain, -nu * strain]},
        solver={"duration": 2e-5},
        output={"history_interval": 1e-6},
    )
    samples = [*Simulation(wanted).samples()]
    assert max(sample.energy_error for sample in samples) < 1e-5
    kinetic = max(sample.ledger.kinetic_plate for sample in samples)
    assert kinetic < 0.015 * samples[0].ledger.strain
    held = np.mean([sample.observed["load1_force_n"] for sample in samples[2:]])
    assert held == pytest.approx(PMMA["youngs_modulus"] * strain * 32 * SPACING**2, rel=0.07)
