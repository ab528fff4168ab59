"""``ldem paper``: every figure and table of the paper that is a result, recomputed, in its order.

``runs`` lists the run folders and the commands that make them, ``items`` the figures and tables and
the runs that they need. Each run is a process of its own and is resumed from its checkpoint. The
numbers come from run folders only; the paper's come from ``analysis.paper``.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from taichi_ldem.errors import DamagedFile, ExitCode, SceneError
from taichi_ldem.reading import read_json
from taichi_ldem.reproduction.items import chosen
from taichi_ldem.reproduction.page import write
from taichi_ldem.reproduction.runs import conduct
from taichi_ldem.reproduction.sections import Context
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.place import refuse_moved


def reproduce(
    out: Path,
    *,
    quick: bool = False,
    resume: bool = False,
    only: str | None = None,
    tell: Callable[[str], None] = print,
) -> int:
    """Carry out the runs that the items need and write ``paper.md`` with pictures into a folder.

    Args:
        quick: coarser lattices, for a first look.
        resume: continue in a folder that was begun.
        only: keys of items, separated by commas; None: all items.
        tell: is called with a line on each run.

    Returns:
        An exit code: whether all runs ended as they should.

    Raises:
        SceneError: this is no checkout, the folder was begun and ``resume`` is not given, or there
            is no such item.
        OSError: the folder was renamed while a run was going on, which keeps its own folder.
    """
    items = chosen(only)
    if not Path("configs/impact.toml").is_file():
        raise SceneError("ldem paper: run it in a checkout: there is no configs/impact.toml here")
    state = out / "paper.json"
    kind = {"quick": quick}
    if state.exists():
        if not resume:
            raise SceneError(f"'{out}' holds results; --resume goes on, --out takes another folder")
        if read_json(state) != kind:
            raise SceneError(f"'{out}' was begun {'without' if quick else 'with'} --quick")
    with RunFolder.held(out):
        write_whole(state, (json.dumps(kind) + "\n").encode())
        names = dict.fromkeys(name for item in items for name in item.needs)
        failed = conduct(list(names), out, quick=quick, resume=resume, tell=tell)
        refuse_moved(out)
        page = write(items, Context(out), failed, quick)
        write_whole(out / "paper.md", page.text.encode())
    tell(str(out / "paper.md"))
    if page.damaged:
        raise DamagedFile("; ".join(page.damaged))
    return ExitCode.MEMBERS_MISSING if failed else ExitCode.DONE
