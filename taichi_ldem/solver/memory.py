"""Bytes that a scene needs, before any are taken, against those that the machine has."""

from __future__ import annotations

import contextlib
import math
import os
import sys
from pathlib import Path

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene
from taichi_ldem.solver.fields import Features, Layout, rows

BASE = 250e6
"""Bytes of the interpreter, Taichi's compiler and the libraries: 230 MB measured."""

HOST = 20 * 48
"""Bytes a site that NumPy and SciPy take at most: vectors of six f64 each, 18.7 measured. Eight are
the Lanczos basis of the critical time step, the rest its start, work space, results and copies."""


def _layout(scene: Scene) -> Layout:
    """How the lattice of a scene will lie in memory on this machine."""
    nx, ny, nz = (n + 3 for n in scene.plate.modules)
    real = 8 if scene.solver.precision == "f64" else 4
    threads = scene.solver.threads or os.cpu_count() or 1
    return Layout.fitting((nz, ny, nx), real, scene.solver.arch == "cpu", threads)


def field_bytes(scene: Scene) -> int:
    """Bytes of all fields of sites that a scene's lattice has, without bar scalars and tables."""
    layout = _layout(scene)
    return sum(row.bytes(layout) for row in rows(Features.of(scene), layout) if row.of_sites)


def _all_field_bytes(scene: Scene) -> int:
    """Bytes of all fields of a scene's lattice."""
    layout = _layout(scene)
    return sum(row.bytes(layout) for row in rows(Features.of(scene), layout))


def needed_bytes(scene: Scene) -> int:
    """Largest memory of a run, without the lists of nodes near rigid bodies, bytes."""
    sites = math.prod(n + 3 for n in scene.plate.modules)
    return int(BASE + _all_field_bytes(scene) + HOST * sites)


VULKAN_LIMIT = 2**32
"""Bytes of all fields together that Taichi reaches on Vulkan: it counts them in 32 bits, and beyond
that overwrites the first fields."""


def available_bytes() -> int | None:
    """Bytes that can be taken without swapping, within the limits of a container or a job.

    None where the system does not say.
    """
    found = [_free_of_machine(), _free_of_group(Path("/sys/fs/cgroup")), _limit_of_process()]
    known = [size for size in found if size is not None]
    return min(known) if known else None


def refuse_too_large(scene: Scene) -> None:
    """Raise SceneError where a scene's lattice does not fit into memory."""
    fields = _all_field_bytes(scene)
    if scene.solver.arch == "vulkan" and fields >= VULKAN_LIMIT:
        raise SceneError(
            f'solver.arch = "vulkan": the lattice needs {fields:,} bytes, Taichi reaches 4 GiB '
            'there; take fewer modules or "cuda" or "cpu"'
        )
    free, needed = available_bytes(), needed_bytes(scene)
    if free is None or needed <= free:
        return
    nx, ny, nz = scene.plate.modules
    fitting = max(1, int(nz * ((free - BASE) / (needed - BASE)) ** (1 / 3))) if free > BASE else 1
    raise SceneError(
        f"plate.modules_through_thickness = {nz}: {nx} x {ny} x {nz} modules need about "
        f"{needed:,} bytes of memory, {free:,} are available; take fewer modules (about {fitting}) "
        'or solver.precision = "f32"'
    )


def _free_of_machine() -> int | None:
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    with contextlib.suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return None


def _free_of_group(root: Path) -> int | None:
    """Bytes that a container's limit leaves (cgroup 2, then 1); caches count as free."""
    for limit, used, dropped in (
        ("memory.max", "memory.current", "inactive_file"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", "total_inactive_file"),
    ):
        with contextlib.suppress(OSError, ValueError):
            free = int((root / limit).read_text()) - int((root / used).read_text())
            for line in (root / limit).with_name("memory.stat").read_text().splitlines():
                name, _, value = line.partition(" ")
                free += int(value) if name == dropped else 0
            return max(free, 0)
    return None


def _limit_of_process() -> int | None:
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            taken = int(Path("/proc/self/statm").read_text().split()[0])
            return max(limit - taken * resource.getpagesize(), 0)
    return None


def peak_bytes() -> int | None:
    """Largest resident memory of this process so far, bytes; None where the system does not say."""
    if sys.platform == "win32":
        return None
    import resource

    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest if sys.platform == "darwin" else 1024 * largest
