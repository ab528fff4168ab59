"""The one place that starts Taichi, and keeps its banner off stdout."""

import contextlib
import os
import sys
from collections.abc import Iterator

from taichi_ldem.scene import SceneError, Solver


@contextlib.contextmanager
def _silent_stdout() -> Iterator[None]:
    """Send what native code prints to stdout nowhere."""
    sys.stdout.flush()
    saved = os.dup(1)
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 1)
        yield
        sys.stdout.flush()
    finally:
        os.dup2(saved, 1)
        os.close(saved)
        os.close(sink)


def start(solver: Solver) -> None:
    """Import and initialise Taichi for a scene; call it before any module with kernels is imported.

    ``fast_math`` stays off: it would drop the order of summation that reproducibility rests on.

    Raises:
        SceneError: the backend is not there, or cannot do the precision.
    """
    if solver.arch in ("vulkan", "metal"):
        raise SceneError(
            f'solver.arch = "{solver.arch}": gives wrong contact forces in this version; use "cpu" '
            'or "cuda"'
        )
    with _silent_stdout():
        import taichi as ti

        # not ti.gpu, which also looks for Vulkan and may abort in its driver
        arch = ti.cpu if solver.arch == "cpu" else ti.cuda
        real = ti.f64 if solver.precision == "f64" else ti.f32
        options = {"cpu_max_num_threads": solver.threads} if solver.threads else {}
        ti.init(arch=arch, default_fp=real, fast_math=False, log_level=ti.ERROR, **options)
        current = ti.lang.impl.current_cfg().arch
    if (current == ti.cpu) != (solver.arch == "cpu") or current not in (ti.cpu, ti.cuda):
        raise SceneError(f'solver.arch = "{solver.arch}": no CUDA device here; use "cpu"')
