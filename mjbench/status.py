"""How a piece of work ended, and the exit code that stands for it.

Every row that mjbench prints or stores has a `Status`; a command ends with the exit code of the
worst one.
"""

from collections.abc import Iterable
from enum import IntEnum, StrEnum


class Status(StrEnum):
    """How a measurement, a comparison or a child process ended."""

    OK = "ok"
    DISAGREES = "disagrees"
    """Final states differ from the reference."""
    UNAVAILABLE = "unavailable"
    """This machine, this MuJoCo or this model cannot do it; the detail says why."""
    INPUT = "input"
    """The user's input is wrong: a broken model, an impossible size."""
    FAILED = "failed"
    """An error of the machine, the installation or the code."""
    CRASHED = "crashed"
    """The process was killed by a signal or exited by itself."""
    TIMEOUT = "timeout"
    """The process was silent for longer than its time limit, and was killed."""
    INTERRUPTED = "interrupted"
    """The user stopped it."""


# Work that ended so is not done again when a run is continued; a failure may have a passing cause.
FINISHED = frozenset({Status.OK, Status.DISAGREES, Status.UNAVAILABLE, Status.INPUT})


class ExitCode(IntEnum):
    """What a command ends with."""

    OK = 0
    FINDING = 1
    USAGE = 2
    ENVIRONMENT = 3
    INTERRUPTED = 130


def exit_code(statuses: Iterable[Status]) -> ExitCode:
    """Return the exit code of a command from the statuses of its rows: the worst one decides."""
    ended = set(statuses)
    if Status.INTERRUPTED in ended:
        return ExitCode.INTERRUPTED
    if Status.DISAGREES in ended:
        return ExitCode.FINDING
    if ended & {Status.CRASHED, Status.TIMEOUT, Status.FAILED}:
        return ExitCode.ENVIRONMENT
    return ExitCode.USAGE if Status.INPUT in ended else ExitCode.OK
