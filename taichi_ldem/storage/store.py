"""Old place of what `folder`, `history` and `fields` hold now."""

from taichi_ldem.storage.fields import (
    BAR_NUMBERING,
    BrokenBars,
    Fields,
    FieldWriter,
    hexahedral_mesh,
    read_broken_bars,
    read_fields,
    read_times,
    write_vectors,
)
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter

__all__ = [
    "BAR_NUMBERING",
    "BrokenBars",
    "FieldWriter",
    "Fields",
    "HistoryWriter",
    "RunFolder",
    "hexahedral_mesh",
    "read_broken_bars",
    "read_fields",
    "read_times",
    "write_vectors",
]
