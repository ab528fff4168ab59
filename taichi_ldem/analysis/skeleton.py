"""Skeletons of cracked pixels: thinning, its graph, the paths from its ends to a core.

The functions take masks (nx, ny) and count in pixels.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Pixels = NDArray[np.int64]


def closed(mask: Mask) -> Mask:
    """The mask with gaps of one pixel bridged and pinholes of up to four pixels filled."""
    from scipy import ndimage

    padded = np.pad(mask, 2)
    bridged = ndimage.binary_closing(padded, np.ones((3, 3), dtype=bool))[2:-2, 2:-2]
    holes, count = ndimage.label(~bridged)
    small = np.bincount(holes.ravel(), minlength=count + 1) <= 4
    small[0] = False
    filled: Mask = bridged | small[holes]
    return filled


def thin(mask: Mask) -> Mask:
    """The skeleton of a mask: lines of one pixel."""
    from skimage.morphology import skeletonize

    # Zhang's algorithm, the default, eats diagonal lines of two pixels' width from their ends
    thinned: Mask = skeletonize(np.pad(mask, 1), method="lee")[1:-1, 1:-1] > 0
    return thinned


class Skeleton:
    """The skeleton of a map as a graph of pixels, with the shortest paths from its ends.

    Thinning removes about half a crack's width at each end. A path therefore begins at the
    outermost of those cracked pixels to which the skeleton's end is the nearest skeleton pixel.
    """

    def __init__(self, mask: Mask, core: Mask, radius: NDArray[np.float64]):
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra
        from scipy.spatial import KDTree

        skeleton = thin(mask) | core
        self.pixels = np.argwhere(skeleton)
        self.in_core = core[tuple(self.pixels.T)]
        tree = KDTree(self.pixels)
        # 32-bit indices: graph searches of SciPy 1.11 take no others
        first, second = tree.query_pairs(1.5, output_type="ndarray").astype(np.int32).T
        length = np.linalg.norm(self.pixels[first] - self.pixels[second], axis=1)
        count = len(self.pixels)
        self.graph = csr_array((length, (first, second)), shape=(count, count))
        self.graph = (self.graph + self.graph.T).tocsr()
        self.distance, self.before, _ = dijkstra(
            self.graph,
            indices=np.flatnonzero(self.in_core),
            min_only=True,
            return_predecessors=True,
        )
        self.cracked = np.argwhere(mask)
        self.cracked = self.cracked[np.argsort(radius[tuple(self.cracked.T)], kind="stable")]
        self.nearest = tree.query(self.cracked)[1]

    def paths(self) -> list[Pixels]:
        """Pixels (n, 2) from each end outside of the core to the first pixel in the core."""
        found = []
        for node in np.flatnonzero(~self.in_core & np.isfinite(self.distance)):
            near = self.graph.indices[self.graph.indptr[node] : self.graph.indptr[node + 1]]
            neighbours = self.pixels[near]
            # two neighbours that touch each other count as one: the last bend of a staircase
            if len(near) == 1 or (
                len(near) == 2 and np.abs(neighbours[0] - neighbours[1]).sum() == 1
            ):
                found.append(self._path(int(node)))
        return found

    def _path(self, end: int) -> Pixels:
        nodes = [end]
        while not self.in_core[nodes[-1]]:
            nodes.append(int(self.before[nodes[-1]]))
        path: Pixels = self.pixels[nodes]
        outermost = self.cracked[self.nearest == end][-1]
        return path if (outermost == path[0]).all() else np.vstack([outermost, path])


def path_length(path: Pixels) -> float:
    """Length of a path (n, 2), in pixels."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def pixel_lengths(skeleton: Mask) -> NDArray[np.float64]:
    """Length in pixels that each pixel of a skeleton represents, in the order of argwhere.

    Half of the distance to each neighbour along the axes, and to each diagonal neighbour with
    which the pixel shares no neighbour along the axes.
    """
    padded = np.pad(skeleton, 1)
    total = np.zeros(padded.shape)
    for axis in (0, 1):
        for step in (-1, 1):
            total += 0.5 * np.roll(padded, step, axis)
    for i in (-1, 1):
        for j in (-1, 1):
            corner = np.roll(padded, (i, j), (0, 1))
            common = np.roll(padded, i, 0) | np.roll(padded, j, 1)
            total += 0.5 * math.sqrt(2) * (corner & ~common)
    lengths: NDArray[np.float64] = total[1:-1, 1:-1][skeleton]
    return lengths
