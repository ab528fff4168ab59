"""Starts Taichi, without its banner on stdout. No other module starts it.

This is also the only module that touches private parts of Taichi: what another version or a fork of
it names otherwise has to be changed here alone.
"""

import contextlib
import ctypes
import functools
import inspect
import os
import sys
import tempfile
import textwrap
import threading
import time
from collections.abc import Iterator, Mapping
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
    _flush()
    try:
        saved = os.dup(1)
    except OSError:  # closed: native code prints to nothing already
        yield
        return
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 1)
        yield
    finally:
        _flush()
        os.dup2(saved, 1)
        os.close(saved)
        os.close(sink)


def _flush() -> None:
    # under pythonw there is no stdout, and a reader of it may have gone
    with contextlib.suppress(AttributeError, OSError, ValueError):
        sys.stdout.flush()


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


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Around the first kernels of a scene: says in one line what Vulkan's compiler cannot do.

    Raises:
        SceneError: Taichi 1.7.4 fails on some kernels that it compiles for LLVM ("Value does not
            yet exist"), such as those of modules' volumes.
    """
    try:
        yield
    except RuntimeError as error:
        if "spirv" not in str(error):
            raise
        raise SceneError(
            'solver.arch = "vulkan": Taichi cannot compile this scene for Vulkan; use "cpu" or '
            f'"cuda" ({" ".join(str(error).split())})'
        ) from None


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


class _TextWrap:
    """In place of the module ``textwrap`` in Taichi: lines of functions are not wrapped again.

    Taichi does it to replace tabs, which Python can read as they are.
    """

    dedent = staticmethod(functools.cache(textwrap.dedent))

    @staticmethod
    def fill(line: str, **_: Any) -> str:
        """The line without its end, as ``textwrap.fill`` leaves it."""
        return line.rstrip()


def _spare_taichi_work() -> None:
    """Make Taichi read the source of each function once.

    It finds and splits the source at every call of a function in a kernel, and replaces the tabs of
    every line, which takes half of the time in which a cached kernel starts.
    """
    from taichi.lang import kernel_impl
    from taichi.lang.ast import ast_transformer_utils

    ast_transformer_utils.ASTTransformerContext.get_pos_info = _place
    kernel_impl.textwrap = _TextWrap
    for name in ("getsourcelines", "getsourcefile"):
        if not hasattr(getattr(kernel_impl, name, None), "cache_info"):
            setattr(kernel_impl, name, functools.cache(getattr(inspect, name)))


@contextlib.contextmanager
def _environment() -> Iterator[None]:
    """The environment as Taichi bears it: with a home, and with nothing that overrules a scene.

    Taichi aborts the process without HOME (services, cron and containers have none) and where
    TI_ARCH names no device. It would also put TI_ARCH above ``solver.arch``. Where stdout is
    replaced it passes on what kernels print, at each call of a kernel, unless TI_ENABLE_PYBUF is 0.
    """
    changed = {"TI_ARCH": None, "TI_OFFLINE_CACHE_FILE_PATH": None, "TI_ENABLE_PYBUF": "0"}
    if not os.environ.get("HOME") and sys.platform != "win32":
        changed["HOME"] = _home()
    before = {name: os.environ.get(name) for name in changed}
    _set(changed)
    try:
        yield
    finally:
        _set(before)


def _set(variables: Mapping[str, str | None]) -> None:
    """Set variables of the environment; None: without it."""
    for name, value in variables.items():
        os.environ.pop(name, None)
        if value is not None:
            os.environ[name] = value


def _home() -> str:
    """The user's folder as the system knows it; a folder for temporary files without one."""
    try:
        return str(Path.home())
    except RuntimeError:  # a number of a user that has no name, as in containers
        return tempfile.gettempdir()


def _cache_folder(wanted: Path) -> Path:
    """Where Taichi's cache goes: without a folder that it can write, Taichi ends with a fault.

    Raises:
        SceneError: neither the wanted folder nor one for temporary files can be written.
    """
    if _writable(wanted):
        return wanted
    own = Path(tempfile.gettempdir(), f"taichi_ldem_cache_{getattr(os, 'getuid', int)()}")
    # kernels are executed: nobody else may have put some there
    if _writable(own) and (not hasattr(os, "getuid") or own.lstat().st_uid == os.getuid()):
        return own
    raise SceneError(
        f"cannot write Taichi's cache to '{wanted}': set TI_OFFLINE_CACHE_FILE_PATH to a folder"
    )


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


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
    depend. On the CPU, Taichi's pass that forwards stores to loads along the control flow stays
    off, too: it takes two thirds of the time of compilation, and LLVM does most of it again. The
    bits are the same without it (see ``compile_carefully``).

    Raises:
        SceneError: the backend is missing, or has no f64.
    """
    _refuse_absent(solver)
    options: dict[str, Any] = {"cpu_max_num_threads": solver.threads} if solver.threads else {}
    if not _initialise(solver.arch, solver.precision, options):
        raise SceneError(f'solver.arch = "{solver.arch}": no such device here; use "cpu"')


def start_for_pictures() -> None:
    """Import and initialise Taichi where it draws and computes nothing."""
    _initialise("cpu", "f32", {})


def _initialise(wanted: str, precision: str, options: dict[str, Any]) -> bool:
    """Import and initialise Taichi; False where it has taken another device than the wanted one."""
    given = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH")
    with _silent_stdout(), _environment():
        import taichi as ti

        _spare_taichi_work()
        cache = _cache_folder(Path(given or ti.lang.impl.default_cfg().offline_cache_file_path))
        _free_cache(cache)
        # not ti.gpu, which also looks for Vulkan and may abort in its driver
        arch = {"cpu": ti.cpu, "vulkan": ti.vulkan}.get(wanted, ti.cuda)
        real = ti.f64 if precision == "f64" else ti.f32
        options = {"arch": arch, "default_fp": real, "default_ip": ti.i32, **options}
        options["offline_cache_file_path"] = str(cache)
        if arch == ti.cpu:
            options["cfg_optimization"] = False
        if hasattr(ti.lang.impl.default_cfg(), "compile_tier"):
            options["compile_tier"] = "full"  # of taichi-forge, whose default steps 20 times slower
        try:
            ti.init(fast_math=False, log_level=ti.ERROR, **options)
        except ValueError as error:  # a variable such as TI_DEBUG that is no number
            raise SceneError(f"a variable TI_... of the environment: {error}") from None
        return bool(ti.lang.impl.current_cfg().arch == arch)


def compile_carefully(wanted: bool) -> None:
    """Compile the kernels to come with the pass that ``start`` leaves out, on the CPU.

    In f64 it takes 4 % off a step of a large plate, and doubles the time to compile.
    """
    import taichi as ti

    if configuration().arch in (ti.x64, ti.arm64):
        configuration().cfg_optimization = wanted


def configuration() -> Any:
    """The configuration that Taichi runs with: its ``arch``, ``cpu_max_num_threads`` and so on."""
    import taichi as ti

    return ti.lang.impl.current_cfg()


def default_float() -> Any:
    """Taichi's type of a number without another one."""
    import taichi as ti

    return ti.lang.impl.get_runtime().default_fp


def numpy_type(kind: Any) -> Any:
    """NumPy's type for one of Taichi's."""
    import taichi as ti

    return ti.lang.util.to_numpy_type(kind)
