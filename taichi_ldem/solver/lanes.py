"""How a row of sites along x lies in memory, so that one instruction works on several sites.

A row is cut into ``width`` equal pieces, one a lane. Column m holds the m-th site of every piece
side by side: neighbours along x are neighbouring columns of the same lanes, so a kernel that works
on whole columns reads and writes whole vector registers and never shuffles lanes. Pieces overlap:
HALO columns at either end repeat the neighbouring piece's sites.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.solver.processor import vector_bytes

HALO = 2
"""Columns repeated at either end. A bar of the inner one is evaluated again from its ends, which
lie one column further out."""


@dataclass(frozen=True)
class Lanes:
    """How one row is cut.

    Attributes:
        sites: number of sites of a row, including a ghost at either end.
        width: number of lanes.
    """

    sites: int
    width: int = 1

    @staticmethod
    def fitting(sites: int, item_bytes: int) -> "Lanes":
        """As many lanes as fill a register, while pieces overlap only with their neighbours."""
        width = vector_bytes() // item_bytes
        while width > 1 and -(-(sites - 2) // width) < 2 * HALO:
            width //= 2
        return Lanes(sites, width)

    @property
    def length(self) -> int:
        """Number of columns that a piece owns: HALO to HALO + length - 1."""
        return -(-(self.sites - 2) // self.width)

    @property
    def columns(self) -> int:
        """Number of columns stored."""
        return self.length + 2 * HALO

    def index(self) -> npt.NDArray[np.int64]:
        """(columns, width) the site of each place; sites beyond the row are clipped to ghosts."""
        column, lane = np.mgrid[: self.columns, : self.width]
        site = 1 + lane * self.length + column - HALO
        return np.asarray(site.clip(0, self.sites - 1), dtype=np.int64)

    def spread(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """(..., sites) values as (..., columns, width); ghosts are taken to be zero."""
        return values[..., self.index()]

    def gather(self, stored: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """(..., columns, width) stored values as (..., sites), from the columns that own them."""
        row = np.zeros((*stored.shape[:-2], self.sites), dtype=stored.dtype)
        owned = np.moveaxis(stored[..., HALO : HALO + self.length, :], -1, -2)
        inner = self.sites - 2
        row[..., 1:-1] = owned.reshape(*stored.shape[:-2], -1)[..., :inner]
        return row
