"""Errors that reach a user as one line: what was given, what was expected, what to do."""

import contextlib
import difflib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mjbench.status import ExitCode, Status


class MjbenchError(Exception):
    """A failure that is reported in one line; `exit_code` is what the command ends with."""

    exit_code = ExitCode.ENVIRONMENT
    status = Status.FAILED


class InputError(MjbenchError):
    """Bad usage or bad input (exit code 2): a wrong name, a broken file, an impossible size."""

    exit_code = ExitCode.USAGE
    status = Status.INPUT


class UnavailableError(InputError):
    """This machine, this MuJoCo or this model cannot do what was asked for."""

    status = Status.UNAVAILABLE


# Failures that are the user's to mend, by the status that a child process reports.
REFUSALS: Mapping[Status, type[InputError]] = {
    kind.status: kind for kind in (InputError, UnavailableError)
}


class MachineError(MjbenchError):
    """The machine or an installation failed (exit code 3): a full disk, a crash, a time limit."""


def reason(error: OSError | ValueError) -> str:
    """Return why a file cannot be read or written, without its name, which the caller names."""
    return (isinstance(error, OSError) and error.strerror) or one_line(error)


@contextlib.contextmanager
def writing(file: Path, remark: str = "") -> Iterator[None]:
    """Turn the refusal to write `file`, or a name that no file can have, into a MachineError."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise MachineError(f"cannot write {file}: {reason(error)}{remark}") from error


@dataclass(frozen=True)
class Failure:
    """How work failed: a status, and one line for people."""

    status: Status
    detail: str


def failure_of(error: BaseException) -> Failure:
    """Return the status and the line by which an exception is reported."""
    if isinstance(error, MjbenchError):
        return Failure(error.status, str(error))
    if isinstance(error, MemoryError):
        return Failure(Status.FAILED, "out of memory")
    return Failure(Status.FAILED, describe(error))


def describe(error: BaseException) -> str:
    """Return an exception's type and message in one line, whatever its message is."""
    name = type(error).__name__
    try:
        message = one_line(error)
    except Exception:  # an exception of the user's own whose __str__ raises
        message = ""
    return f"{name}: {message}" if message else name


def printable(text: object) -> str:
    r"""Return `text` with each character that cannot be printed as an escape such as `\x1b`.

    Names of files and models, messages of MuJoCo and texts in run files are somebody else's: a
    control character in them would change the terminal, a line break would forge a line of output.
    """
    line = str(text)
    if line.isprintable():
        return line
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def one_line(text: object, limit: int = 300) -> str:
    """Return `text` as a single printable line of at most `limit` characters."""
    line = printable(" ".join(str(text).split()))
    return line if len(line) <= limit else line[: limit - 1] + "…"


def shown(name: str) -> str:
    """Return a name that a user typed for a message: on one line, printable, at most 100 long."""
    return one_line(name if name.isprintable() and name.strip() else repr(name), 100)


def suggestion(word: str, choices: Iterable[str]) -> str:
    """Return a hint such as ` (did you mean rollout?)`, or nothing where no choice is similar."""
    similar = difflib.get_close_matches(word, list(choices))
    return f" (did you mean {', '.join(similar)}?)" if similar else ""
