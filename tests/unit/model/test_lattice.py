import numpy as np
import pytest
from support.reference import Body

from taichi_ldem.model.cell import MODULE
from taichi_ldem.model.lattice import (
    Lattice,
    cut_out,
    disc,
    dumbbell_half_width,
    prism,
    turned,
)

RAGGED = np.random.default_rng(3).random((3, 4, 5)) < 0.6
LONE = np.zeros((2, 3, 3), dtype=bool)
LONE[0, 0, 0] = LONE[1, 2, 2] = LONE[1, 1, 1] = True  # modules that share a corner or nothing
MASKS = {
    "one": prism(1, 1, 1),
    "prism": prism(4, 3, 2),
    "disc": disc(7, 7, 2, 5.5),
    "ragged": RAGGED,
    "lone": LONE,
}


@pytest.fixture(params=MASKS, scope="module")
def mask(request: pytest.FixtureRequest) -> np.ndarray:
    return MASKS[request.param]


@pytest.mark.parametrize("weighted", [True, False], ids=["weighted", "full"])
def test_bars_and_nodes_of_any_mask_are_those_of_its_modules(
    mask: np.ndarray, weighted: bool
) -> None:
    lattice, body = Lattice(mask, 0.3e-3, weighted), Body(mask, 0.3e-3, weighted)
    weights = lattice.bar_shares()
    assert lattice.bars == len(body.ends)
    assert lattice.nodes == len(body.places)
    np.testing.assert_array_equal(body.bar_values(weights, lattice.bar_midpoints), body.weights)
    assert weights.sum() == body.weights.sum()  # and there are no others


def test_masses_are_half_at_centres_and_half_at_corners(mask: np.ndarray) -> None:
    lattice, body = Lattice(mask, 0.3e-3), Body(mask, 0.3e-3)
    shares = np.moveaxis(MODULE.node_shares[lattice.code], -1, 0)
    np.testing.assert_array_equal(shares[body.index], body.mass_shares)
    assert shares.sum() == mask.sum()  # sixteenths: exact in binary
    assert lattice.volume == pytest.approx(mask.sum() * 0.3e-3**3, rel=1e-15)


def test_positions_are_centred_and_stand_on_zero(mask: np.ndarray) -> None:
    lattice, body = Lattice(mask, 0.3e-3), Body(mask, 0.3e-3)
    np.testing.assert_allclose(lattice.positions()[body.index], body.positions, atol=1e-18)
    np.testing.assert_array_equal(np.argwhere(lattice.exists()).shape[0], len(body.places))


@pytest.mark.parametrize("shape", [(174, 174, 6), (3, 5, 2), (1, 1, 1)])
def test_counts_of_a_prism_in_closed_form(shape: tuple[int, int, int]) -> None:
    nx, ny, nz = shape
    corners, centres = (nx + 1) * (ny + 1) * (nz + 1), nx * ny * nz
    edges = nx * (ny + 1) * (nz + 1) + (nx + 1) * ny * (nz + 1) + (nx + 1) * (ny + 1) * nz
    inner = (nx - 1) * ny * nz + nx * (ny - 1) * nz + nx * ny * (nz - 1)
    lattice = Lattice(prism(nx, ny, nz), 1.0)
    assert lattice.nodes == corners + centres
    assert lattice.bars == edges + inner + 8 * centres


def test_the_paper_s_plate_has_its_nodes_and_bars() -> None:
    lattice = Lattice(prism(174, 174, 6), 3.2e-3 / 6)  # 174 x 174 x 6 modules: closed form above
    assert lattice.nodes == 396_031
    assert lattice.bars == 2_575_902


def test_a_disc_holds_the_modules_whose_centre_is_within_it() -> None:
    mask = disc(40, 40, 2, 39.0)
    x = np.arange(40) - 19.5
    np.testing.assert_array_equal(mask[1], np.hypot(*np.meshgrid(x, x)) <= 19.5)
    assert mask.sum() / 2 == pytest.approx(np.pi * 19.5**2, rel=0.02)
    np.testing.assert_array_equal(mask, mask[:, ::-1, :])
    np.testing.assert_array_equal(mask, mask.transpose(0, 2, 1))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("position", [0.25, 0.5, 1.0, 0.0], ids=["node free", "centres", "1", "0"])
def test_a_plane_cuts_the_bars_whose_ends_it_parts(axis: int, position: float) -> None:
    lattice, body = Lattice(prism(4, 4, 4), 1.0), Body(prism(4, 4, 4), 1.0)
    shift = 2.0 if axis == 2 else 0.0  # x and y run from -2 to 2, z from 0 to 4
    cut = lattice.bars_crossing(axis, position + shift, (-9.0, -9.0), (9.0, 9.0))
    bits = cut[..., None] >> np.arange(14) & 1
    ends = body.positions[body.ends][..., axis] - shift
    # a plane through nodes lies just above them
    parted = (ends.min(axis=1) <= position) & (ends.max(axis=1) > position)
    np.testing.assert_array_equal(body.bar_values(bits, lattice.bar_midpoints), parted)
    assert bits.sum() == parted.sum()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("position", [0.5, 1.0])
def test_mirrored_planes_through_nodes_cut_mirrored_bars(axis: int, position: float) -> None:
    """Before, both cut the bars above their nodes."""
    lattice, body = Lattice(prism(4, 4, 4), 1.0), Body(prism(4, 4, 4), 1.0)
    shift = 2.0 if axis == 2 else 0.0
    parted = []
    for side in (-1, 1):
        cut = lattice.bars_crossing(axis, shift + side * position, (-9.0, -9.0), (9.0, 9.0))
        bars = body.bar_values(cut[..., None] >> np.arange(14) & 1, lattice.bar_midpoints) == 1
        ends = side * (body.positions[body.ends][..., axis] - shift)
        np.testing.assert_array_equal(
            bars, (ends.min(axis=1) <= position) & (ends.max(axis=1) > position)
        )
        parted.append(bars.sum())
    assert parted[0] == parted[1] > 0


@pytest.mark.parametrize("angle", [12.0, 22.5, 45.0])
def test_a_turned_plane_cuts_the_bars_whose_ends_it_parts(angle: float) -> None:
    """Counted from the nodes' places, with the plane's normal turned by hand."""
    lattice, body = Lattice(prism(4, 4, 3), 1.0), Body(prism(4, 4, 3), 1.0)
    turn = np.radians(angle)
    cut = lattice.bars_crossing(0, 0.23, (-9.0, -9.0), (9.0, 9.0), turn)
    bits = cut[..., None] >> np.arange(14) & 1
    along = body.positions[body.ends] @ (np.cos(turn), np.sin(turn), 0.0)
    parted = (along.min(axis=1) <= 0.23) & (along.max(axis=1) > 0.23)
    np.testing.assert_array_equal(body.bar_values(bits, lattice.bar_midpoints), parted)
    assert bits.sum() == parted.sum() > 0


def test_a_plane_turned_by_a_right_angle_is_normal_to_the_next_axis() -> None:
    lattice = Lattice(prism(5, 5, 2), 1.0)
    turned_x = lattice.bars_crossing(0, 0.25, (-1.0, 0.0), (1.0, 9.0), np.pi / 2)
    np.testing.assert_array_equal(turned_x, lattice.bars_crossing(1, 0.25, (-1.0, 0.0), (1.0, 9.0)))


def test_turned_coordinates_turn_back() -> None:
    places = np.random.default_rng(1).normal(size=(5, 3))
    np.testing.assert_allclose(turned(turned(places, 0.7), -0.7), places, atol=1e-15)
    np.testing.assert_allclose(turned(np.array([0.0, 1.0, 2.0]), np.pi / 2), [1, 0, 2], atol=1e-15)


def test_a_short_notch_cuts_only_bars_that_pass_through_it() -> None:
    lattice, body = Lattice(prism(4, 4, 4), 1.0), Body(prism(4, 4, 4), 1.0)
    cut = lattice.bars_crossing(0, 0.25, (-0.1, 1.0), (1.1, 2.0))  # y from -0.1, z from 1
    first, second = (body.positions[body.ends[:, n]] for n in (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        at = (0.25 - first[:, 0]) / (second - first)[:, 0]
        _, y, z = (first + at[:, None] * (second - first)).T
        inside = (at >= 0) & (at < 1) & (y >= -0.1) & (y <= 1.1) & (z >= 1.0) & (z <= 2.0)
    bits = cut[..., None] >> np.arange(14) & 1
    np.testing.assert_array_equal(body.bar_values(bits, lattice.bar_midpoints), inside)
    assert inside.any()


# ASTM D638, type V, in millimetres: overall width 9.53, narrow part 3.18 x 9.53, fillets of 12.7
TYPE_V = {"width": 9.53, "narrow_width": 3.18, "narrow_length": 9.53, "fillet_radius": 12.7}


def test_a_dumb_bell_narrows_in_arcs() -> None:
    x = np.linspace(-31.75, 31.75, 2541)
    half = dumbbell_half_width(x, **TYPE_V)
    np.testing.assert_allclose(half, half[::-1], rtol=1e-13)
    assert (half[np.abs(x) < 4.765] == 1.59).all()
    # the arc's centre lies a radius beside the narrow part; the tabs begin 8.40 mm further:
    # sqrt(12.7^2 - (12.7 - 3.175)^2)
    arc = (np.abs(x) > 4.765) & (np.abs(x) < 4.765 + 8.39)
    from_centre = np.hypot(np.abs(x[arc]) - 4.765, half[arc] - (1.59 + 12.7))
    np.testing.assert_allclose(from_centre, 12.7, rtol=1e-12)
    assert (half[np.abs(x) > 4.765 + 8.41] == 4.765).all()


def test_a_dumb_bell_of_modules_has_its_narrow_part_and_tabs() -> None:
    edge = 3.2 / 6
    outline = {name: value / edge for name, value in TYPE_V.items()}
    mask = cut_out(119, 18, 6, 63.5 / edge, lambda x: dumbbell_half_width(x, **outline))
    across = mask[3].sum(axis=0)
    assert across[59] == across.min() == 6  # 3.18 mm are 5.96 modules
    assert (across[:35] == 18).all()  # the tab goes on for 18.6 mm
    assert (across[50:69] == 6).all()
    exact = 63.5 * np.mean(2 * dumbbell_half_width(np.linspace(-31.75, 31.75, 10001), **TYPE_V))
    assert mask[0].sum() * edge**2 == pytest.approx(exact, rel=0.01)
    np.testing.assert_array_equal(mask, mask[:, ::-1, ::-1])


def test_a_prism_cut_along_a_diagonal() -> None:
    mask = cut_out(40, 40, 2, 30.0, lambda x: np.full_like(x, 4.0), np.pi / 4)
    y, x = np.nonzero(mask[0])
    u, v = x + y - 39, x - y  # sqrt(2) times the distances along and across, from the middle
    # the largest whole numbers within 15 sqrt(2) and 4 sqrt(2); of u and v one is odd, one even
    assert (u.min(), u.max(), v.min(), v.max()) == (-21, 21, -5, 5)
    assert mask[0].sum() == 22 * 5 + 21 * 6
    np.testing.assert_array_equal(mask[0], mask[0].T)


def test_thousands_of_notches_look_at_the_bars_near_them_only(monkeypatch) -> None:
    """5000 notches took minutes: each was compared with the whole lattice."""
    lattice = Lattice(np.ones((4, 9, 12), dtype=bool), 0.5)
    rng = np.random.default_rng(3)
    planes = []
    for _ in range(300):
        axis, turn = int(rng.integers(3)), float(rng.choice([0.0, 0.3, np.pi / 4]))
        lower = np.round(rng.uniform(-4, 2, 2) / 0.25) * 0.25
        position = float(np.round(rng.uniform(-3.5, 3.5) / 0.125) * 0.125)
        planes.append((axis, position, tuple(lower), tuple(lower + rng.uniform(0, 4, 2)), turn))
    planes.append((2, 0.7, (-1e20, -1e20), (1e20, 1e20), 0.0))
    near = [lattice.bars_crossing(*plane) for plane in planes]
    assert 50 < sum(bool(cut.any()) for cut in near) < 301
    wide = Lattice(np.ones((4, 40, 40), dtype=bool), 0.5)
    part = wide._sites_near(np.array([[0.2, 0.3, 0.4], [0.3, 0.4, 0.5]]))
    assert np.ones(wide.sites)[part].size < 0.05 * np.prod(wide.sites)
    monkeypatch.setattr(Lattice, "_sites_near", lambda self, places: (slice(None),) * 3)
    for plane, cut in zip(planes, near, strict=True):
        np.testing.assert_array_equal(cut, lattice.bars_crossing(*plane))
