"""The command line: a command for each scenario, and those of the other modules of this package.

No physics here. Heavy modules are imported inside the commands, Taichi only once the scene and the
run folder have been accepted, so that help and refusals are quick.
"""

import sys
from collections.abc import Sequence
from typing import Any

import typer

from taichi_ldem.cli import ensemble, gallery, notes, paper, run, show, study
from taichi_ldem.errors import DamagedFile, ExitCode, SceneError
from taichi_ldem.scenarios.interrupts import WORDS, Signalled
from taichi_ldem.streams import courteous

# Typer's own copy of Click's class, or Click's: it depends on Typer's version
UsageError: Any = typer.BadParameter.__mro__[1]


def make_app() -> typer.Typer:
    """The program with all its commands."""
    made = typer.Typer(
        help="Lattice discrete elements for brittle plates under impact.",
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    made.add_typer(study.app, name="study")
    for group in (run, ensemble, show, paper, gallery):
        group.register(made)
    return made


app = make_app()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code, which ``errors.ExitCode`` lists.

    An error is one line on stderr. Where nobody reads what it prints, a command goes on.
    """
    with courteous():
        return _run(list(sys.argv[1:] if arguments is None else arguments))


def _run(arguments: list[str]) -> int:
    try:
        # outside of its standalone mode Typer returns the code of typer.Exit
        with notes.printed():
            return int(app(arguments or ["--help"], "ldem", standalone_mode=False) or 0)
    except UsageError as error:
        message = " ".join(error.format_message().split())
        return _complain(message + _hint(error), ExitCode.BAD_INPUT)
    except typer.Abort:
        return ExitCode.INTERRUPTED
    except Signalled as signalled:  # while a run of a study or of the paper was going on
        code = ExitCode(128 + signalled.number)
        print(f"{WORDS[code]}; what has been written is kept", file=sys.stderr)
        return code
    except DamagedFile as error:
        return _complain(str(error), ExitCode.FILE_ERROR)
    except SceneError as error:
        return _complain(str(error), ExitCode.BAD_INPUT)
    except OSError as error:
        return _complain(str(error), ExitCode.FILE_ERROR)


def _hint(error: Any) -> str:
    """How to set a key of the scene whose name was given as an option."""
    option, context = getattr(error, "option_name", None), getattr(error, "ctx", None)
    options = [name for p in context.command.params for name in p.opts] if context else []
    if not option or "--set" not in options:
        return ""

    from taichi_ldem.scene import key_for

    key = key_for(str(option))
    return f"; keys of the scene: --set {key or 'SECTION.KEY'}={'...' if key else 'VALUE'}"


def _complain(message: str, code: int) -> int:
    print(f"error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
