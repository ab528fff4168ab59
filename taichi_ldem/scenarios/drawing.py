"""Type of the function that draws a run's figures, which its caller passes on.

Scenarios import neither Matplotlib nor the package ``output``.
"""

from pathlib import Path
from typing import Any, Protocol

from taichi_ldem.storage.folder import RunFolder


class Draw(Protocol):
    """Draws the figures of a run, which its registry entry names, into the run's folder."""

    def __call__(self, folder: RunFolder, *, pictures: bool, data: Any = None) -> list[Path]:
        """Draw and return the files written.

        Args:
            folder: holds the run's files, the summary included if the run has finished.
            pictures: draw the deformed and cracked plate, too, which takes longer.
            data: what the figures need and the files do not hold, e.g. ``modes.Shapes``.
        """
