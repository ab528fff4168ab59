"""Pieces that touch: two halves of a block that are thrown at each other."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import eigsh
from scipy.spatial import cKDTree
from support.blocks import PMMA, SPACING
from support.pieces import FRICTION, SHIFT, Pieces, scene_of_pieces
from support.reference import Body

from taichi_ldem.errors import TooManyNodes
from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import prism

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.fragments import Fragments

DISTANCE = np.sqrt(0.75) * SPACING
STEPS = 360
"""Steps in which the pieces meet, and part again."""


CRITICAL = 1.6527e-7
"""The critical time step of the block, s: its estimate would compile kernels of its own."""


@pytest.fixture(scope="module")
def pieces(taichi: None) -> Iterator[Pieces]:
    from taichi_ldem.solver import stability
    from taichi_ldem.solver.simulation import Simulation

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stability, "critical_time_step", lambda dynamics: CRITICAL)
        yield Pieces(Simulation(scene_of_pieces()))


@pytest.fixture(scope="module")
def hit(pieces: Pieces) -> SimpleNamespace:
    """An oblique hit with friction, watched at every step."""
    pieces.throw()
    start, rows, samples = pieces.momentum(), [], []
    for _ in range(STEPS):
        place, before = pieces.positions, pieces.velocity
        samples += pieces.fly(1)
        rows.append((place, before, *pieces.impulses(), pieces.momentum()))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    names = ("places", "velocities", "impulses", "friction", "momentum")
    return SimpleNamespace(start=start, samples=samples, **dict(zip(names, columns, strict=True)))


def _expected(pieces: Pieces, place: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, ...]:
    """(n, 3) normal impulses and those of friction, bar none, from the page's formulas."""
    from taichi_ldem.solver.contact.kernels.spheres import STICK, STIFFER

    s = pieces.simulation
    normal, friction = np.zeros_like(place), np.zeros_like(place)
    left, right = np.flatnonzero(~pieces.right), np.flatnonzero(pieces.right)
    near = cKDTree(place[left]).query_ball_tree(cKDTree(place[right]), DISTANCE)
    stiffness = mat.axial_stiffness(PMMA["youngs_modulus"], 0.25, SPACING)[0] / SPACING
    inside = 0.5 * PMMA["density"] * SPACING**3
    for a, found in zip(left, near, strict=True):
        for b in right[found]:
            away = place[a] - place[b]
            distance = np.linalg.norm(away)
            reduced = 1 / (1 / pieces.masses[a] + 1 / pieces.masses[b])
            push = STIFFER * stiffness * 2 * reduced / inside * (DISTANCE - distance) * s.time_step
            sliding = velocity[a] - velocity[b]
            sliding = sliding - away * (sliding @ away) / distance**2
            speed = max(np.linalg.norm(sliding), 1e-30)
            drag = min(FRICTION * push / speed, STICK * reduced) * sliding
            for node, sign in ((a, 1), (b, -1)):
                normal[node] += sign * push * away / distance
                friction[node] -= sign * drag
    return normal, friction


def test_pieces_meet_and_part(pieces: Pieces, hit: SimpleNamespace) -> None:
    touching = np.abs(hit.impulses).max(axis=(1, 2)) > 0
    assert not touching[0]
    assert touching.sum() > 50
    assert not touching[-30:].any()
    mass = pieces.masses[pieces.right]
    first, last = (v[pieces.right].T @ mass / mass.sum() for v in hit.velocities[[0, -1]])
    # equal pieces that exchanged their velocities would leave the right one at rest
    assert first[0] == pytest.approx(-10.0)
    assert -4.5 < last[0] < 0


def test_the_impulses_are_those_of_soft_spheres_with_friction(
    pieces: Pieces, hit: SimpleNamespace
) -> None:
    touching = np.flatnonzero(np.abs(hit.impulses).max(axis=(1, 2)) > 0)
    slides = 0
    for step in touching[::9]:
        normal, friction = _expected(pieces, hit.places[step], hit.velocities[step])
        scale = np.abs(normal).max()
        np.testing.assert_allclose(hit.friction[step], friction, atol=1e-9 * scale)
        np.testing.assert_allclose(hit.impulses[step], normal + friction, atol=1e-9 * scale)
        size = [np.linalg.norm(part, axis=1) for part in (normal, friction)]
        slides += np.count_nonzero(size[1] > 0.9 * FRICTION * size[0][size[0] > 0].min())
    assert slides > 10


def test_momentum_is_kept_and_action_is_reaction(hit: SimpleNamespace) -> None:
    size = np.abs(hit.start).max()
    np.testing.assert_allclose(hit.momentum, np.tile(hit.start, (STEPS, 1)), atol=1e-12 * size)
    whole = np.abs(hit.impulses).sum(axis=(1, 2))
    assert (np.abs(hit.impulses.sum(axis=1)).max(axis=1) <= 1e-13 * whole).all()


def test_the_energy_of_the_hit_is_accounted_for(pieces: Pieces, hit: SimpleNamespace) -> None:
    start, end = hit.samples[0].ledger, hit.samples[-1].ledger
    assert max(sample.energy_error for sample in hit.samples) < 1e-3
    lost = np.array([sample.ledger.contact for sample in hit.samples])
    assert (np.diff(lost) >= -1e-9 * start.stored).all()  # friction never gives
    assert lost[-1] > 0.05 * start.stored
    assert end.touching == 0
    assert max(sample.ledger.touching for sample in hit.samples) > 0.05 * start.stored
    # restitution: what the mean motion has lost was rubbed away, or shakes the pieces
    halves = [pieces.masses * side for side in (pieces.right, ~pieces.right)]
    motion = [
        sum(0.5 * np.sum((m @ v) ** 2) / m.sum() for m in halves) for v in hit.velocities[[0, -1]]
    ]
    inside = end.kinetic_plate + end.strain - motion[1]
    assert motion[0] - motion[1] == pytest.approx(lost[-1] + inside, rel=2e-3)
    assert inside > 0
    for sample in hit.samples[::50]:
        assert sample.observed["pieces_friction_j"] == sample.ledger.contact
        assert sample.observed["pieces_elastic_j"] == sample.ledger.touching


def test_turned_pieces_move_the_same_way(pieces: Pieces) -> None:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([1.0, -0.7, 2.1]).as_matrix()
    ends = []
    for turned in (np.eye(3), turn):
        pieces.throw(turned=turned)
        start = pieces.angular_momentum()
        pieces.simulation.advance(150)
        ends.append((pieces.positions @ turned, pieces.simulation.fragments.size, start))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-9 * SPACING)
    assert ends[0][1] > 0


def test_without_friction_angular_momentum_is_kept(
    pieces: Pieces, monkeypatch: pytest.MonkeyPatch
) -> None:
    smooth = pieces.simulation.scene.changed("contact.friction=0")
    monkeypatch.setattr(pieces.simulation, "scene", smooth)
    pieces.throw()
    start = pieces.angular_momentum()
    samples = pieces.fly(STEPS)
    assert max(sample.ledger.touching for sample in samples) > 0
    assert samples[-1].ledger.contact == 0
    size = np.abs(pieces.masses @ np.abs(np.cross(pieces.positions, pieces.velocity))).max()
    np.testing.assert_allclose(pieces.angular_momentum(), start, atol=1e-11 * size)


def test_a_resumed_hit_goes_on_bitwise(pieces: Pieces) -> None:
    s = pieces.simulation
    pieces.throw()
    pieces.simulation.advance(90)  # in contact, between two listings
    saved = s.saved_state()
    ends = []
    for resumed in (False, True):
        if resumed:
            s.reset(s.scene)
            s.restore_state(saved)
        rows = [(*vars(a.ledger).values(), *a.observed.values()) for a in pieces.fly(40)]
        ends.append((rows, pieces.positions, pieces.velocity))
    assert ends[0][0] == ends[1][0]
    assert max(row[5] for row in ends[0][0]) > 0
    np.testing.assert_array_equal(ends[0][1], ends[1][1])
    np.testing.assert_array_equal(ends[0][2], ends[1][2])


def test_a_state_of_another_lattice_is_refused(pieces: Pieces) -> None:
    s = pieces.simulation
    pieces.throw()
    s.advance(1)
    saved = s.saved_state()
    for name, wrong in (("nodes", -1), ("pairs", 10**6), ("ends", 10**6)):
        broken = saved | {f"fragments/{name}": saved[f"fragments/{name}"].copy()}
        broken[f"fragments/{name}"][0] = wrong
        with pytest.raises(ValueError, match="pairs of nodes that may touch"):
            s.restore_state(broken)


@pytest.mark.slow  # kernels of four unrolled steps take a minute to compile
def test_whole_passes_as_on_a_gpu_are_the_same_steps(pieces: Pieces) -> None:
    from taichi_ldem.solver.simulation import Simulation

    passes = Pieces(Simulation(pieces.simulation.scene, in_strips=False))
    ends = []
    for each in (pieces, passes):
        each.throw()
        each.simulation.advance(100)
        ends.append((each.positions, each.fly(1)[0].ledger))
    np.testing.assert_array_equal(ends[0][0], ends[1][0])
    assert ends[0][1].touching > 0
    for one, two in zip(*(vars(ledger).values() for _, ledger in ends), strict=True):
        assert one == pytest.approx(two, rel=1e-13)  # summed in another order


# -- which pairs are looked at --------------------------------------------------------------------


def _pairs_expected(pieces: Pieces, removed: np.ndarray, place: np.ndarray) -> set[tuple[int, int]]:
    """Pairs of node numbers within the reach of the list, by what ``pairs`` says of them.

    Args:
        removed: a bit for each removed bar. place: of all nodes, in the shape of the sites, m.
    """
    dynamics = pieces.simulation.dynamics
    lattice, cell = dynamics.lattice, dynamics.cell
    there = lattice.bar_exists()
    kept = there & ((removed[..., None] >> np.arange(cell.bars) & 1) == 0)
    bare, rim = np.zeros((2, cell.sublattices, *lattice.sites), dtype=bool)
    number = np.arange(bare.size).reshape(bare.shape)
    joined = set()
    for s in range(cell.sublattices):
        for (bar, home), (other, away) in zip(cell.scalars[s], cell.neighbours[s], strict=True):
            back = [-n for n in home]
            has, keeps = (np.roll(b[..., bar], back, axis=(0, 1, 2)) for b in (there, kept))
            bare[s] |= has & ~keeps
            rim[s] |= ~has
            far = np.roll(number[other], [-n for n in away], axis=(0, 1, 2))
            joined |= set(zip(number[s][keeps].tolist(), far[keeps].tolist(), strict=True))
    nodes = np.flatnonzero(lattice.exists() & (bare | rim))
    reach = float(pieces.simulation.fragments.numbers[1])
    found = cKDTree(place.reshape(-1, 3)[nodes]).query_pairs(reach, output_type="ndarray")
    both = {(int(a), int(b)) for a, b in nodes[np.vstack([found, found[:, ::-1]])]}
    return {(a, b) for a, b in both - joined if bare.flat[a] or bare.flat[b]}


def _listed(pieces: Pieces) -> list[tuple[int, int]]:
    """The pairs of the list, in its order."""
    f = pieces.simulation.fragments
    nodes, ends = f.nodes.to_numpy()[: f.size], f.pair_ends.to_numpy()[: f.size]
    owner = np.repeat(np.arange(f.size), np.diff(ends, prepend=0))
    pairs = f.pairs.to_numpy()[: ends[-1]]
    return list(zip(nodes[owner].tolist(), nodes[pairs].tolist(), strict=True))


@pytest.mark.parametrize("share", [0.0, 0.05, 0.6])
def test_the_list_has_every_pair_once_in_order(pieces: Pieces, share: float) -> None:
    """A cut block, a cracked one, and rubble, with nodes that lie up to half a module off."""
    s = pieces.simulation
    s.reset(s.scene)
    rng = np.random.default_rng(2)
    dynamics = s.dynamics
    cut = dynamics.lanes.gather(dynamics.removed.to_numpy())
    lost = rng.random((*cut.shape, dynamics.cell.bars)) < share
    bits = (lost & dynamics.lattice.bar_exists()) << np.arange(dynamics.cell.bars)
    removed = (cut | bits.sum(axis=-1)).astype(np.uint16)
    dynamics.set_removed(removed)
    away = pieces.spread(rng.uniform(-0.5, 0.5, pieces.places.shape) * s.spacing)
    away[..., 0] += 0.3  # far from where the plate was: the grid has no ends
    away *= pieces.exists[..., None]
    dynamics.set_displacement(s.now, away)
    s.fragments.list_anew(s.now, 0, s.time_step)
    listed = _listed(pieces)
    place = dynamics.lattice.positions() + away
    assert set(listed) == _pairs_expected(pieces, removed, place)
    assert listed == sorted(set(listed))
    assert len(listed) > 100
    assert {(b, a) for a, b in listed} == set(listed)


def test_when_the_lists_are_made_changes_no_bit(pieces: Pieces) -> None:
    ends = []
    for always in (False, True):
        pieces.throw()
        pieces.fly(120, list_always=always)
        ends.append(pieces.positions)
    np.testing.assert_array_equal(*ends)
    assert pieces.simulation.fragments.reading().lost > 0


def _rest(pieces: Pieces, shift: tuple[float, float, float] = SHIFT) -> None:
    """Let the pieces rest until a list has just been made that may last as long as any."""
    from taichi_ldem.solver.contact.kernels.pairs import LONGEST

    pieces.throw((0.0, 0.0, 0.0), shift)
    f = pieces.simulation.fragments
    while f.patience < LONGEST:
        pieces.simulation.advance(1)
    assert f.next_listing == pieces.simulation.step_number - 1 + LONGEST


def test_a_list_is_soon_made_again_after_bars_have_failed(pieces: Pieces) -> None:
    """Their ends know nothing of each other until then."""
    from taichi_ldem.solver.contact.kernels.pairs import LONGEST, SOON

    s, dynamics = pieces.simulation, pieces.simulation.dynamics
    pieces.throw((0.0, 0.0, 0.0), (5e-3, 0.0, 0.0))  # nothing moves
    made = []
    for step in range(400):
        if step == 200:
            removed = dynamics.lanes.gather(dynamics.removed.to_numpy())
            whole = np.argwhere(dynamics.lattice.bar_exists()[..., 0] & (removed == 0))
            removed[tuple(whole[0])] |= np.uint16(1)
            dynamics.set_removed(removed)
        due = s.fragments.next_listing
        s.advance(1)
        if s.fragments.next_listing != due:
            made.append(step)
    # the list after the bar is gone is the first that knows of it
    expected = [SOON, 2 * SOON, LONGEST, LONGEST, LONGEST, SOON, 2 * SOON, LONGEST]
    assert np.diff(made).tolist() == expected


def test_a_list_lasts_until_a_node_has_moved(pieces: Pieces) -> None:
    from taichi_ldem.solver.contact.kernels.pairs import LATE, LONGEST, SKIN

    s, speed = pieces.simulation, 25.0
    _rest(pieces)
    velocity = np.where(pieces.right[:, None], (speed, 0.0, 0.0), 0.0)
    s.dynamics.set_velocity(pieces.spread(velocity))
    way = LATE * SKIN * float(s.fragments.numbers[0])
    steps = int(way / (speed * s.time_step))
    lasts = 1
    while s.fragments.next_listing > s.step_number and lasts < LONGEST:
        s.advance(1)
        lasts += 1
    assert 0 <= lasts - 1 - steps <= 9  # a node that touches nothing is looked at every few steps


def _bullet(pieces: Pieces) -> tuple[np.ndarray, int]:
    """Remove all bars of a corner node of the right piece, and shoot it at the left one."""
    dynamics = pieces.simulation.dynamics
    pieces.throw((0.0, 0.0, 0.0), (1.5e-3, 0.0, 0.0))
    node = int(np.argmin(np.linalg.norm(pieces.places - [1e-3, 0.5e-3, 1.5e-3], axis=1)))
    k, j, i = np.argwhere(pieces.exists)[node][1:]
    assert np.argwhere(pieces.exists)[node][0] == 0
    removed = dynamics.lanes.gather(dynamics.removed.to_numpy())
    for bar, (dz, dy, dx) in dynamics.cell.scalars[0]:
        removed[k + dz, j + dy, i + dx] |= np.uint16(1 << bar)
    dynamics.set_removed(removed & (dynamics.lattice.bar_exists() @ (1 << np.arange(14))))
    velocity = np.zeros_like(pieces.places)
    velocity[node] = [-250.0, 3.0, -40.0]
    dynamics.set_velocity(pieces.spread(velocity))
    return velocity, node


def test_nodes_that_cannot_touch_soon_rest(pieces: Pieces) -> None:
    """All nodes that touch are awake, and most others are not looked at."""
    f = pieces.simulation.fragments
    number = np.flatnonzero(pieces.exists.ravel())
    pieces.throw()
    shares = []
    for _ in range(100):
        place = pieces.positions
        pieces.simulation.advance(1)
        nodes = f.nodes.to_numpy()[: f.size]
        awake = set(nodes[f.seen.to_numpy()[: f.size] == f.stamp[0]].tolist())
        left, right = np.flatnonzero(~pieces.right), np.flatnonzero(pieces.right)
        near = cKDTree(place[left]).query_ball_tree(cKDTree(place[right]), DISTANCE)
        touching = [b for found in near for b in found]
        touching = [*right[touching], *left[[len(found) > 0 for found in near]]]
        assert set(number[touching].tolist()) <= awake
        shares.append(len(awake) / f.size)
    assert len(touching) > 0
    assert min(shares) < 0.05
    assert np.mean(shares) < 0.5


def test_a_list_lasts_until_a_node_at_rest_has_moved(pieces: Pieces) -> None:
    from taichi_ldem.solver.contact.kernels.pairs import LATE, SKIN

    s, f = pieces.simulation, pieces.simulation.fragments
    _rest(pieces, (5e-3, 0.0, 0.0))  # too far apart for partners
    speed = float(f.numbers[4])  # as fast as a node may be that is no dust
    s.dynamics.set_velocity(pieces.spread(np.full_like(pieces.places, speed * 3**-0.5)))
    least = LATE * SKIN * DISTANCE / (speed * s.time_step)
    steps = 0
    while f.next_listing > s.step_number:
        s.advance(1)
        steps += 1
    assert least - 1 < steps < least + 10
    assert steps * speed * s.time_step < 0.5 * SKIN * DISTANCE  # nothing can have touched unseen


def test_dust_hits_like_any_other_node(pieces: Pieces, monkeypatch: pytest.MonkeyPatch) -> None:
    from taichi_ldem.solver.contact.kernels import pairs

    s, ends, listings = pieces.simulation, [], []
    for fewest in (pairs.FEWEST, 1e-3):  # the second calls nothing fast
        monkeypatch.setattr(pairs, "FEWEST", fewest)
        _, node = _bullet(pieces)
        start, due, count = pieces.momentum(), -1, 0
        for _ in range(160):
            s.advance(1)
            count, due = count + (s.fragments.next_listing != due), s.fragments.next_listing
            assert (s.fragments.dust_size > 0) == (fewest > 1)
        ends.append(pieces.positions)
        listings.append(count)
        np.testing.assert_allclose(pieces.momentum(), start, atol=1e-12 * np.abs(start).max())
        assert pieces.velocity[node, 0] > -200  # it has met the other piece
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9 * s.spacing)
    assert listings[0] < 0.5 * listings[1]


def test_too_many_pairs_are_named(pieces: Pieces) -> None:
    s = pieces.simulation
    pieces.throw()
    heap = pieces.spread(np.random.default_rng(0).uniform(0, 1e-4, pieces.places.shape))
    at = (heap - s.dynamics.lattice.positions()) * pieces.exists[..., None]
    s.dynamics.set_displacement(s.now, at)  # all nodes within a fifth of a module
    with pytest.raises(TooManyNodes, match=r"pairs of nodes .* list of \[contact\] holds \d+"):
        s.fragments.list_anew(s.now, 0, s.time_step)


# -- the time step ---------------------------------------------------------------------------------


def _highest(body: Body, pairs: np.ndarray, stiffness: np.ndarray, place: np.ndarray) -> float:
    """omega^2 of nodes at given places, with bars or contacts along the lines between pairs."""
    rows = np.repeat(np.arange(len(pairs)), 3)
    along = place[pairs[:, 1]] - place[pairs[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]

    def operator(end: int) -> sparse.csr_matrix:
        columns = (3 * pairs[:, end][:, None] + np.arange(3)).ravel()
        shape = (len(pairs), place.size)
        return sparse.csr_matrix((along.ravel(), (rows, columns)), shape=shape)

    stretch = operator(1) - operator(0)
    masses = np.tile(body.mass_shares, len(place) // len(body.places))
    scale = sparse.diags(np.repeat(masses, 3) ** -0.5)
    matrix = scale @ (stretch.T @ sparse.diags(stiffness) @ stretch) @ scale
    return float(eigsh(matrix, 1, which="LA", return_eigenvectors=False, tol=1e-3)[0])


def test_contact_hardly_raises_the_highest_frequency() -> None:
    """A block on another one whose nodes lie in its hollows: four contacts each, no bar is lost."""
    from taichi_ldem.solver.contact.kernels.spheres import STIFFER

    body = Body(prism(5, 5, 4))
    bars = body.weights * np.where(body.diagonal, 1.5, 1.0)
    alone = _highest(body, body.ends, bars, body.positions)
    high = body.positions + np.array([0.5, 0.5, body.positions[:, 2].max() + 0.45])
    place = np.vstack([body.positions, high])
    ends = np.vstack([body.ends, body.ends + len(high)])
    found = cKDTree(place).query_pairs(np.sqrt(0.75) - 1e-9, output_type="ndarray")
    found = found[(found < len(high)).sum(axis=1) == 1]
    assert np.bincount(found.ravel()).max() >= 4
    mass = np.tile(body.mass_shares, 2)[found]
    contacts = 2 * STIFFER * mass.prod(axis=1) / mass.sum(axis=1) / 0.5
    together = _highest(
        body, np.vstack([ends, found]), np.concatenate([bars, bars, contacts]), place
    )
    assert alone < together < 1.06 * alone  # 3 % of the time step; the default takes a half of it


@pytest.fixture
def fragments(pieces: Pieces) -> "Fragments":
    return pieces.simulation.fragments


def test_the_bytes_are_those_of_the_lists(fragments: "Fragments") -> None:
    from taichi_ldem.solver.contact.sizes import bytes_of
    from taichi_ldem.solver.state import field_bytes

    lists = [f for f in fragments.fields().values() if f.shape[0] >= fragments.capacity]
    n = fragments.hot.shape[0]
    cells = [f for f in fragments.fields().values() if f.shape[0] in (n, n + 1)]
    marks = (fragments.bare, fragments.marks)
    lists = [f for f in lists if not any(f is other for other in (*cells, *marks))]
    lattice = fragments.dynamics.lattice
    said = bytes_of(lattice.modules, lattice.cell.sublattices, 8)
    assert sum(map(field_bytes, lists)) == said
