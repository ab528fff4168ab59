"""Plates of other sizes, and the bytes that a step has to move: arithmetic, nothing is run."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taichi_ldem.scene import Scene
    from taichi_ldem.solver.lanes import Lanes

SIZES = (15, 30, 60, 174, 485)
"""Modules along the sides of square plates of six modules: 20 k, 79 k, 310 k, 2.6 M, 20 M bars."""

COMPONENTS = 6
"""Displacement or velocity: three of a corner and three of a centre node."""


def scaled(scene: "Scene", modules: int) -> list[str]:
    """Settings that give a scene's square plate another number of modules along its sides.

    Striker and rings keep their share of the plate's side; thickness and modules stay.
    """
    plate, clamp, striker = scene.plate, scene.clamp, scene.striker
    side, factor = modules * plate.spacing, modules / plate.modules[0]
    changes = [f"plate.size=[{side!r}, {side!r}, {plate.size[2]!r}]"]
    if clamp is not None:
        for key in ("inner_diameter", "outer_diameter"):
            changes.append(f"clamp.{key}={factor * getattr(clamp, key)!r}")
    if striker is not None:
        changes.append(f"striker.diameter={factor * striker.diameter!r}")
    return changes


def step_bytes(sites: tuple[int, int, int], lanes: "Lanes", item: int, history: bool) -> int:
    """Bytes that a step moves between memory and processor, from the layout.

    Displacement is read once, with its ghosts and the columns repeated for other lanes; velocity is
    read and written; the other displacement buffer is written, and fetched before (write-allocate);
    a byte a site is read, and with a history a flag a column. Bar scalars are taken to stay in
    cache. Contact, sampling and the history itself, touched only where bars are damaged, are left
    out.

    Args:
        sites: (nz + 3, ny + 3, nx + 3).
        item: bytes of a number.
    """
    nz, ny, _ = sites
    owned = (nz - 2) * (ny - 2) * lanes.length
    read = nz * ny * lanes.columns * lanes.width * COMPONENTS * item
    flags = owned * (lanes.width + history)
    # velocity in and out, other displacement fetched and out
    return read + flags + owned * lanes.width * COMPONENTS * item * 4


def passes_bytes(sites: tuple[int, int, int], item: int) -> int:
    """Bytes that whole passes move beyond ``step_bytes``: bar scalars, written once, read once.

    What a GPU reads twice (the displacement, in both passes) makes up for what it does not fetch
    before it writes.
    """
    nz, ny, nx = sites
    return 2 * 14 * item * (nz - 2) * (ny - 2) * (nx - 2)
