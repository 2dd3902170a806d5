"""The run file: everything a run measured, one JSON record a line, readable at any moment.

A record is a frozen dataclass with a class variable `record_type`. It is appended and flushed when
its measurement ends, so a killed run leaves every earlier record readable; a last line cut short
is ignored. docs/formats.md describes the records, and `mjbench/schemas` holds their JSON Schema.
"""

import contextlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import msgspec

from mjbench.errors import InputError, MachineError, one_line
from mjbench.instrument.machine import Machine

# The version of run files and of every document that `--json` writes.
#   1  first version
SCHEMA = 1


_T = TypeVar("_T")


class Record(Protocol):
    """A frozen dataclass that is stored in a run file.

    It may have a static method `upgrade`, which takes a stored record as a dictionary and renames
    what earlier versions called otherwise.
    """

    record_type: ClassVar[str]


@dataclass(frozen=True)
class RunHeader:
    """The first line of a run file.

    Attributes:
      schema: version of the format.
      command: of mjbench that wrote it.
      machine: that it ran on.
      arguments: of the command, for people; nothing is derived from them.
    """

    record_type: ClassVar[str] = "run"
    schema: int
    command: str
    machine: Machine
    arguments: dict[str, Any]


@dataclass(frozen=True)
class Run:
    """A run file, read back.

    Attributes:
      header: its first line.
      records: in the order they were written.
    """

    header: RunHeader
    records: tuple[Record, ...]

    def of_type(self, kind: type[_T]) -> list[_T]:
        """Return the records of one type."""
        return [record for record in self.records if isinstance(record, kind)]


class RunFile:
    """A run file that is being written."""

    def __init__(self, folder: Path, command: str, machine: Machine, arguments: Any):
        """Create the file and write its first line.

        Args:
          folder: to create it in.
          command: of mjbench.
          machine: that it runs on.
          arguments: of the command; a dataclass, or a dictionary of JSON-ready values.

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
                " choose another folder with --results"
            ) from error
        self.append(RunHeader(SCHEMA, command, machine, to_json(arguments)))

    def append(self, record: Record) -> None:
        """Write one record, and flush it.

        Raises:
          MachineError: the disk is full, or the file is gone.
        """
        try:
            line = json.dumps({"type": record.record_type, **to_json(record)}, allow_nan=False)
            self._file.write(line + "\n")
            self._file.flush()
        except OSError as error:
            raise MachineError(
                f"cannot write {self.path}: {error.strerror}; what was measured before is there"
            ) from error

    def close(self) -> None:
        """Close the file; `append` has already reported any failure to write."""
        with contextlib.suppress(OSError):
            self._file.close()


def to_json(value: Any) -> Any:
    """Return a dataclass, or a container of them, as JSON-ready values; paths become strings."""
    return msgspec.to_builtins(value, enc_hook=str)


def load(path: Path, record_types: Mapping[str, type]) -> Run:
    """Read a run file.

    Args:
      path: of the file.
      record_types: the class of each record by its `type`.

    Raises:
      InputError: not a run file, one of another format, or a record that does not fit its type.
    """
    lines = _lines(path)
    if not lines or not isinstance(lines[0], dict) or lines[0].get("type") != "run":
        raise InputError(f"{path}: not a run file (its first line must be the run's header)")
    if lines[0].get("schema") != SCHEMA:
        raise InputError(
            f"{path}: format {lines[0].get('schema')!r}, this version of mjbench reads {SCHEMA}"
        )
    types = {**record_types, RunHeader.record_type: RunHeader}
    header, *records = (_typed(path, n, line, types) for n, line in enumerate(lines, 1))
    return Run(header, tuple(records))


def _lines(path: Path) -> list[Any]:
    """Return the JSON value of each line; a last line that was cut short is left out."""
    try:
        texts = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {one_line(error)}") from error
    values = []
    for number, text in enumerate(texts, 1):
        try:
            values.append(json.loads(text))
        except json.JSONDecodeError as error:
            if number == len(texts) and values:
                break  # the writer was killed in the middle of its last line
            raise InputError(f"{path}, line {number}: not JSON; not a run file?") from error
    return values


def _typed(path: Path, number: int, value: Any, types: Mapping[str, type]) -> Any:
    kind = types.get(str(value.get("type"))) if isinstance(value, dict) else None
    if kind is None:
        raise InputError(f"{path}, line {number}: not a record of a run file")
    upgrade = getattr(kind, "upgrade", None)
    try:
        return msgspec.convert(upgrade(value) if upgrade else value, kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}, line {number}: {error}") from error


def latest(folder: Path) -> Path:
    """Return the newest run file of a folder.

    Raises:
      InputError: there is none.
    """
    files = sorted(folder.glob("*.jsonl"), key=lambda p: p.stat().st_mtime)
    if not files:
        raise InputError(f"no run file in {folder}; `mjbench compare` writes one")
    return files[-1]
