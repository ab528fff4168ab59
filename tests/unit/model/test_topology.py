"""The tables of the unit cell, compared with the vectors of the bars."""

import numpy as np
import pytest

from taichi_ldem.model.lattice import BAR_VECTORS, BARS_PER_SITE
from taichi_ldem.model.topology import (
    CENTRE,
    CORNER,
    ENDS,
    INVERSE_LENGTH_SQUARED,
    LENGTH_SQUARED,
    LEVERS,
    NEIGHBOURS,
    SCALARS,
    attached_bars,
)


def _place(sublattice: int, offset: tuple[int, ...]) -> np.ndarray:
    """Place (x, y, z) of a node in module edges: centres lie half a module from their site."""
    return np.array(offset[::-1]) + 0.5 * sublattice


def test_ends_lie_a_bar_vector_apart() -> None:
    for bar, (first, second) in enumerate(ENDS):
        np.testing.assert_array_equal(_place(*second) - _place(*first), BAR_VECTORS[bar])
        assert LENGTH_SQUARED[bar] == BAR_VECTORS[bar] @ BAR_VECTORS[bar]
        assert INVERSE_LENGTH_SQUARED[bar] == 1 / LENGTH_SQUARED[bar]


@pytest.mark.parametrize("sublattice", [CORNER, CENTRE])
def test_fourteen_bars_meet_at_a_node(sublattice: int) -> None:
    """Six lead along the axes, + before -; each has the node as one end the other where said."""
    here = _place(sublattice, (0, 0, 0))
    directions = []
    for bar, home, other, there in attached_bars(sublattice):
        ends = [_place(s, offset) + np.array(home[::-1]) for s, offset in ENDS[bar]]
        neighbour = _place(other, there)
        assert sorted(map(tuple, ends)) == sorted(map(tuple, (here, neighbour)))
        directions.append(neighbour - here)
    assert len(directions) == len({tuple(d) for d in directions}) == BARS_PER_SITE
    axes = [sign * np.eye(3)[axis] for axis in range(3) for sign in (1, -1)]
    np.testing.assert_array_equal(directions[:6], axes)
    bars = [(bar, home) for bar, home, _, _ in attached_bars(sublattice)]
    assert bars == list(SCALARS[sublattice])
    assert len(NEIGHBOURS[sublattice]) == BARS_PER_SITE


@pytest.mark.parametrize("sublattice", [CORNER, CENTRE])
def test_levers_are_the_diagonals_on_either_side(sublattice: int) -> None:
    """The lever arm along an axis is s - 1/2 on the first side and its negative on the other."""
    here = _place(sublattice, (0, 0, 0))
    for axis, (up, down) in enumerate(LEVERS):
        for numbers, sign in ((up, 1), (down, -1)):
            for number in numbers:
                arm = (_place(*NEIGHBOURS[sublattice][number]) - here)[axis]
                assert arm == sign * (sublattice - 0.5)
