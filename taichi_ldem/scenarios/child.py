"""Replaces itself by another program that ends when its parent does (Linux).

``python -m taichi_ldem.scenarios.child PARENT WORD...``: when the thread that started this process
ends, for whatever reason, the kernel sends SIGTERM, on which a run writes a checkpoint and ends.
The setting survives ``exec``. On other systems the program is only started.
"""

import ctypes
import os
import signal
import sys
from collections.abc import Sequence

PR_SET_PDEATHSIG = 1


def tied(command: Sequence[str]) -> list[str]:
    """A command that ends when this thread does."""
    return [sys.executable, "-m", "taichi_ldem.scenarios.child", str(os.getpid()), *command]


def die_with(parent: int) -> None:
    """Have SIGTERM sent to this process when its parent ends; exit if it has ended already."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it ended before prctl was called
        sys.exit(128 + signal.SIGTERM)


if __name__ == "__main__":
    die_with(int(sys.argv[1]))
    os.execvp(sys.argv[2], sys.argv[2:])
