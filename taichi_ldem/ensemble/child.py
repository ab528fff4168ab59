"""Becomes another program that ends with the process that started it (Linux).

``python -m taichi_ldem.ensemble.child PARENT WORD...``: the kernel sends SIGTERM, on which a run
takes a checkpoint and ends, when the thread that started this process is gone, however that ended.
The setting survives ``exec``. Elsewhere the program is just started.
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def die_with(parent: int) -> None:
    """Have SIGTERM sent to this process when its parent ends; exits where that has happened."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it ended before the kernel was told
        sys.exit(128 + signal.SIGTERM)


if __name__ == "__main__":
    die_with(int(sys.argv[1]))
    os.execvp(sys.argv[2], sys.argv[2:])
