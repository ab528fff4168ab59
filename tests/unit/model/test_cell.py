"""The tables of the unit cells, compared with the vectors of the bars."""

import numpy as np
import pytest

from taichi_ldem.model.cell import CELLS, CUBIC_26, MODULE, Offset, UnitCell

NODES = [(cell, s) for cell in CELLS.values() for s in range(cell.sublattices)]


@pytest.fixture(params=CELLS.values(), ids=list(CELLS))
def cell(request: pytest.FixtureRequest) -> UnitCell:
    return request.param


def _place(sublattice: int, offset: Offset) -> np.ndarray:
    """Place (x, y, z) of a node in module edges: centres lie half a module from their site."""
    return np.array(offset[::-1]) + 0.5 * sublattice


def test_ends_lie_a_bar_vector_apart(cell: UnitCell) -> None:
    for bar, (first, second) in enumerate(cell.ends):
        np.testing.assert_array_equal(_place(*second) - _place(*first), cell.vectors[bar])
        np.testing.assert_array_equal(cell.starts[bar], _place(*first))
        assert cell.length_squared[bar] == cell.vectors[bar] @ cell.vectors[bar]


@pytest.mark.parametrize(("cell", "sublattice"), NODES)
def test_every_bar_of_a_node_has_it_as_one_end(cell: UnitCell, sublattice: int) -> None:
    """Six lead along the axes, + before -; each has the other end where the table says."""
    here = _place(sublattice, (0, 0, 0))
    directions = []
    for bar, home, other, there in cell.attached(sublattice):
        ends = [_place(s, offset) + np.array(home[::-1]) for s, offset in cell.ends[bar]]
        neighbour = _place(other, there)
        assert sorted(map(tuple, ends)) == sorted(map(tuple, (here, neighbour)))
        directions.append(neighbour - here)
    number = {"module": 14, "cubic-26": 26}[cell.name]
    assert len(directions) == len({tuple(d) for d in directions}) == number
    axes = [sign * np.eye(3)[axis] for axis in range(3) for sign in (1, -1)]
    np.testing.assert_array_equal(directions[:6], axes)
    np.testing.assert_array_equal(directions, cell.rays[sublattice])
    assert (
        sum(cell.rays[sublattice] @ (1, 2, 4) > 0) == number / 2
    )  # a node is a centre of symmetry
    bars = [(bar, home) for bar, home, _, _ in cell.attached(sublattice)]
    assert bars == list(cell.scalars[sublattice])
    assert len(cell.neighbours[sublattice]) == number


@pytest.mark.parametrize(("cell", "sublattice"), NODES)
def test_levers_are_the_diagonals_on_either_side(cell: UnitCell, sublattice: int) -> None:
    here = _place(sublattice, (0, 0, 0))
    for axis, (ups, downs) in enumerate(cell.levers[sublattice]):
        for numbers, sign in ((ups, 1), (downs, -1)):
            assert len(numbers) == {"module": 4, "cubic-26": 8}[cell.name]
            for number in numbers:
                arm = (_place(*cell.neighbours[sublattice][number]) - here)[axis]
                assert arm == sign * cell.reach


def test_shares_add_up_to_whole_bars_and_modules(cell: UnitCell) -> None:
    """Inside a body every bar is whole, and the nodes of a site have the mass of a module."""
    np.testing.assert_array_equal(cell.weights(True)[255], 1.0)
    assert cell.node_shares[255].sum() == 1.0
    np.testing.assert_array_equal(cell.weights(True)[0], 0.0)
    for bar, kind in enumerate(cell.stiffness_kind):
        np.testing.assert_array_equal(cell.shares[:, bar], cell.shares[:, kind])
        assert cell.family[bar] == cell.family[kind]


def test_bars_of_a_module() -> None:
    """Twenty in Fig. 1(a) of the paper; twelve edges, twelve face and four cube diagonals."""
    assert len(MODULE.of_module) == 20
    families = np.array(CUBIC_26.family)[[bar for bar, _ in CUBIC_26.of_module]]
    np.testing.assert_array_equal(np.bincount(families), (12, 12, 4))


def test_a_single_module_has_part_of_every_shared_bar() -> None:
    """An edge is shared by four modules, a diagonal of a face by two, that of a cube by one."""
    code = np.array([0b10000000])  # the module of the site itself
    edges, faces, cubes = CUBIC_26.weights(True)[code][0, [0, 3, 9]]
    assert (edges, faces, cubes) == (0.25, 0.5, 1.0)


def test_bars_that_a_flat_crack_takes_from_a_node() -> None:
    """Counted by hand: of (100) 1 + 4 and 1 + 4 + 4, of (110) 2 + 2 and 2 + 5 + 2."""
    assert MODULE.fewest_cut == 4
    assert CUBIC_26.fewest_cut == 9
