"""Starts Taichi, without its banner on stdout. No other module starts it."""

import contextlib
import ctypes
import functools
import os
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Solver

_STDOUT = threading.Lock()
"""Held while stdout is redirected: two redirections that overlap would lose it for good."""


@contextlib.contextmanager
def _silent_stdout() -> Iterator[None]:
    """Discard what native code prints to stdout; a second thread waits for the first."""
    with _STDOUT:
        yield from _redirected()


def _redirected() -> Iterator[None]:
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


STALE = 60.0
"""Age of a lock on Taichi's cache, s, from which its process is taken to have been killed."""

SHADER_FLOAT64 = 39
"""Place of the f64 entry among the 55 entries of VkPhysicalDeviceFeatures."""


def _vulkan_devices() -> list[bool]:
    """Whether each Vulkan device has f64; asked of Vulkan, as Taichi aborts without a device."""
    try:
        vulkan = ctypes.CDLL("vulkan-1.dll" if sys.platform == "win32" else "libvulkan.so.1")
    except OSError:
        return []
    # VkInstanceCreateInfo with only its type set, as eight pointer-sized slots
    request = (ctypes.c_size_t * 8)(1)
    instance, count = ctypes.c_void_p(), ctypes.c_uint32(0)
    if vulkan.vkCreateInstance(ctypes.byref(request), None, ctypes.byref(instance)):
        return []
    failed = vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices = (ctypes.c_void_p * count.value)()
    failed |= vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    found = []
    for device in [] if failed else devices:
        features = (ctypes.c_uint32 * 55)()
        vulkan.vkGetPhysicalDeviceFeatures(ctypes.c_void_p(device), features)
        found.append(features[SHADER_FLOAT64] != 0)
    vulkan.vkDestroyInstance(instance, None)
    return found


def vulkan_device() -> bool:
    """Whether a Vulkan device exists."""
    return sys.platform == "darwin" or bool(_vulkan_devices())  # Taichi ships one for macOS


def _refuse_absent(solver: Solver) -> None:
    """Raise SceneError where a backend is missing or has no f64."""
    arch = f'solver.arch = "{solver.arch}"'
    if solver.arch == "metal" or (solver.arch == "vulkan" and sys.platform == "darwin"):
        raise SceneError(f'{arch}: has no f64, which contact sums need; use "cpu"')
    if solver.arch == "vulkan":
        devices = _vulkan_devices()
        if not devices:
            raise SceneError(f'{arch}: no Vulkan device here; use "cpu"')
        if not any(devices):
            raise SceneError(f'{arch}: this device has no f64, which contact sums need; use "cpu"')


def _place(context: Any, node: Any) -> str:
    """Position of a node of a kernel for error messages: file, line, function and source.

    Taichi's own function formats the source line with marks for every node of every kernel, and
    hardly any of these texts is ever shown.
    """
    line = node.lineno + context.lineno_offset
    where = f'File "{context.file}", line {line}, in {context.func.func.__name__}:'
    return f"{where}\n{context.src[node.lineno - 1]}\n"


def _spare_taichi_work() -> None:
    """Make Taichi read the source of each function once.

    It finds and splits the source at every call of a function in a kernel, which takes half of the
    time in which a cached kernel starts.
    """
    from taichi.lang import kernel_impl
    from taichi.lang.ast import ast_transformer_utils

    ast_transformer_utils.ASTTransformerContext.get_pos_info = _place
    for name in ("getsourcelines", "getsourcefile"):
        if not hasattr(getattr(kernel_impl, name), "cache_info"):
            setattr(kernel_impl, name, functools.cache(getattr(kernel_impl, name)))


def _free_cache(folder: Path) -> None:
    """Remove locks left behind by a process that was killed while it wrote Taichi's cache.

    With such a lock Taichi never reads or writes its cache again. Writing takes seconds at most.
    """
    for lock in folder.glob("**/ticache.lock"):
        with contextlib.suppress(OSError):
            if time.time() - lock.stat().st_mtime > STALE:
                lock.unlink()


def start(solver: Solver) -> None:
    """Import and initialise Taichi for a scene, before any module with kernels is imported.

    ``fast_math`` stays off: it would change the order of summation, on which reproducible results
    depend.

    Raises:
        SceneError: the backend is missing, or has no f64.
    """
    _refuse_absent(solver)
    with _silent_stdout():
        import taichi as ti

        _spare_taichi_work()
        cache = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH")
        _free_cache(Path(cache or ti.lang.impl.default_cfg().offline_cache_file_path))
        # not ti.gpu, which also looks for Vulkan and may abort in its driver
        arch = {"cpu": ti.cpu, "vulkan": ti.vulkan}.get(solver.arch, ti.cuda)
        real = ti.f64 if solver.precision == "f64" else ti.f32
        options = {"cpu_max_num_threads": solver.threads} if solver.threads else {}
        ti.init(arch=arch, default_fp=real, fast_math=False, log_level=ti.ERROR, **options)
        current = ti.lang.impl.current_cfg().arch
    if current != arch:
        raise SceneError(f'solver.arch = "{solver.arch}": no such device here; use "cpu"')
