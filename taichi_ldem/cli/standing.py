"""A process that executes one command line after the other: ``python -m taichi_ldem.cli.standing``.

Each line of standard input is an order, a JSON object with the ``arguments`` of ``ldem`` and the
files that take what it prints, ``out`` and ``err``. Each line of standard output is the answer to
one: its exit code, or OTHER where a new process has to execute it. The simulation is kept from
order to order (``scenarios.workbench``). The process ends with its standard input, after an order
that was ended by a signal or an exception, and after an answer of OTHER.
"""

import contextlib
import json
import os
import sys
import traceback
from collections.abc import Iterator

from taichi_ldem.cli.app import main
from taichi_ldem.ensemble.standing import OTHER, SIGNALLED
from taichi_ldem.errors import ExitCode
from taichi_ldem.scenarios.workbench import WORKBENCH, NeedsOtherKernels

FAULT = "1"
"""The answer to an order that ended in an exception, as Python's exit code of a program."""


def serve() -> None:
    """Execute orders until there are no more."""
    WORKBENCH.keeps = True
    with open(os.dup(1), "w", encoding="utf-8") as answers, open(0, encoding="utf-8") as orders:
        for line in orders:
            order = json.loads(line)
            with _printed_to(order["out"], order["err"]):
                answer = _execute(order["arguments"])
            try:
                print(answer, file=answers, flush=True)
            except BrokenPipeError:  # whoever gave the order has been killed
                os._exit(int(ExitCode.TERMINATED))
            if answer in (OTHER, FAULT) or int(answer) >= SIGNALLED:
                return


def _execute(arguments: list[str]) -> str:
    """The answer to an order."""
    sys.argv = ["ldem", *arguments]  # the command that the run's provenance names
    try:
        return str(int(main(arguments)))
    except NeedsOtherKernels:
        return OTHER
    except BaseException:
        traceback.print_exc()
        return FAULT


@contextlib.contextmanager
def _printed_to(out: str, err: str) -> Iterator[None]:
    """Let descriptors 1 and 2 be files, to whose ends everything that is printed goes."""
    before = os.dup(1), os.dup(2)
    for number, path in ((1, out), (2, err)):
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(file, number)
        os.close(file)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        for number, kept in zip((1, 2), before, strict=True):
            os.dup2(kept, number)
            os.close(kept)


if __name__ == "__main__":
    serve()
