"""How the errors that end a measurement are reported: as a status, and one line."""

from mjbench.errors import Failure, InputError, MachineError, failure_of
from mjbench.paired.time_limit import OutOfTimeError
from mjbench.status import Status

# What ends a measurement whose launches so far are worth keeping.
ENDING_ERRORS = (OutOfTimeError, InputError, MachineError, KeyboardInterrupt)


def ending_of(error: BaseException) -> Failure:
    """Return how a measurement ended; running out of time is no failure, but has a line."""
    if isinstance(error, OutOfTimeError):
        return Failure(Status.OK, str(error))
    if isinstance(error, KeyboardInterrupt):
        return Failure(Status.INTERRUPTED, "interrupted")
    return failure_of(error)
