"""SIGINT, SIGTERM and SIGHUP are recorded when they arrive and handled between two steps."""

import contextlib
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from taichi_ldem.errors import ExitCode
from taichi_ldem.scenarios.child import tied

HANG_UP: int | None = getattr(signal, "SIGHUP", None)
"""What a terminal sends when it closes; Windows has no such signal."""

WORDS = {
    ExitCode.INTERRUPTED: "interrupted",
    ExitCode.TERMINATED: "terminated",
    ExitCode.HUNG_UP: "hung up",
}
"""What is said of the signals that end a run; a shell adds 128 to a signal's number."""


class Signalled(Exception):
    """SIGINT, SIGTERM or SIGHUP has arrived; ``number`` says which."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def _heard() -> list[int]:
    """The signals that end a run; SIGHUP is none where the caller has it ignored, as nohup does."""
    heard: list[int] = [signal.SIGINT, signal.SIGTERM]
    if HANG_UP is not None and signal.getsignal(HANG_UP) is not signal.SIG_IGN:
        heard.append(HANG_UP)
    return heard


@contextlib.contextmanager
def signals_call(function: Callable[[int], None]) -> Iterator[None]:
    """Let the signals that end a run call a function with their number; only in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handler(number: int, _frame: Any) -> None:
        function(number)

    old = {number: signal.signal(number, handler) for number in _heard()}
    try:
        yield
    finally:
        for number, before in old.items():
            signal.signal(number, before)


def run_child(command: Sequence[str], **streams: Any) -> int:
    """Run a command to its end, and return its exit code.

    Signals that end a run go to the child, which gets the time to write its checkpoint. It has a
    session of its own, so that what a terminal sends reaches it once, and ends when this process
    does, however that ends (Linux).

    Raises:
        Signalled: such a signal has come; the child has ended.
    """
    received: list[int] = []
    with subprocess.Popen(tied(command), start_new_session=True, **streams) as child:

        def pass_on(number: int) -> None:
            received.append(number)
            child.send_signal(number)

        with signals_call(pass_on):
            code = child.wait()
    if received:
        raise Signalled(received[0])
    return code


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
