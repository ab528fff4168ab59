"""Regions of a lattice, and the surface that belongs to their nodes."""

import numpy as np
import pytest

from taichi_ldem.model import regions
from taichi_ldem.model.lattice import Lattice, disc, prism

EDGE = 0.5e-3
BLOCK = Lattice(prism(4, 3, 2), EDGE)


@pytest.mark.parametrize(("face", "sides"), [("-x", (3, 2)), ("+y", (4, 2)), ("+z", (4, 3))])
def test_corners_edges_and_the_inside_of_a_face_have_a_quarter_half_and_all(
    face: str, sides: tuple[int, int]
) -> None:
    region = regions.on_face(BLOCK, face)
    a, b = sides
    assert region.sum() == (a + 1) * (b + 1)
    assert not region[1].any()  # centre nodes lie half a module inside
    area = regions.areas(BLOCK, region, face)
    shares, counts = np.unique(area[region] / EDGE**2, return_counts=True)
    np.testing.assert_allclose(shares, [0.25, 0.5, 1.0])
    assert counts.tolist() == [4, 2 * (a + b - 2), (a - 1) * (b - 1)]
    assert area.sum() == pytest.approx(a * b * EDGE**2)


def test_a_box_takes_the_faces_that_lie_in_it() -> None:
    patch = regions.in_box(BLOCK, [[1e-3, 1e-3, 1e-3], [0, -EDGE, 1e-3]])  # any order of corners
    area = regions.areas(BLOCK, patch, None)
    assert area.sum() == pytest.approx(2 * 2 * EDGE**2)  # x to the edge, y half a module off it
    everything = regions.in_box(BLOCK, [[-1, -1, -1], [1, 1, 1]])
    assert everything.sum() == BLOCK.nodes
    whole = regions.areas(BLOCK, everything, None).sum()
    assert whole == pytest.approx(2 * (12 + 8 + 6) * EDGE**2)


def test_perturbed_nodes_belong_to_the_face_that_they_lie_on() -> None:
    uneven = Lattice(prism(4, 3, 2), EDGE, perturbation=0.25, seed=3)
    region = regions.on_face(uneven, "+z")
    np.testing.assert_array_equal(region, regions.on_face(BLOCK, "+z"))


def test_a_ring_on_a_disc() -> None:
    plate = Lattice(disc(20, 20, 1, 20.0), EDGE)
    face = regions.on_face(plate, "+z")
    inner, outer = 4 * EDGE, 8 * EDGE
    ring = face & regions.between_circles(plate, "+z", None, inner, outer)
    area = regions.areas(plate, ring, "+z").sum()
    assert area == pytest.approx(np.pi * (outer**2 - inner**2), rel=0.1)
    moved = face & regions.between_circles(plate, "+z", [EDGE, 0.0], 0.0, 1.5 * EDGE)
    assert plate.grid()[moved].mean(axis=0) == pytest.approx([EDGE, 0.0, EDGE])
    side = regions.between_circles(plate, "+x", None, 0.0, 0.1 * EDGE)  # around half the height
    assert not side[0].any()


def test_the_nearest_node_or_all_that_are_equally_near() -> None:
    corner = BLOCK.grid()[0, 1, 1, 1]
    assert regions.nearest(BLOCK, corner + 0.1 * EDGE).sum() == 1
    point = corner + np.array([0.5 * EDGE, 0.0, 0.0])
    between = regions.nearest(BLOCK, point)
    assert between.sum() == 2
    assert BLOCK.grid()[between].mean(axis=0) == pytest.approx(point)


def test_a_plane_takes_the_nodes_within_half_a_module() -> None:
    plane = regions.near_plane(BLOCK, "x", 0.0)
    assert np.unique(BLOCK.grid()[plane][:, 0]) == pytest.approx([-EDGE / 2, 0.0, EDGE / 2])
