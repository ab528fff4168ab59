"""Errors that a user sees, and the exit codes of the command line."""

from enum import IntEnum


class ExitCode(IntEnum):
    """What a command returns to the shell."""

    DONE = 0
    FILE_ERROR = 1
    """A file could not be read or written, or was damaged."""
    BAD_INPUT = 2
    STOPPED = 3
    """The run-time guard stopped the run."""
    UNWRITABLE = 4
    """A run could no longer write its files."""
    MEMBERS_MISSING = 5
    """Members of an ensemble did not finish."""
    HUNG_UP = 129
    """The terminal was closed."""
    INTERRUPTED = 130
    TERMINATED = 143


class SceneError(ValueError):
    """A scene that cannot be run; ``str(error)`` is the one line that the user reads."""

    def __init__(self, message: str) -> None:
        # names of keys, files and tables are the user's: they may hold line breaks, or megabytes
        printable = "".join(c if c.isprintable() else " " for c in message[:2000])
        line = " ".join(printable.split())
        super().__init__(line if len(line) <= 1000 else f"{line[:996]} ...")


class DamagedFile(SceneError):
    """A file of a run that is damaged or was edited; ``str(error)`` names it and what is wrong."""


class SceneNote(UserWarning):
    """A change that was made to a scene so that an override fits; one line for the user."""


class SimulationStopped(RuntimeError):
    """The guard stopped the run; ``str(error)`` names time, step, place and likely cause."""


class TooManyNodes(RuntimeError):
    """More nodes near a rigid body than its list holds."""
