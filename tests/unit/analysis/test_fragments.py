"""Pieces of plates that notches cut and that failed bars take apart."""

import numpy as np
import pytest

from taichi_ldem.analysis.fragments import (
    DEBRIS,
    NOTHING,
    Pieces,
    labels_of,
    of_modules,
    pieces_of,
)
from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.lattice import Lattice, disc, prism

EDGE, DENSITY = 1e-3, 2500.0
FAR = ((-1.0, -1.0), (1.0, 1.0))


def _plate(lattice: str, perturbation: float = 0.0) -> Lattice:
    return Lattice(prism(8, 6, 3), EDGE, perturbation=perturbation, cell=CELLS[lattice])


def _nothing_failed(lattice: Lattice) -> np.ndarray:
    return np.zeros(lattice.sites, dtype=np.uint16)


def _pieces(lattice: Lattice, labels: np.ndarray, seed: int = 3) -> Pieces:
    """Pieces of nodes that move at random."""
    moved, velocity = np.random.default_rng(seed).normal(size=(2, *labels.shape, 3))
    return pieces_of(lattice, labels, _masses(lattice), 1e-5 * moved, velocity)


def _masses(lattice: Lattice) -> np.ndarray:
    shares = np.moveaxis(lattice.cell.node_shares[lattice.code], -1, 0)
    return shares * DENSITY * EDGE**3


@pytest.mark.parametrize("lattice", CELLS)
def test_a_whole_body_is_one_piece_with_all_of_the_mass(lattice: str) -> None:
    body = Lattice(disc(9, 9, 2, 9.0), EDGE, perturbation=0.1, cell=CELLS[lattice])
    labels = labels_of(body, _nothing_failed(body))
    assert set(labels[body.exists()]) == {1}
    assert (labels[~body.exists()] == NOTHING).all()
    pieces = _pieces(body, labels)
    assert pieces.nodes.tolist() == [body.nodes]
    assert pieces.mass[0] == pytest.approx(DENSITY * body.volume, rel=1e-13)
    assert pieces.volume[0] == pytest.approx(body.volume, rel=1e-13)
    np.testing.assert_allclose(pieces.extent[0], (9 * EDGE, 9 * EDGE, 2 * EDGE), rtol=0.03)
    assert (of_modules(body, labels) == 1).all()


@pytest.mark.parametrize("lattice", CELLS)
@pytest.mark.parametrize("count", [2, 4])
def test_notches_cut_a_plate_into_a_known_number_of_pieces(lattice: str, count: int) -> None:
    """One notch at x = 1 mm, and a second at y = -1 mm; removed bars are not intact."""
    body = _plate(lattice)
    failed = body.bars_crossing(0, EDGE, *FAR)
    if count == 4:
        failed |= body.bars_crossing(1, -EDGE, *FAR)
    labels = labels_of(body, failed)
    pieces = _pieces(body, labels)
    assert pieces.number.tolist() == list(range(1, count + 1))
    assert (np.diff(pieces.volume) <= 0).all()
    # corner nodes in the plane of a notch stay with the side that is nearer to the middle, and each
    # of them stands for half a module to either side; centre nodes hold half of the mass
    corners = np.outer([5.5, 2.5], [4.5, 1.5] if count == 4 else [6]).ravel() / 48
    centres = np.outer([5, 3], [4, 2] if count == 4 else [6]).ravel() / 48
    wanted = (corners + centres) / 2 if lattice == "module" else corners
    np.testing.assert_allclose(pieces.mass / pieces.mass.sum(), np.sort(wanted)[::-1], rtol=1e-12)
    np.testing.assert_array_equal(np.unique(of_modules(body, labels)), pieces.number)


@pytest.mark.parametrize("lattice", CELLS)
def test_masses_and_momenta_of_the_pieces_add_up_to_those_of_the_plate(lattice: str) -> None:
    body = _plate(lattice, perturbation=0.05)
    some = np.random.default_rng(1).integers(0, 1 << 16, (4, *body.sites)).astype(np.uint16)
    failed = np.bitwise_or.reduce(some)  # fifteen of sixteen bars
    labels = labels_of(body, failed)
    velocity = np.random.default_rng(4).normal(size=(*labels.shape, 3))
    moved = np.zeros_like(velocity)
    mass = _masses(body)
    pieces = pieces_of(body, labels, mass, moved, velocity)
    assert len(pieces.number) > 5
    assert pieces.number[0] == DEBRIS
    assert pieces.nodes.sum() == body.nodes
    assert pieces.mass.sum() == pytest.approx(DENSITY * body.volume, rel=1e-13)
    momentum = np.einsum("skji,skjia->a", mass, velocity)
    scale = np.einsum("skji,skjia->a", mass, np.abs(velocity))
    assert (np.abs(pieces.momentum.sum(axis=0) - momentum) < 1e-13 * scale).all()
    middle = np.einsum("skji,skjia->a", mass, body.positions()) / mass.sum()
    found = (pieces.mass @ pieces.centre) / pieces.mass.sum()
    np.testing.assert_allclose(found, middle, atol=1e-15)


@pytest.mark.parametrize("lattice", CELLS)
def test_a_single_node_is_debris_and_two_nodes_are_a_piece(lattice: str) -> None:
    """All bars have failed but one."""
    body = _plate(lattice)
    failed = np.full(body.sites, 0xFFFF, dtype=np.uint16)
    failed[2, 3, 4] ^= 1  # the bar along x
    labels = labels_of(body, failed)
    pieces = _pieces(body, labels)
    assert pieces.number.tolist() == [DEBRIS, 1]
    assert pieces.nodes.tolist() == [body.nodes - 2, 2]
    np.testing.assert_allclose(pieces.extent, [(0, 0, 0), (EDGE, 0, 0)], atol=1e-15)
    each = np.cbrt(6 * pieces.volume / np.pi / [body.nodes - 2, 1])
    np.testing.assert_allclose(pieces.diameter, each)
    summary = pieces.summary()
    assert (summary["fragments"], summary["fragments_above_10_modules"]) == (1, 0)
    total = summary["debris_mass_share"] + summary["largest_fragment_mass_share"]
    assert total == pytest.approx(1.0, rel=1e-13)
    # a module shows debris only where no bar holds any of its nodes
    assert np.unique(of_modules(body, labels)).tolist() == [DEBRIS, 1]
    assert (of_modules(body, labels) == 1).sum() == 12


@pytest.mark.parametrize("lattice", CELLS)
def test_bars_are_found_again_from_their_mid_points(lattice: str) -> None:
    """Runs store broken bars by mid-point and number."""
    body = _plate(lattice)
    site, bar = [], []
    for number in range(body.cell.bars):
        there = np.argwhere(body.bar_exists()[..., number])
        site.append(there[::3])
        bar.append(np.full(len(there[::3]), number))
    sites, bars = np.concatenate(site), np.concatenate(bar)
    wanted = np.zeros(body.sites, dtype=np.uint16)
    np.bitwise_or.at(wanted, tuple(sites.T), (1 << bars).astype(np.uint16))
    found = body.failed_bits(body.bar_midpoints(sites, bars), bars.astype(np.uint8))
    np.testing.assert_array_equal(found, wanted)
