"""The files that a command writes: never inputs, and only when the text for them is complete."""

import os
import sys
from collections.abc import Iterable
from pathlib import Path

import click

from mjbench.commands.shared_options import OUTPUT_FILE
from mjbench.errors import InputError, MachineError, writing
from mjbench.host import files
from mjbench.options import options_of


class OutputFile:
    """A file that a command writes, or standard output; `open` comes first, `close` last."""

    def __init__(self, name: str):
        self.name, self.is_stdout = name, name == "-"
        self._file = None if self.is_stdout else Path(name)
        self._target = Path(_real(name))  # where links lead
        self._partial: Path | None = None

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


def of_options(options: object, inputs: Iterable[Path] = ()) -> dict[str, OutputFile]:
    """Return the files that a user named, by the flags of their options.

    Args:
      inputs: files that the command reads.

    Raises:
      InputError: one is an input, or two are the same.
    """
    taken = {_real(str(path)): "a file that this command reads" for path in inputs}
    output_files = {}
    for option in () if options is None else options_of(type(options)):
        name = getattr(options, option.name)
        if option.kind is not OUTPUT_FILE or name is None:
            continue
        flag, target = option.flags[0], name if name == "-" else _real(name)
        if target in taken:
            raise InputError(f"{flag} {name} is {taken[target]}: choose another")
        taken[target] = f"what {flag} writes, too"
        output_files[flag] = OutputFile(name)
    return output_files


def _real(name: str) -> str:
    """Return the path of a file without links; a name that no file can have, as it is."""
    try:
        return os.path.realpath(name)
    except ValueError:
        return name
