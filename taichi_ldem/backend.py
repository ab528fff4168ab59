"""The one place that starts Taichi, and keeps its banner off stdout."""

import contextlib
import ctypes
import functools
import os
import sys
from collections.abc import Iterator
from textwrap import TextWrapper

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


def vulkan_device() -> bool:
    """Whether a Vulkan device exists, asked without Taichi, which aborts where there is none."""
    if sys.platform == "darwin":
        return True  # Taichi brings its own
    try:
        vulkan = ctypes.CDLL("vulkan-1.dll" if sys.platform == "win32" else "libvulkan.so.1")
    except OSError:
        return False
    # VkInstanceCreateInfo with only its type set, as eight pointer-sized slots
    request = (ctypes.c_size_t * 8)(1)
    instance, count = ctypes.c_void_p(), ctypes.c_uint32(0)
    if vulkan.vkCreateInstance(ctypes.byref(request), None, ctypes.byref(instance)):
        return False
    failed = vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    vulkan.vkDestroyInstance(instance, None)
    return not failed and count.value > 0


class _RememberingWrapper(TextWrapper):
    """TextWrapper that wraps a line once.

    Taichi wraps the source line of every node of every kernel for error messages that are never
    shown: a quarter of the start of a cached scene.
    """

    def wrap(self, text: str) -> list[str]:
        return _wrapped(text, self.width)


@functools.lru_cache(maxsize=100_000)
def _wrapped(text: str, width: int) -> list[str]:
    return TextWrapper(width=width).wrap(text)


def start(solver: Solver) -> None:
    """Import and initialise Taichi for a scene; call it before any module with kernels is imported.

    ``fast_math`` stays off: it would drop the order of summation that reproducibility rests on.

    Raises:
        SceneError: the backend is not there, or cannot do the precision.
    """
    if solver.arch == "metal":
        raise SceneError('solver.arch = "metal": has no f64, which contact sums need; use "cpu"')
    if solver.arch == "vulkan" and not vulkan_device():
        raise SceneError('solver.arch = "vulkan": no Vulkan device here; use "cpu"')
    with _silent_stdout():
        import taichi as ti
        from taichi.lang.ast import ast_transformer_utils

        ast_transformer_utils.TextWrapper = _RememberingWrapper
        # not ti.gpu, which also looks for Vulkan and may abort in its driver
        arch = {"cpu": ti.cpu, "vulkan": ti.vulkan}.get(solver.arch, ti.cuda)
        real = ti.f64 if solver.precision == "f64" else ti.f32
        options = {"cpu_max_num_threads": solver.threads} if solver.threads else {}
        ti.init(arch=arch, default_fp=real, fast_math=False, log_level=ti.ERROR, **options)
        current = ti.lang.impl.current_cfg().arch
    if current != arch:
        raise SceneError(f'solver.arch = "{solver.arch}": no such device here; use "cpu"')
