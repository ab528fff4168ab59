"""Signals that end a run: which are heard, and that a child gets the time to end."""

import os
import signal
import sys
from collections.abc import Iterator

import pytest

from taichi_ldem.errors import ExitCode
from taichi_ldem.scenarios.interrupts import WORDS, Interrupts, Signalled, run_child, signals_call


@pytest.fixture
def hang_up() -> Iterator[None]:
    before = signal.getsignal(signal.SIGHUP)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.usefixtures("hang_up")
def test_a_signal_is_noted_and_answered_between_two_steps(number: signal.Signals) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    interrupts = Interrupts()
    with interrupts.noted():
        interrupts.answer()
        os.kill(os.getpid(), number)
        with pytest.raises(Signalled) as signalled:
            interrupts.answer()
    assert signalled.value.number == number
    assert WORDS[ExitCode(128 + number)]


@pytest.mark.usefixtures("hang_up")
def test_a_hang_up_that_the_caller_ignores_stays_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # what nohup does
    heard: list[int] = []
    with signals_call(heard.append):
        os.kill(os.getpid(), signal.SIGHUP)
    assert heard == []
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_a_child_gets_the_signal_once_and_the_time_to_end() -> None:
    """`ldem paper` and series of runs: the run that is going on takes its checkpoint."""
    code = (
        "import os, signal, sys, time\n"
        "got = []\n"
        "signal.signal(signal.SIGTERM, lambda *_: got.append(1))\n"
        "os.kill(os.getppid(), signal.SIGTERM)\n"
        "while not got: time.sleep(0.01)\n"
        "time.sleep(0.05)\n"
        "sys.exit(0 if got == [1] else 1)\n"
    )
    with pytest.raises(Signalled) as signalled:
        run_child([sys.executable, "-S", "-c", code])
    assert signalled.value.number == signal.SIGTERM
    assert run_child([sys.executable, "-S", "-c", "raise SystemExit(3)"]) == 3
