"""Errors that reach a user as one line: what was given, what was expected, what to do."""


class MjbenchError(Exception):
    """A failure told in one line; `exit_code` is what the command ends with."""

    exit_code = 3


class InputError(MjbenchError):
    """Bad usage or bad input (exit code 2): a wrong name, a broken file, an impossible size."""

    exit_code = 2


class MachineError(MjbenchError):
    """The machine or an installation failed (exit code 3): a full disk, a crash, a time limit."""

    exit_code = 3


def one_line(text: object, limit: int = 300) -> str:
    """Return `text` as a single line of at most `limit` characters."""
    line = " ".join(str(text).split())
    return line if len(line) <= limit else line[: limit - 1] + "…"


def told(error: Exception) -> tuple[str, str]:
    """Return how work that ended in `error` failed: its status, `input` or `failed`, and a line."""
    if isinstance(error, MjbenchError):
        return ("input" if error.exit_code == 2 else "failed"), str(error)
    if isinstance(error, MemoryError):
        return "failed", "out of memory"
    return "failed", f"{type(error).__name__}: {one_line(error)}"
