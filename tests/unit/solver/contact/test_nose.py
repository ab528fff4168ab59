"""The distance function of every nose, in NumPy, against its profile."""

import numpy as np
import pytest

from taichi_ldem.scene.names import NOSE_NAMES
from taichi_ldem.scene.strikers import NOSE_KEYS
from taichi_ldem.solver.contact.noses import nose_of

RADIUS = 2.0
VALUES = {"nose_angle": 35.0, "nose_radius": 5.0, "ring_diameter": 9.0}
"""Of the key that a nose needs; lengths are in units of the tests."""


class Place:
    """A place as the kernels' vectors are: what a distance function may use of them."""

    def __init__(self, x: float, y: float, z: float) -> None:
        self.x, self.y, self.z = float(x), float(y), float(z)

    def norm(self) -> float:
        return float(np.sqrt(self.x**2 + self.y**2 + self.z**2))

    def __mul__(self, factor: float) -> "Place":
        return Place(self.x * factor, self.y * factor, self.z * factor)

    def __truediv__(self, factor: float) -> "Place":
        return self * (1 / factor)


def numbers(name: str) -> tuple[float, ...]:
    key = NOSE_KEYS.get(name, "")
    return nose_of(name).numbers(VALUES.get(key), RADIUS)


def found(name: str, place: np.ndarray) -> tuple[float, np.ndarray]:
    distance, normal = nose_of(name).surface(Place(*place), RADIUS, *numbers(name))
    return distance, np.array([normal.x, normal.y, normal.z])


def places(name: str) -> np.ndarray:
    """(n, 3) places in and around the nose and the lower end of its shaft."""
    wide = 2 * RADIUS + (VALUES["ring_diameter"] / 2 if name == "ring" else 0.0)
    random = np.random.default_rng(3).uniform(-1, 1, (400, 3))
    return random * [wide, wide, 2.5 * RADIUS] + [0, 0, 0.5 * RADIUS]


def by_hand(name: str, place: np.ndarray) -> np.ndarray:
    """Signed distances to the profile, drawn with many points, with a long shaft above it."""
    nose = nose_of(name)
    out, up = nose.profile(RADIUS, *numbers(name))
    if name == "ring":  # the roof in the tube is for drawing only
        out, up = np.append(out[1], out[1:]), np.append(5 * RADIUS, up[1:])
    out, up = np.append(out, out[-1]), np.append(up, 5 * RADIUS) - RADIUS
    if name == "ring":
        up[0] = 5 * RADIUS
    # many points on every straight piece; the round ones are drawn with few pieces
    share = np.linspace(0, 1, 150)[:, None]
    line = np.stack([out, up], axis=1)
    points = (line[:-1, None] * (1 - share) + line[1:, None] * share).reshape(-1, 2)
    across = np.abs(place[:, 0]) if nose.along_y else np.hypot(place[:, 0], place[:, 1])
    meridian = np.stack([across, place[:, 2]], axis=1)
    away = np.linalg.norm(meridian[:, None] - points, axis=2).min(axis=1)
    middle = VALUES["ring_diameter"] / 2 if name == "ring" else 0.0
    side = np.abs(across - middle)  # from the middle of what stands on the profile
    rising = out >= middle
    height = np.interp(side, out[rising] - middle, up[rising])
    inside = (side < RADIUS) & (place[:, 2] > height)
    return np.where(inside, -away, away)


@pytest.mark.parametrize("name", NOSE_NAMES)
def test_the_distance_is_that_of_the_nearest_point_of_the_profile(name: str) -> None:
    place = places(name)
    distance = np.array([found(name, at)[0] for at in place])
    expected = by_hand(name, place)
    clear = np.abs(expected) > 0.02 * RADIUS
    assert (np.sign(distance) == np.sign(expected))[clear].all()
    # a round profile of 16 pieces lies up to R (1 - cos(pi / 64)) = 0.0012 R inside the arc
    if name in ("hemisphere", "cylinder"):  # inside, above the nose, they measure from the shaft
        clear &= (expected > 0) | (place[:, 2] < 0)
    np.testing.assert_allclose(distance[clear], expected[clear], atol=0.02 * RADIUS)


@pytest.mark.parametrize("name", NOSE_NAMES)
def test_the_normal_is_the_gradient_of_the_distance_and_has_length_one(name: str) -> None:
    step, smooth = 1e-6 * RADIUS, 0
    for place in places(name)[:150]:
        distance, normal = found(name, place)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)
        sides = [
            (found(name, place + step * axis)[0] - found(name, place - step * axis)[0]) / (2 * step)
            for axis in np.eye(3)
        ]
        if np.linalg.norm(sides) > 1 - 1e-6:  # not on the line where two sides are as near
            smooth += 1
            np.testing.assert_allclose(normal, sides, atol=1e-5)
        # a node is put at the foot of its normal, which lies on the surface
        assert abs(found(name, place - distance * normal)[0]) < 1e-5 * RADIUS
    assert smooth > 140


@pytest.mark.parametrize("name", ["cone", "ogive", "flat"])
def test_a_place_on_the_axis_leaves_through_the_tip(name: str) -> None:
    for x in (0.0, 1e-14 * RADIUS):
        distance, normal = found(name, np.array([x, 0.0, -RADIUS + 1e-3]))
        assert distance == pytest.approx(-1e-3)
        np.testing.assert_allclose(normal, [0, 0, -1], atol=1e-9)


def test_an_ogive_of_the_shafts_own_radius_is_a_hemisphere() -> None:
    for place in places("hemisphere")[:200]:
        at = Place(*place)
        ogive = nose_of("ogive").surface(at, RADIUS, RADIUS)
        distance, normal = found("hemisphere", place)
        assert ogive[0] == pytest.approx(distance, abs=1e-12)
        np.testing.assert_allclose([ogive[1].x, ogive[1].y, ogive[1].z], normal, atol=1e-9)


def test_a_flat_end_pushes_down_under_it_out_beside_it_and_away_from_its_edge() -> None:
    for place, normal in (
        ((0.5, 0.3, -RADIUS - 0.1), (0, 0, -1)),
        ((RADIUS + 0.1, 0, 0.4), (1, 0, 0)),
        ((0, RADIUS + 0.3, -RADIUS - 0.4), (0, 0.6, -0.8)),  # 3, 4, 5
    ):
        np.testing.assert_allclose(found("flat", np.array(place))[1], normal, atol=1e-12)
    assert found("flat", np.array([0, RADIUS + 0.3, -RADIUS - 0.4]))[0] == pytest.approx(0.5)
