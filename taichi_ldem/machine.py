"""Facts about this computer that runs depend on: its processor and its memory."""

from __future__ import annotations

import contextlib
import functools
import os
import platform
import sys
from pathlib import Path


@functools.cache
def processor() -> dict[str, str]:
    """Properties of the first core as Linux lists them; empty on other systems."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return {}
    lines = (line.partition(":") for line in text.partition("\n\n")[0].splitlines())
    return {name.strip(): value.strip() for name, _, value in lines}


def processor_name(properties: dict[str, str] | None = None) -> str:
    """Name of the processor with family and model, because hypervisors shorten the name.

    Args:
        properties: of this machine's processor if they are not given.
    """
    if properties is None:
        properties = processor()
    shown = properties.get("model name") or platform.processor() or platform.machine()
    if "cpu family" not in properties:
        return shown
    return f"{shown} (family {properties['cpu family']}, model {properties.get('model', '?')})"


def available_bytes() -> int | None:
    """Bytes that can be taken without swapping, within the limits of a container or a job.

    None where the system does not say.
    """
    found = [_free_of_machine(), _free_of_group(Path("/sys/fs/cgroup")), addresses_left()]
    known = [size for size in found if size is not None]
    return min(known) if known else None


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


def addresses_left() -> int | None:
    """Bytes of addresses that `ulimit -v` leaves to this process; None without such a limit.

    They count where memory is only reserved, too.
    """
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            taken = int(Path("/proc/self/statm").read_text().split()[0])
            return max(limit - taken * resource.getpagesize(), 0)
    return None


def peak_bytes() -> int | None:
    """Largest resident memory of this process so far, bytes; None where the system does not say."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest if sys.platform == "darwin" else 1024 * largest
