"""The run file: everything a run measured, one JSON record a line, readable at any moment.

History of the format (`schema` in line 1):
  1  first version

A record is appended and flushed when its measurement ends, so a killed run leaves every earlier
record readable; a last line cut short is passed over. docs/formats.md describes the records.
"""

import contextlib
import json
import os
import time
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError, one_line

SCHEMA = 1
FOLDER = Path("results/runs")

Record = dict[str, Any]


class RunFile:
    """A run file that is being written."""

    def __init__(self, folder: Path, command: str, header: Record):
        """Create the file and write its first line.

        Raises:
          MachineError: the folder cannot be written.
        """
        stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime())
        self.path = folder / f"{stamp}-{os.getpid()}-{command}.jsonl"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("x", encoding="utf-8")
        except OSError as error:
            raise MachineError(
                f"cannot write results to {folder}: {error.strerror};"
                " name another folder with --results"
            ) from error
        self.append({"type": "run", "schema": SCHEMA, "command": command, **header})

    def append(self, record: Record) -> None:
        """Write one record, and flush it.

        Raises:
          MachineError: the disk is full, or the file is gone.
        """
        try:
            self._file.write(json.dumps(record) + "\n")
            self._file.flush()
        except OSError as error:
            raise MachineError(
                f"cannot write {self.path}: {error.strerror}; what was measured before is kept"
            ) from error

    def close(self) -> None:
        """Close the file; a failure to write has been told by `append`."""
        with contextlib.suppress(OSError):
            self._file.close()


def load(path: Path) -> list[Record]:
    """Return the records of a run file, its header first.

    Raises:
      InputError: not a run file, or one of a format this version does not know.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {one_line(error)}") from error
    records = []
    for number, line in enumerate(lines, 1):
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError as error:
            if number == len(lines) and records:
                break  # the writer was killed in the middle of its last line
            raise InputError(f"{path}, line {number}: not JSON; not a run file?") from error
    if not records or not isinstance(records[0], dict) or records[0].get("type") != "run":
        raise InputError(f"{path}: not a run file (its first line must be the run's header)")
    if records[0].get("schema") != SCHEMA:
        raise InputError(
            f"{path}: format {records[0].get('schema')!r}, this version of mjbench reads {SCHEMA}"
        )
    return records


def latest(folder: Path) -> Path:
    """Return the newest run file of a folder.

    Raises:
      InputError: there is none.
    """
    files = sorted(folder.glob("*.jsonl"), key=lambda p: p.stat().st_mtime)
    if not files:
        raise InputError(f"no run file in {folder}; `mjbench compare` writes one")
    return files[-1]
