"""Tables and figures of an ensemble, written from its folder."""

from __future__ import annotations

from pathlib import Path

from taichi_ldem.ensemble.plan import RECORD, read_plan
from taichi_ldem.ensemble.results import read_rows, write_tables
from taichi_ldem.ensemble.table3 import write_table_3


def is_ensemble(folder: Path) -> bool:
    """Whether a folder holds an ensemble."""
    return (folder / RECORD).exists()


def report(folder: Path) -> list[Path]:
    """Write tables and figures anew; returns the files written.

    Raises:
        SceneError: the folder holds no ensemble, or a file in it cannot be read.
    """
    plan = read_plan(folder)
    rows = read_rows(plan, folder)
    from taichi_ldem.ensemble.figures import draw_all

    tables = write_tables(plan, folder, rows)
    return [*tables, *write_table_3(plan, folder, rows), *draw_all(folder, rows)]
