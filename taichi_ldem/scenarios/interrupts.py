"""SIGINT and SIGTERM are recorded when they arrive and handled between two steps."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any


class Signalled(Exception):
    """SIGINT or SIGTERM has arrived; ``number`` says which."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextlib.contextmanager
def signals_call(function: Callable[[int], None]) -> Iterator[None]:
    """Let SIGINT and SIGTERM call a function with their number; only in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handler(number: int, _frame: Any) -> None:
        function(number)

    old = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, before in old.items():
            signal.signal(number, before)


class Interrupts:
    """Records the first signals; a second SIGINT raises KeyboardInterrupt at once."""

    def __init__(self) -> None:
        self.number: int | None = None

    @contextlib.contextmanager
    def noted(self) -> Iterator[None]:
        """Record signals instead of ending the process."""
        with signals_call(self._note):
            yield

    def _note(self, number: int) -> None:
        self.number = number
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def answer(self) -> None:
        """Raise ``Signalled`` where a signal has been recorded."""
        if self.number is not None:
            raise Signalled(self.number)
