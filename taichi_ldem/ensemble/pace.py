"""Work that grows with an ensemble, done so rarely that it takes a small share of the time."""

from __future__ import annotations

import time
from collections.abc import Callable


class Paced:
    """Calls a function when it is asked to, but leaves out calls that would take too much time.

    Tables of all members are written again after every attempt while the members are few. With many
    members this alone would grow with their square.

    Args:
        function: called without arguments.
        share: largest share of the time that its calls may take.
    """

    def __init__(self, function: Callable[[], None], share: float = 0.05) -> None:
        self._function, self._share = function, share
        self._due = 0.0

    def __call__(self) -> None:
        """Call the function, unless its last call was too long or too recent."""
        begun = time.monotonic()
        if begun < self._due:
            return
        self._function()
        ended = time.monotonic()
        self._due = ended + (ended - begun) * (1 / self._share - 1)
