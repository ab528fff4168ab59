from collections.abc import Callable
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene
from support.reference import Body

from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene
    from taichi_ldem.solver.simulation import Simulation

STIFFNESS = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], SPACING)
MODULE_MASS = PMMA["density"] * SPACING**3


# -- a striker on a free plate ---------------------------------------------------------------------


class Hit:
    """A striker that hits a free plate of 29 mg off its centre, watched at every step.

    Attributes (n steps):
        distance: (n, nodes) of all nodes to the striker's surface at the end of each step, m.
        impulses: (n, nodes, 3) of the contact, from the nodes' motion and the bars' forces, N s.
        normals: (n, nodes, 3) of the striker's surface towards the nodes.
        slips: (n, nodes, 3) velocities of the nodes relative to the striker, m/s.
        momentum: (n,) plate and striker along the striker's way, kg m/s.
        velocity: (n,) of the striker, m/s.
        errors: (n,) imbalance of the ledger over the initial energy.
    """

    place, gap, steps = (0.3e-3, -0.2e-3), 1e-6, 300

    def __init__(
        self, mass: float, speed: float, radius: float, depth: float = 0.0, friction: float = 0.0
    ) -> None:
        from taichi_ldem.solver.simulation import Simulation

        self.mass, self.speed, self.radius = mass, speed, radius
        striker = {
            "diameter": 2 * radius,
            "mass": self.mass,
            "velocity": self.speed,
            "position": self.place,
            "gap": self.gap,
            "friction": friction,
        }
        self.simulation = s = Simulation(block_scene(8, 8, 3, striker=striker))
        self.body = body = Body(s.dynamics.lattice.mask, SPACING)
        if depth:
            s.body("striker").start(s.scene, s.time_step, self.gap + depth)
        masses = MODULE_MASS * body.mass_shares[:, None]
        rows = []
        displaced = np.zeros((len(body.places), 3))
        velocity = np.zeros_like(displaced)
        for _ in range(self.steps):
            sample = s.sample_step()
            free = velocity + s.time_step * body.forces(displaced, STIFFNESS) / masses
            velocity = s.dynamics.get_velocity()[body.index]
            displaced = s.displacement()[body.index]
            travelled, _, speed = s.body("striker").motion()
            away = self._from_axis(body.positions + displaced, travelled)
            length = np.linalg.norm(away, axis=1)
            rows.append(
                (
                    length - radius,
                    masses * (velocity - free),
                    away / length[:, None],
                    velocity + np.array([0.0, 0.0, speed]),
                    self.mass * speed - (masses * velocity).sum(axis=0)[2],
                    speed,
                    sample.energy_error,
                    sample.ledger.contact,
                )
            )
        columns = [np.array(column) for column in zip(*rows, strict=True)]
        self.distance, self.impulses, self.normals, self.slips = columns[:4]
        self.momentum, self.velocity, self.errors, self.lost = columns[4:]

    def _from_axis(self, place: np.ndarray, travelled: float) -> np.ndarray:
        """Hemisphere under a shaft: vectors from the nearest point of the shaft's axis."""
        height = 3 * SPACING + self.gap + self.radius - travelled
        away = place - np.array([*self.place, height])
        away[:, 2] = np.minimum(away[:, 2], 0.0)
        return away


LIGHT = (1e-6, 20.0, 3e-3)
HEAVY = (200e-6, 40.0, 20e-3)


@pytest.fixture(scope="module", params=[LIGHT, HEAVY], ids=["1 mg", "200 mg"])
def hit(taichi: None, request: pytest.FixtureRequest) -> Hit:
    return Hit(*request.param)


def test_the_striker_is_slowed_or_thrown_back(hit: Hit) -> None:
    assert hit.velocity[0] == pytest.approx(hit.speed, rel=1e-3)
    assert np.abs(hit.velocity).max() <= hit.speed
    assert np.diff(hit.velocity).max() <= 1e-9 * hit.speed  # nothing pulls at it
    touching = np.linalg.norm(hit.impulses, axis=2) > 1e-9 * hit.mass * hit.speed
    if hit.mass == LIGHT[0]:
        assert -0.9 * hit.speed < hit.velocity[-1] < -0.1 * hit.speed
        assert not touching[-20:].any()
        assert hit.distance[-1].min() > 0.1 * SPACING
    else:
        assert 0 < hit.velocity[-1] < 0.99 * hit.speed


def test_momentum_passes_from_the_striker_to_the_plate(hit: Hit) -> None:
    np.testing.assert_allclose(hit.momentum, hit.mass * hit.speed, rtol=1e-12)


def test_no_node_is_inside_the_striker(hit: Hit) -> None:
    assert hit.distance.min() > -1e-9 * SPACING


def test_the_striker_pushes_along_its_normal_and_only_on_what_it_touches(hit: Hit) -> None:
    size = np.linalg.norm(hit.impulses, axis=2)
    touched = size > 1e-9 * hit.mass * hit.speed
    assert np.count_nonzero(touched.any(axis=0)) >= (3 if hit.mass == LIGHT[0] else 20)
    assert np.abs(hit.distance[touched]).max() < 1e-6 * SPACING
    along = (hit.impulses * hit.normals).sum(axis=2)
    assert (along[touched] > 0).all()
    across = np.linalg.norm(hit.impulses - along[..., None] * hit.normals, axis=2)
    assert (across[touched] < 1e-4 * size[touched]).all()


def test_the_energy_of_the_hit_is_accounted_for(hit: Hit) -> None:
    assert hit.errors.max() < 5e-4
    assert 0 < hit.lost[-1] < 0.5 * hit.mass * hit.speed**2


def test_a_node_that_is_inside_gets_nothing_but_what_stops_it_there(taichi: None) -> None:
    depth = 0.4 * SPACING  # put back on the surface in a step, it would get 2 km/s
    hit = Hit(*LIGHT, depth)
    energy = 0.5 * hit.mass * hit.speed**2
    assert -depth < hit.distance[0].min() < -0.8 * depth
    assert hit.distance.min() == pytest.approx(hit.distance[0].min(), rel=1e-6)
    assert np.abs(hit.velocity).max() <= hit.speed * (1 + 1e-12)
    assert hit.lost.min() > 0
    assert hit.lost.max() < energy
    assert hit.errors.max() < 5e-4
    np.testing.assert_allclose(hit.momentum, hit.mass * hit.speed, rtol=1e-12)


def test_friction_of_the_striker_is_coulombs(taichi: None) -> None:
    friction = 0.1
    hit = Hit(*LIGHT, friction=friction)
    size = np.linalg.norm(hit.impulses, axis=2)
    touched = size > 1e-6 * hit.mass * hit.speed

    def split(vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Components along the normals, and the vectors across, of the nodes that touch."""
        along = (vectors * hit.normals).sum(axis=2)
        return along[touched], (vectors - along[..., None] * hit.normals)[touched]

    pushed, rubbed = split(hit.impulses)
    _, slip = split(hit.slips)
    share = np.linalg.norm(rubbed, axis=1) / pushed
    assert (pushed > 0).all()
    assert share.max() < friction * (1 + 1e-3)  # a step along the tangent turns the normal a bit
    slides = share > friction * (1 - 1e-3)
    assert slides.any()
    assert (~slides).any()
    assert ((rubbed * slip).sum(axis=1)[slides] < 0).all()
    assert np.linalg.norm(slip[~slides], axis=1).max() < 1e-3 * hit.speed
    assert hit.distance.min() > -1e-5 * SPACING  # its equation is linearised about free flight
    np.testing.assert_allclose(hit.momentum, hit.mass * hit.speed, rtol=1e-12)
    assert hit.errors.max() < 5e-4
    assert 0 < hit.lost[-1] < 0.5 * hit.mass * hit.speed**2


# -- a striker that comes to rest on a plate between rings -----------------------------------------

WEIGHT = {"mass": 3e-6, "gravity": 4e5}  # 1.2 N


@pytest.fixture(scope="module")
def pressed(taichi: None) -> "Simulation":
    """A damped plate between rings, under the weight of a striker, at rest after 0.5 ms."""
    from taichi_ldem.solver.simulation import Simulation

    scene = block_scene(
        16,
        16,
        3,
        striker={"diameter": 2e-3, "velocity": 0.0} | WEIGHT,
        clamp={"kind": "rings", "inner_diameter": 5.2e-3, "outer_diameter": 7.6e-3},
        solver={"damping": 1e5},
    )
    return Simulation(scene)


def test_rings_carry_the_weight_in_equilibrium(pressed: "Simulation") -> None:
    weight = WEIGHT["mass"] * WEIGHT["gravity"]
    errors = [pressed.sample_step().energy_error]
    for _ in range(30):
        pressed.advance(149)
        sample = pressed.sample_step()
        errors.append(sample.energy_error)
    assert sample.observed["striker_force_n"] == pytest.approx(weight, rel=1e-6)
    assert sample.observed["ring_force_n"] == pytest.approx(weight, rel=1e-6)
    assert max(errors) < 1e-5  # with damping and contact both at work


def test_a_pressed_node_does_not_slip_and_a_lifted_one_is_free(pressed: "Simulation") -> None:
    before = pressed.displacement()
    pressed.advance(50)
    after = pressed.displacement()
    position = pressed.dynamics.lattice.positions()
    radius = np.hypot(position[..., 0], position[..., 1])
    under = pressed.dynamics.lattice.exists() & (radius > 2.7e-3) & (radius < 3.7e-3)
    height = position[..., 2] + after[..., 2]
    low = under & (position[..., 2] < 1e-9)
    high = under & (position[..., 2] > 3 * SPACING - 1e-9)
    for face, gap in ((low, height), (high, 3 * SPACING - height)):
        held = face & (np.abs(gap) < 1e-15)
        lifted = face & (gap > 1e-12)
        assert gap[face].min() > -1e-15
        np.testing.assert_array_equal(after[held], before[held])
        assert held.any()
        assert lifted.any()


def test_impulses_of_contact_and_damping_change_the_momentum(pressed: "Simulation") -> None:
    """Along z, step by step, while the plate still moves; damping acts on the mean velocity."""
    from taichi_ldem.solver.contact.kernels.body import IMPULSE

    s = pressed
    s.reset(s.scene)
    body = Body(s.dynamics.lattice.mask, SPACING)
    mass = MODULE_MASS * body.mass_shares

    def state() -> tuple[np.ndarray, float]:
        given = sum(float(b.collected()[IMPULSE]) for b in s.bodies)
        return mass * s.dynamics.get_velocity()[body.index][:, 2], given

    s.advance(200)
    before, given = state()
    for _ in range(20):
        s.advance(1)
        after, total = state()
        damped = -s.damping * s.time_step * 0.5 * (before + after).sum()
        impulse = total - given
        assert abs(impulse) > 0
        change = (after - before).sum()
        assert change == pytest.approx(impulse + damped, abs=1e-11 * np.abs(after).sum())
        before, given = after, total


def test_a_checkpoint_from_before_there_was_a_floor_is_taken(pressed: "Simulation") -> None:
    pressed.sample_step()
    saved = pressed.saved_state()
    whole = pressed.sampler.impulses
    assert list(whole)[4] == "floor"
    pressed.restore_state(saved | {"ledger/impulses": saved["ledger/impulses"][:4]})
    assert pressed.sampler.impulses == whole
    assert whole["striker"] != 0


@pytest.mark.slow  # one kernel of four unrolled steps takes a minute to compile
def test_several_steps_a_launch_are_the_same_steps(taichi: None) -> None:
    """As a GPU takes them: whole passes, four steps a kernel, over a new listing of nodes."""
    from taichi_ldem.solver.simulation import STEPS_A_LAUNCH, STEPS_BETWEEN_LISTS, Simulation

    scene = block_scene(
        10,
        10,
        2,
        plate={"gravity": [1e3, 0.0, -1e4]},
        striker={"diameter": 2e-3, "mass": 1e-4, "velocity": 5.0, "friction": 0.2},
        clamp={"kind": "rings", "inner_diameter": 3.2e-3, "outer_diameter": 4.8e-3},
        floor={"gap": 1e-6, "friction": 0.4},
    )
    ends = []
    for in_strips in (True, False):
        simulation = Simulation(scene, in_strips)
        simulation.advance(STEPS_BETWEEN_LISTS + STEPS_A_LAUNCH + 1)
        sample = simulation.sample_step()
        ends.append((simulation.displacement(), simulation.body("striker").motion(), sample))
    np.testing.assert_array_equal(ends[0][0], ends[1][0])
    assert ends[0][1] == ends[1][1]
    assert ends[0][2].observed["striker_force_n"] == ends[1][2].observed["striker_force_n"] > 1
    for column in ("ring_force_n", "floor_force_n"):
        assert ends[0][2].observed[column] == ends[1][2].observed[column] != 0
    for one, two in zip(*(vars(end[2].ledger).values() for end in ends), strict=True):
        assert one == pytest.approx(two, rel=1e-13)  # summed in another order


# -- striker, rings and floor at once --------------------------------------------------------------

RUBBED = 0.2


def _between(**material: float) -> "Scene":
    """A plate between rings and above a floor, struck; all three bodies rub."""
    return block_scene(
        8,
        8,
        2,
        material=material,
        striker={"diameter": 1.6e-3, "mass": 2e-6, "velocity": 20.0, "friction": 0.3},
        clamp={
            "kind": "rings",
            "inner_diameter": 2.1e-3,
            "outer_diameter": 3.8e-3,
            "friction": RUBBED,
        },
        floor={"gap": 1e-4, "friction": 0.5},
        solver={"time_step": 1e-7},
    )


@pytest.fixture(scope="module")
def between(taichi: None) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    return Simulation(_between())


def _rubs_by_no_more_than(
    simulation: "Simulation", friction: float, under: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Shares of friction in what a body pushes nodes along z; Coulomb's law and the ledger hold.

    Args:
        under: whether each of (nodes, 3) places is such a node's.
    """
    s = simulation
    body = Body(s.dynamics.lattice.mask, SPACING)
    masses = MODULE_MASS * body.mass_shares[:, None]
    chosen = under(body.positions)
    displaced, velocity = np.zeros((2, *body.positions.shape))
    rows, errors = [], []
    for _ in range(200):
        errors.append(s.sample_step().energy_error)
        free = velocity + s.time_step * body.forces(displaced, STIFFNESS) / masses
        velocity = s.dynamics.get_velocity()[body.index]
        displaced = s.displacement()[body.index]
        rows.append((masses * (velocity - free))[chosen])
    pushed, rubbed = np.abs(np.array(rows)[..., 2]), np.hypot(*np.array(rows)[..., :2].T).T
    held = pushed > 1e-6 * pushed.max()
    share = rubbed[held] / pushed[held]
    assert share.max() < friction * (1 + 1e-3)
    assert np.count_nonzero(share > friction * (1 - 1e-3)) > 10  # these slip
    assert max(errors) < 5e-4
    return np.asarray(share)


@pytest.mark.slow
def test_rings_with_friction_hold_by_no_more_than_it(between: "Simulation") -> None:
    between.reset(_between())

    def under_rings(places: np.ndarray) -> np.ndarray:
        radius = np.hypot(*places[:, :2].T)
        return (radius > 1.3e-3) & (radius < 1.8e-3)

    share = _rubs_by_no_more_than(between, RUBBED, under_rings)
    assert np.count_nonzero(share < 0.9 * RUBBED) > 10  # not all of them slip
    assert between.contact_loss("rings") > 0


@pytest.mark.slow  # its kernels are of their own
def test_supports_with_friction_hold_by_no_more_than_it(taichi: None) -> None:
    from taichi_ldem.solver.simulation import Simulation

    scene = block_scene(
        12,
        3,
        2,
        striker={"shape": "cylinder", "diameter": 2e-3, "mass": 2e-6, "velocity": 20.0},
        supports={"span": 4e-3, "diameter": 2e-3, "friction": RUBBED},
        solver={"time_step": 1e-7},
    )
    simulation = Simulation(scene)

    def above_an_axis(places: np.ndarray) -> np.ndarray:
        return (places[:, 2] < 1e-9) & (np.abs(np.abs(places[:, 0]) - 2e-3) < 1e-9)

    _rubs_by_no_more_than(simulation, RUBBED, above_an_axis)
    assert simulation.contact_loss("supports") > 0


@pytest.mark.slow
def test_nodes_between_striker_and_floor_are_counted_once(between: "Simulation") -> None:
    """Of a material that carries nothing: the striker carries nodes until they are on the floor."""
    s = between
    s.reset(_between(youngs_modulus=1e2))
    errors = [s.sample_step().energy_error for _ in range(900)]
    masses = s.dynamics.masses()
    height = s.dynamics.lattice.positions()[..., 2] + s.displacement()[..., 2]
    travelled = s.body("striker").motion()[0]
    assert travelled > 2 * SPACING + 1e-4  # it is below the floor, and nodes are not
    assert height[masses > 0].min() == pytest.approx(-1e-4, rel=1e-9)
    assert s.contact_loss("floor") > 0
    assert max(errors) < 1e-6


# -- bonded faces ----------------------------------------------------------------------------------


@pytest.mark.parametrize("modules", [3, 4, 6])
def test_bonded_rings_hold_both_faces_in_either_precision(modules: int) -> None:
    from taichi_ldem.solver.contact.kernels.rings import fixed_nodes

    lattice = Lattice(prism(10, 10, modules), 3.2e-3 / modules)
    rounded = float(np.float32(lattice.spacing))  # what f32 computes with
    numbers = (2 * lattice.spacing, 4 * lattice.spacing, modules * rounded)
    dynamics = SimpleNamespace(lattice=lattice, spacing=rounded)
    fixed = fixed_nodes(dynamics, numbers, through=False)  # type: ignore[arg-type]
    z = lattice.positions()[..., 2].ravel()[fixed]
    below, above = np.count_nonzero(z == 0.0), np.count_nonzero(z > 3.1e-3)
    # corners with 4 <= i^2 + j^2 <= 16: 49 - 9 points of the plane's integers within 4, 1 of 2
    assert below == above == 40
    assert below + above == len(fixed)


@pytest.mark.parametrize(("edge", "late"), [("node", 0.5), ("unbiased", 0.0)])
def test_an_unbiased_clamp_begins_on_its_circle_on_average(edge: str, late: float) -> None:
    """The first node that is held on each row of nodes that crosses the circle steeply."""
    from taichi_ldem.solver.contact.kernels.rings import fixed_nodes, reach

    lattice, inner = Lattice(prism(120, 120, 1), 1.0), 50.3
    table = {"kind": "rim", "inner_diameter": 2 * inner, "edge": edge}
    clamp = block_scene(8, 8, 2, clamp=table | {"inner_diameter": 1e-3}).clamp
    assert clamp is not None
    beyond = reach(clamp, lattice.spacing)
    numbers = (inner - beyond, np.inf, 1.0)
    dynamics = SimpleNamespace(lattice=lattice, spacing=1.0)
    fixed = fixed_nodes(dynamics, numbers, through=True)  # type: ignore[arg-type]
    x, y, z = lattice.positions().reshape(-1, 3)[fixed].T
    gaps = []
    for row in np.unique(y[np.abs(y) < 20]):
        first = x[(y == row) & (x > 0) & (z == 0)].min(initial=np.inf)
        gaps += [first - np.sqrt(inner**2 - row**2)] if first < np.inf else []
    assert len(gaps) > 30
    assert np.mean(gaps) == pytest.approx(late, abs=0.06)


def test_bonded_nodes_stay_and_take_what_the_striker_gives(taichi: None) -> None:
    from taichi_ldem.solver.simulation import Simulation

    mass, speed, gravity = 20e-6, 5.0, 1e5
    scene = block_scene(
        12,
        12,
        2,
        striker={"diameter": 2e-3, "mass": mass, "velocity": speed, "gravity": gravity},
        clamp={"kind": "bonded", "inner_diameter": 4e-3, "outer_diameter": 5.6e-3},
    )
    simulation = Simulation(scene)
    body = Body(simulation.dynamics.lattice.mask, SPACING)
    radius = np.hypot(*body.positions[:, :2].T)
    face = np.isin(body.places[:, 2], (0, 4))
    held = face & (radius >= 2e-3) & (radius <= 2.8e-3)
    samples = [simulation.sample_step()]
    for _ in range(20):
        simulation.advance(19)
        samples.append(simulation.sample_step())
    displaced = simulation.displacement()[body.index]
    assert not displaced[held].any()
    assert (np.abs(displaced[~held]).max(axis=1) > 0).all()
    # momentum towards the plate: what striker and gravity brought, less what the bond took; a
    # sample's force is the impulse since the last one, up to half a step after its time
    end = samples[-1].time + 0.5 * simulation.time_step
    spans = np.diff([s.time for s in samples], prepend=-simulation.time_step)
    taken = sum(s.observed["ring_force_n"] * span for s, span in zip(samples, spans, strict=True))
    velocity = simulation.dynamics.get_velocity()[body.index]
    plate = -(MODULE_MASS * body.mass_shares * velocity[:, 2]).sum()
    striker = mass * simulation.body("striker").motion()[2]
    assert plate + striker == pytest.approx(mass * (speed + gravity * end) - taken, rel=1e-10)
    assert taken > 0.1 * mass * speed
    assert max(s.energy_error for s in samples) < 1e-4
