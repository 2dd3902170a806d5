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
    NEW = "new"
    """Only the candidate can do it, so there is nothing to compare it with."""
    INTERRUPTED = "interrupted"
    """The user stopped it."""


# Work that ended so is not done again when a run is continued; a failure may have a passing cause.
FINISHED = frozenset({Status.OK, Status.DISAGREES, Status.UNAVAILABLE, Status.INPUT, Status.NEW})


class ExitCode(IntEnum):
    """What a command ends with."""

    OK = 0
    FINDING = 1
    USAGE = 2
    ENVIRONMENT = 3
    NOT_BUILT = 4
    """A revision cannot be built, or what it needs cannot be installed."""
    OTHER_CODE = 5
    """The code that would have been measured is not the revision's."""
    NOTHING_COMPARED = 6
    """All that was to be compared is new."""
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
    if Status.INPUT in ended:
        return ExitCode.USAGE
    return ExitCode.NOTHING_COMPARED if ended == {Status.NEW} else ExitCode.OK
