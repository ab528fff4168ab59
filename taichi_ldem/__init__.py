"""Lattice discrete element method (LDEM) for brittle plates under impact, on Taichi.

``Scene``, ``SceneError``, ``Simulation``, ``run`` and ``open_run`` are imported when they are first
used, Taichi with the first simulation: importing the package is quick.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichi_ldem.api import Simulation, open_run, run
    from taichi_ldem.errors import SceneError
    from taichi_ldem.scene import Scene

__version__ = "0.1.0"

__all__ = ["Scene", "SceneError", "Simulation", "__version__", "open_run", "run"]

_HOME = {
    "Scene": "taichi_ldem.scenarios.registry",  # which makes all scenarios known to scene files
    "SceneError": "taichi_ldem.errors",
    "Simulation": "taichi_ldem.api",
    "open_run": "taichi_ldem.api",
    "run": "taichi_ldem.api",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'taichi_ldem' has no attribute '{name}'")
    from importlib import import_module

    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
