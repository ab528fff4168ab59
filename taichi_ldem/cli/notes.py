"""Notes on a scene, as the command line prints them."""

import contextlib
import sys
import warnings
from collections.abc import Iterator
from typing import Any

from taichi_ldem.errors import SceneNote


@contextlib.contextmanager
def printed() -> Iterator[None]:
    """Print every note (``SceneNote``) as a line on stderr, each once."""
    with warnings.catch_warnings():
        warnings.simplefilter("default", SceneNote)
        shown = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *where: Any) -> None:
            if issubclass(category, SceneNote):
                print(f"note: {message}", file=sys.stderr)
            else:
                shown(message, category, *where)

        warnings.showwarning = show  # type: ignore[assignment]
        yield
