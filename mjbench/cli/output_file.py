"""The file that a command writes: never an input, and only when the text for it is complete."""

import os
import sys
from collections.abc import Iterable
from pathlib import Path

import click

from mjbench.errors import InputError, MachineError, writing
from mjbench.host import files


class OutputFile:
    """A file that a command writes, or standard output; `open` comes first, `close` last."""

    def __init__(self, option: str, name: str | None, inputs: Iterable[Path]):
        """Take a name that a user gave.

        Raises:
          InputError: it is one of the inputs.
        """
        self._is_stdout = name == "-"
        self._file = None if name is None or self._is_stdout else Path(name)
        self._target = Path(_real(name or ""))  # where links lead
        self._partial: Path | None = None
        if self._file and str(self._target) in {_real(str(path)) for path in inputs}:
            raise InputError(f"{option} {name} is a file that this command reads: choose another")

    @property
    def is_wanted(self) -> bool:
        return self._is_stdout or self._file is not None

    def open(self) -> None:
        """Create the file under a temporary name, to see that it can be written.

        A device or a pipe is opened only when the text is complete.
        """
        if self._file is None:
            return
        with writing(self._file):
            if os.path.lexists(self._target):
                if self._is_special:
                    return
                self._target.open("ab").close()  # a folder, no permission, a loop of links
            self._partial = files.create_beside(self._target)

    def write(self, content: str) -> None:
        if self._file is None:
            if sys.stdout is None:
                raise MachineError("cannot write to standard output: it is closed")
            click.echo(content, nl=False)
            return
        with writing(self._file):
            if self._partial is None:
                self._target.write_bytes(content.encode())
                return
            self._partial.write_bytes(content.encode())
            files.put_in_place(self._partial, self._target)
            self._partial = None

    def close(self) -> None:
        """Remove what was not completed."""
        if self._partial is not None:
            self._partial.unlink(missing_ok=True)

    @property
    def _is_special(self) -> bool:
        """Whether the target is a device, a pipe or a socket, which must not be replaced."""
        return self._target.exists() and not (self._target.is_file() or self._target.is_dir())


def _real(name: str) -> str:
    """Return the path of a file without links; a name that no file can have, as it is."""
    try:
        return os.path.realpath(name)
    except ValueError:
        return name
