"""Bytes that a scene needs, estimated before it is built, and those that the machine has left."""

from __future__ import annotations

import functools
import math
import os

from taichi_ldem.errors import SceneError
from taichi_ldem.machine import addresses_left
from taichi_ldem.machine import available_bytes as available_bytes
from taichi_ldem.machine import peak_bytes as peak_bytes
from taichi_ldem.model.cell import CELLS
from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact import FRAGMENTS
from taichi_ldem.solver.contact.sizes import bytes_of
from taichi_ldem.solver.features import Features
from taichi_ldem.solver.fields import Layout, rows, suits_one_thread

BASE = 250e6
"""Bytes of the interpreter, Taichi's compiler and the libraries: 230 MB measured."""

ADDRESSES = 1.9e9
"""Bytes of addresses that a run reserves whatever its lattice: 1 GiB for Taichi, which never uses
them, and libraries. With them a small run takes 2.09 GB of addresses in all, 0.2 GB before."""

HOST = 20 * 48
"""Most bytes a site that NumPy and SciPy take: vectors of six f64 each, 18.7 measured. Eight are
the Lanczos basis of the critical time step, the rest its start, work space, results and copies."""


def _layout(scene: Scene) -> Layout:
    """How the lattice of a scene will lie in memory on this machine."""
    nx, ny, nz = (n + 3 for n in scene.plate.modules)
    real = 8 if scene.solver.precision == "f64" else 4
    threads = scene.solver.threads or os.cpu_count() or 1
    cell, alone = CELLS[scene.plate.lattice], suits_one_thread(scene)
    return Layout.fitting((nz, ny, nx), real, scene.solver.arch == "cpu", threads, cell, alone)


def field_bytes(scene: Scene) -> int:
    """Bytes of all fields of sites that a scene's lattice has, without bar scalars and tables."""
    layout = _layout(scene)
    return sum(row.bytes(layout) for row in rows(Features.of(scene), layout) if row.of_sites)


def _all_field_bytes(scene: Scene) -> int:
    """Bytes of all fields of a scene's lattice, and of the lists of pieces that may touch."""
    layout = _layout(scene)
    pieces = 0
    if FRAGMENTS.table(scene) is not None:
        pieces = bytes_of(scene.plate.modules, layout.cell.sublattices, layout.real_bytes)
    return _bytes(Features.of(scene), layout) + pieces


@functools.lru_cache(maxsize=64)  # the members of an ensemble are mostly alike in these
def _bytes(features: Features, layout: Layout) -> int:
    return sum(row.bytes(layout) for row in rows(features, layout))


def needed_bytes(scene: Scene) -> int:
    """Largest memory of a run, without the lists of nodes near rigid bodies, bytes."""
    sites = math.prod(n + 3 for n in scene.plate.modules)
    return int(BASE + _all_field_bytes(scene) + HOST * sites)


VULKAN_LIMIT = 2**32
"""Bytes of all fields together that Taichi reaches on Vulkan: it counts them in 32 bits, and beyond
that overwrites the first fields."""


def refuse_too_large(scene: Scene) -> None:
    """Raise SceneError where a scene's lattice does not fit into memory, or no run does."""
    fields = _all_field_bytes(scene)
    if scene.solver.arch == "vulkan" and fields >= VULKAN_LIMIT:
        raise SceneError(
            f'solver.arch = "vulkan": the lattice needs {fields:,} bytes, and Taichi can address '
            '4 GiB there; take fewer modules or "cuda" or "cpu"'
        )
    free, needed = _free_bytes(), needed_bytes(scene)
    if free is None or needed <= free:
        return
    nx, ny, nz = scene.plate.modules
    raise SceneError(
        f"plate.modules_through_thickness = {nz}: {nx} x {ny} x {nz} modules need about "
        f"{needed:,} bytes of memory, and {free:,} are available; take "
        f"{' or '.join(_remedies(scene, free, needed))}"
    )


def _free_bytes() -> int | None:
    """Bytes for a lattice and what every run takes; SceneError where not even that is left."""
    free, addresses = available_bytes(), addresses_left()
    if addresses is None:
        return free
    if addresses < ADDRESSES:
        raise SceneError(
            f"the limit of this shell leaves {addresses:,} bytes of addresses, and a run reserves "
            f"about {ADDRESSES:,.0f}: raise it (ulimit -v)"
        )
    rest = addresses - int(ADDRESSES - BASE)
    return rest if free is None else min(free, rest)


def _remedies(scene: Scene, free: int, needed: int) -> list[str]:
    """What would make a lattice fit into so many bytes."""
    layers = scene.plate.modules[2]
    share = max(0.0, (free - BASE) / (needed - BASE))
    fitting = max(1, int(layers * share ** (1 / 3)))
    found = [f"fewer modules (about {fitting})" if fitting < layers else "a smaller plate"]
    single = scene.solver.model_copy(update={"precision": "f32"})
    if needed_bytes(scene.model_copy(update={"solver": single})) <= free:
        found.append('solver.precision = "f32"')
    return found
