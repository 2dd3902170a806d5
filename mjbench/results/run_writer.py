"""Write a run file: create it, continue one that ended early, append a record to it.

A record is appended and flushed when its measurement ends. The file is locked while it is open.
"""

import contextlib
import itertools
import json
import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any, TextIO

from mjbench.errors import MachineError, reason, writing
from mjbench.host import files, platforms
from mjbench.results.runs import Record, RunHeader, as_stored, to_json

# The end of a message about a record that cannot be written.
EARLIER_IS_THERE = "; what was measured before is there"


class RunFile:
    """A run file that is being written."""

    def __init__(self, path: Path, file: TextIO):
        """Append to an open file; `create` and `rewrite` open one."""
        self.path, self._file = path, file

    @classmethod
    def create(cls, folder: Path, header: RunHeader) -> "RunFile":
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with contextlib.ExitStack() as on_error:
                path, file = _open_new(folder, header.command)
                on_error.callback(_discard, path, file)
                lock(file)
                _write_line(file, header)
                on_error.pop_all()
        except (OSError, ValueError) as error:
            raise MachineError(
                f"cannot write results to {folder}: {reason(error)};"
                " choose another folder with --results"
            ) from error
        return cls(path, file)

    @classmethod
    def rewrite(cls, path: Path, header: RunHeader, records: Iterable[Record]) -> "RunFile":
        """Replace a file by one with these records, for more to be appended.

        A reader sees either the file that was there before or the whole new one. Where that file
        holds more, it stays beside the new one, with `.bak` after its name.
        """
        path = path.resolve()
        with (
            writing(path),
            path.open("r+b") as earlier,
            files.replacing(path) as partial,
            contextlib.ExitStack() as on_error,
        ):
            lock(earlier)
            file = on_error.enter_context(partial.open("w", encoding="utf-8"))
            lock(file)
            for record in (header, *records):
                _write_line(file, record)
            if partial.read_bytes() != path.read_bytes():
                _link(path, path.with_name(f"{path.name}.bak"))
            on_error.pop_all()
        return cls(path, file)

    def append(self, record: Record) -> None:
        with writing(self.path, EARLIER_IS_THERE):
            _write_line(self._file, record)

    def close(self) -> None:
        """Close the file; `append` has already reported any failure to write."""
        with contextlib.suppress(OSError):
            self._file.close()


def _open_new(folder: Path, command: str) -> tuple[Path, TextIO]:
    stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime())
    name = f"{stamp}-{os.getpid()}-{command}"
    for further in itertools.count(2):
        path = folder / f"{name}.jsonl"
        try:
            return path, path.open("x", encoding="utf-8")
        except FileExistsError:  # this process began another one in the same second
            name = f"{stamp}-{os.getpid()}-{command}-{further}"
    raise AssertionError


def _link(path: Path, name: Path) -> None:
    name.unlink(missing_ok=True)
    try:
        name.hardlink_to(path)
    except OSError:  # a file system without hard links
        name.write_bytes(path.read_bytes())


def lock(file: IO[Any]) -> None:
    """Lock a file of runs as long as it is open: it cannot be continued while it is written."""
    try:
        platforms.lock_file(file.fileno(), shared=False, wait=False)
    except BlockingIOError as error:
        raise OSError(error.errno, "another mjbench is writing it") from error
    except OSError:  # a file system without locks
        pass


def line_of(record: Record) -> str:
    value = as_stored({"type": record.record_type, **to_json(record)})
    return json.dumps(value, allow_nan=False) + "\n"


def _write_line(file: TextIO, record: Record) -> None:
    file.write(line_of(record))
    file.flush()


def _discard(path: Path, file: TextIO) -> None:
    with contextlib.suppress(OSError):
        file.close()
    path.unlink(missing_ok=True)
