"""Sizes of the lists of pieces that may touch; they are needed before Taichi is imported."""

import math

FEWEST_PAIRS = 640_000
PAIRS_A_NODE = (32, 4)
"""Partners of a node that the list has room for: on a small lattice, and in the mean of a large one
where that is more than FEWEST_PAIRS."""


def most_nodes(modules: tuple[int, int, int], sublattices: int) -> int:
    """Nodes of the whole prism that a body is cut from."""
    corners, centres = math.prod(n + 1 for n in modules), math.prod(modules)
    return corners + (sublattices - 1) * centres


def most_pairs(nodes: int) -> int:
    """Entries of the list of partners of a lattice of so many nodes."""
    small, large = PAIRS_A_NODE
    return min(small * nodes, max(FEWEST_PAIRS, large * nodes))


def bytes_of(modules: tuple[int, int, int], sublattices: int, real_bytes: int) -> int:
    """Bytes of the lists of nodes and pairs, without the marks of rows and cells."""
    nodes = most_nodes(modules, sublattices)
    return nodes * (11 * 4 + 3 * real_bytes + (6 * 3 + 1) * 8) + 4 * most_pairs(nodes)
