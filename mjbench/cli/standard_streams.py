"""Standard output and standard error of a command: what cannot be written ends with exit code 3.

Every other code says something about what was measured: 1 is a finding.
"""

import contextlib
import io
import sys
from collections.abc import Iterator
from typing import Any

import click

from mjbench.status import ExitCode

# Handlers of encoding errors that fail on some characters.
_FAILING = ("strict", "surrogateescape", "surrogatepass")


class _ErrorFile(io.FileIO):
    """The file behind standard error; the work goes on where it cannot be written.

    Attributes:
      has_failed: whether something could not be written.
    """

    has_failed = False

    def write(self, data: Any) -> int:
        """Write bytes; where the file takes none, drop them."""
        with contextlib.suppress(OSError):
            written = super().write(data)
            if written is not None:  # a pipe that must not block is full
                return written
        self.has_failed = True
        return memoryview(data).nbytes


@contextlib.contextmanager
def checked() -> Iterator[None]:
    """Run a block that ends by SystemExit, with exit code 3 if its output could not be written."""
    # a character that the output's encoding lacks must not cost the table it stands in
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in _FAILING:
            stream.reconfigure(errors="backslashreplace")
    with _error_file() as file:
        try:
            yield
        except SystemExit as ending:
            _flush_output(is_failure=ending.code == ExitCode.ENVIRONMENT)
            if file is not None and file.has_failed:
                sys.exit(ExitCode.ENVIRONMENT)
            raise


@contextlib.contextmanager
def _error_file() -> Iterator[_ErrorFile | None]:
    """While the block runs, have standard error note what it cannot write; None if it is no file.

    All that writes there uses `sys.stderr`: errors of click and mjbench, progress, warnings.
    """
    stream: Any = sys.stderr
    buffer = getattr(stream, "buffer", None)
    if not isinstance(getattr(buffer, "raw", buffer), io.FileIO):
        yield None
        return
    file = _ErrorFile(stream.fileno(), "w", closefd=False)
    sys.stderr = io.TextIOWrapper(
        io.BufferedWriter(file), stream.encoding, stream.errors, line_buffering=True
    )
    try:
        yield file
    finally:
        sys.stderr.flush()
        sys.stderr = stream


def _flush_output(is_failure: bool) -> None:
    """Write out what standard output holds; end with exit code 3 where that fails."""
    try:
        sys.stdout.flush()
    except (AttributeError, ValueError):  # there is none, or it is closed
        pass
    except OSError as error:
        # a second attempt, when the interpreter ends, would fail as well
        sys.stdout = None
        if not (is_failure or isinstance(error, BrokenPipeError)):
            click.echo(f"mjbench: cannot write to standard output: {error.strerror}", err=True)
        sys.exit(ExitCode.ENVIRONMENT)
