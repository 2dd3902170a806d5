"""Errors that reach a user as one line: what was given, what was expected, what to do."""

import contextlib
import difflib
import errno
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mjbench.status import ExitCode, Status

# What the operating system says when the machine, or a limit of this process, is used up.
_EXHAUSTED = (
    *(errno.EMFILE, errno.ENFILE, errno.ENOSPC, errno.EDQUOT, errno.EAGAIN, errno.ENOMEM),
    *(errno.EIO, errno.EFBIG),
)
# The packages that mjbench computes with, and what each of them certainly has.
_ATTRIBUTES = {"mujoco": "MjModel", "numpy": "ndarray"}


class MjbenchError(Exception):
    """A failure that is reported in one line; `exit_code` is what the command ends with."""

    exit_code = ExitCode.ENVIRONMENT
    status = Status.FAILED


class InputError(MjbenchError):
    """Bad usage or bad input (exit code 2): a wrong name, a broken file, an impossible size."""

    exit_code = ExitCode.USAGE
    status = Status.INPUT


def wrong_argument(name: str, value: object, expected: str) -> InputError:
    return InputError(f"{name} must be {expected}, not {one_line(repr(value), 60)}")


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


# How Python and MuJoCo say that a model cannot be compiled.
_REFUSED = ("ValueError: XML Error: ", "ValueError: Error: ")
# How MuJoCo says that a step needs more memory than a model reserves, and what helps.
_ARENA_FULL = "mj_stackAlloc: out of memory"
_ARENA_HELP = (
    'the model reserves too little memory; raise <size memory="…"/>, and where many bodies have no'
    ' joint, merge them: <compiler fusestatic="true"/>'
)


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
    if line := foreign_module(error):
        return Failure(Status.FAILED, line)
    text = describe(error)
    return Failure(Status.INPUT if is_of_model(text) else Status.FAILED, text)


def is_of_model(text: str) -> bool:
    """Return whether an exception's type and message say that MuJoCo refuses a model."""
    return _ARENA_FULL in text or text.startswith(_REFUSED)


def with_help(text: str) -> str:
    """Return an engine's message, with what helps where a model has too little memory."""
    return f"{text.partition(' max = ')[0]}: {_ARENA_HELP}" if _ARENA_FULL in text else text


def describe(error: BaseException) -> str:
    """Return an exception's type and message in one line, whatever its message is."""
    name = type(error).__name__
    try:
        message = one_line(error)
    except Exception:  # an exception of the user's own whose __str__ raises
        message = ""
    return with_help(f"{name}: {message}") if message else name


def describe_unforeseen(error: Exception) -> str:
    """Return an unforeseen error in one line, and write its traceback to a file that it names.

    A module that cannot be imported, memory that is short and what the operating system refuses
    are the environment's fault; anything else is a defect of mjbench.
    """
    if line := _exhausted(error) or foreign_module(error):
        return line
    is_defect = False
    backend = os.environ.get("MUJOCO_GL")
    match error:
        case _ if backend and _is_of_rendering(error):
            return (
                f"MuJoCo cannot load the rendering library of MUJOCO_GL={one_line(backend, 30)}"
                f" ({describe(error)}); install it, or unset MUJOCO_GL"
            )
        case ImportError():
            line = f"cannot import {error.name or 'a module'}: {one_line(error)}"
        case OSError():
            line = one_line(error)
        case _:
            line, is_defect = f"unexpected {describe(error)}", True
    file = _write_details(error)
    if file is None:
        return line
    return f"{line}; {'please report it with the ' if is_defect else ''}details in {file}"


def foreign_module(error: BaseException) -> str:
    """Return which file is imported in the place of MuJoCo or NumPy, in one line.

    It is empty unless that is why `error` was raised: the file raised it, or lacks what is needed.
    """
    import importlib.machinery
    import traceback

    raising = {frame.filename for frame in traceback.extract_tb(error.__traceback__)}
    raising.add(str(getattr(error, "filename", "")))  # of a SyntaxError
    for name, attribute in _ATTRIBUTES.items():
        module = sys.modules.get(name)
        if hasattr(module, attribute):
            continue
        spec = importlib.machinery.PathFinder.find_spec(name)
        file = spec and (spec.origin or next(iter(spec.submodule_search_locations or ()), None))
        is_lacking = module is not None and isinstance(error, AttributeError | ImportError)
        if file and (is_lacking or file in raising) and not _is_installed(name, file):
            return (
                f"{one_line(file)} is imported in the place of the package {name}: rename it, or"
                " take its folder off the path of Python (PYTHONPATH)"
            )
    return ""


def _is_installed(package: str, file: str) -> bool:
    import importlib.metadata

    try:
        folder = importlib.metadata.distribution(package).locate_file(package)
    except importlib.metadata.PackageNotFoundError:
        return False
    return Path(file).is_relative_to(str(folder))


def _is_of_rendering(error: BaseException) -> bool:
    import traceback

    files = (frame.filename for frame in traceback.extract_tb(error.__traceback__))
    return any("gl_context" in file or "/OpenGL/" in file for file in files)


def _exhausted(error: BaseException | None) -> str:
    """Return what the machine ran out of, in one line; empty if an error has another cause."""
    while error is not None:
        if isinstance(error, MemoryError):
            return "out of memory"
        if isinstance(error, OSError) and error.errno in _EXHAUSTED:
            return one_line(error)
        error = error.__cause__ or error.__context__
    return ""


def _write_details(error: Exception) -> str | None:
    """Write an error's traceback to a new file; return its name, or None where none can be."""
    import tempfile
    import traceback

    details = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile(
            "w",
            prefix="mjbench-error-",
            suffix=".txt",
            delete=False,
            encoding="utf-8",
            errors="backslashreplace",
        ) as file:
            file.write(details)
    except OSError:
        return None
    return file.name


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


def file_argument(name: str) -> str:
    """Return a file's name for a command line, where one that begins with a dash is an option."""
    return f"./{name}" if name.startswith("-") else name


def suggestion(word: str, choices: Iterable[str]) -> str:
    """Return a hint such as ` (did you mean rollout?)`, or nothing where no choice is similar."""
    similar = difflib.get_close_matches(word, list(choices))
    return f" (did you mean {', '.join(similar)}?)" if similar else ""
